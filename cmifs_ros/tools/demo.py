# SPDX-License-Identifier: Apache-2.0

"""A demonstration: simulator, selector and a downstream node as separate processes.

It collects episodes, calls `select_features` like any client, and shows the ranking with its
evidence, what the downstream node received, and a picture.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from textwrap import shorten

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger
from tqdm import tqdm

from cmifs_ros.collect.selection_fields import selection_of
from cmifs_ros.sim import channel_names

from .demo_report import demo_parser, print_selection, save_picture
from .processes import InterruptionError, Processes, executable, stay_apart
from .program import CommandError

#: Steps per second after the episodes are collected: slow enough to read.
SHOW_RATE = 10.0
#: The simulator pauses after the requested episodes, so that these are the same each time, and then
#: continues slowly.
GO_ON = [
    Parameter(name='rate', value=ParameterValue(type=3, double_value=SHOW_RATE)),
    Parameter(name='num_episodes', value=ParameterValue(type=2, integer_value=0)),
]
#: Number of selected states to show, and characters of each: a terminal has 80 columns.
NUM_SHOWN = 3
_LINE_WIDTH = 68
NEXT = """\
next, your own robot, with the topics it already publishes (docs/robot_file.md):
  ros2 bag record -a --include-hidden-topics -o my_bag
  ros2 run cmifs_ros make_robot_file my_bag --out my_robot.yaml
  (define the reward in my_robot.yaml)
  ros2 run cmifs_ros select_from_bag my_bag --robot my_robot.yaml --report page
  ros2 launch cmifs_ros robot.launch.xml robot_file:=my_robot.yaml"""


class Client(Node):
    """A client like a user's program: it watches the diagnostics and calls the service."""

    def __init__(self, processes: Processes):
        super().__init__('demo')
        self._processes = processes
        self._episodes = 0
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        self._select = self.create_client(Trigger, 'select_features')
        self._set_parameters = self.create_client(SetParameters, 'simulator/set_parameters')

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        for status in msg.status:
            if status.name == 'selector: input':
                self._episodes = int({v.key: v.value for v in status.values}['episodes'])

    def wait_for_downstream(self) -> None:
        """Wait until the downstream node has subscribed, so that it misses nothing."""
        while not self.count_subscribers('selected_state'):
            rclpy.spin_once(self, timeout_sec=0.5)
            self._processes.check()

    def wait_for_episodes(self, count: int) -> None:
        """Show a progress bar until the selector has collected `count` episodes."""
        with tqdm(total=count, desc='episodes', file=sys.stdout, disable=None) as bar:
            shown = 0
            while shown < count:
                rclpy.spin_once(self, timeout_sec=0.5)
                self._processes.check()
                bar.update(self._episodes - shown)
                shown = self._episodes

    def select_features(self) -> dict:
        """Call the service and return its reply; the robot keeps running meanwhile."""
        selecting = self._call(self._select, Trigger.Request())
        going_on = self._call(self._set_parameters, SetParameters.Request(parameters=GO_ON))
        for result in self._result(going_on).results:
            if not result.successful:
                raise CommandError(f'the simulator refused to continue: {result.reason}')
        reply = self._result(selecting)
        result = json.loads(reply.message)
        if not reply.success:
            raise CommandError(f'select_features: {result["error"]}')
        return result

    def _call(self, client, request):
        while not client.wait_for_service(timeout_sec=0.5):
            self._processes.check()
        return client.call_async(request)

    def _result(self, future):
        while not future.done():
            rclpy.spin_until_future_complete(self, future, timeout_sec=0.5)
            self._processes.check()
        return future.result()


def run(options: argparse.Namespace) -> None:
    """Run the demo."""
    count = len(channel_names(options.scenario))
    with (
        tempfile.TemporaryDirectory(prefix='cmifs_demo_') as folder,
        Processes(Path(folder)) as processes,
    ):
        processes.start(
            'selector',
            executable('selector_node'),
            '--ros-args',
            *('-p', f'max_episodes:={options.episodes}'),
            *('-p', f'min_episodes:={options.episodes}'),
            *('-p', f'num_features:={options.num_features or 0}'),
            *('-p', 'selection_period:=0.0'),
        )
        processes.start('downstream', sys.executable, '-m', 'cmifs_ros.tools.downstream')
        print(
            f'three processes: a simulated robot with {count} sensors ({options.scenario}), the\n'
            f'selector and a downstream node; collecting {options.episodes} episodes'
        )
        client = Client(processes)
        client.wait_for_downstream()
        processes.start(
            'simulator',
            executable('simulator_node'),
            '--ros-args',
            *('-p', f'scenario:={options.scenario}'),
            *('-p', f'seed:={options.seed}'),
            *('-p', f'rate:={options.rate}'),
            *('-p', f'num_episodes:={options.episodes}'),
        )
        client.wait_for_episodes(options.episodes)
        num_before = len(processes.lines('downstream'))
        print('calling /select_features; states keep flowing meanwhile ...', flush=True)
        result = client.select_features()
        received = processes.lines('downstream')
        meanwhile = len(received) - num_before
        # The last states may have only the selected channels; all may have been missed.
        before = [line for line in received if len(line.split()) == count][-1:]
        selection = selection_of(result)
        print(
            f'reply after {selection.seconds:.1f} s of computing, from {selection.episodes} '
            f'episodes, {selection.steps} steps'
        )
        print_selection(selection, options.scenario)
        lines = _states(processes, len(selection.names) or count)
    print(f'\nreceived by the downstream node ({meanwhile} states during the selection):')
    for line in before:
        print(f'  before  {shorten(line, _LINE_WIDTH, placeholder=" ...")}')
    for line in lines[-NUM_SHOWN:]:
        print(f'  after   {shorten(line, _LINE_WIDTH, placeholder=" ...")}')
    picture = save_picture(selection, options.scenario, options.out)
    print(f'\npicture: {picture}\n\n{NEXT}')


def _states(processes: Processes, count: int) -> list[str]:
    """Wait until the downstream node has enough states of `count` sensors; return them."""
    deadline = time.monotonic() + 10
    while True:
        lines = [line for line in processes.lines('downstream') if len(line.split()) == count]
        if len(lines) >= NUM_SHOWN:
            return lines
        if time.monotonic() > deadline:
            raise CommandError(f'the downstream node received no states of {count} sensors')
        processes.check()
        time.sleep(1 / SHOW_RATE)


def main(arguments: list[str] | None = None) -> int:
    """Run the demo; return the exit code."""
    parser = demo_parser('demo', __doc__.splitlines()[0])
    parser.add_argument('--rate', type=float, default=400.0, help='steps per second (default 400)')
    options = parser.parse_args(arguments)

    stay_apart()
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        run(options)
    except CommandError as error:
        print(f'demo: {error}', file=sys.stderr)
        return 1
    except InterruptionError as interrupt:
        print('\ndemo: interrupted', file=sys.stderr)
        return 128 + interrupt.args[0]
    finally:
        rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
