# SPDX-License-Identifier: Apache-2.0

"""What `saving` saves, what it costs the controller, and how late a change of task is noticed.

The same robot drives to goals twice, without and with `saving` in its robot file. Its controller
uses only `selected_state`. The driver of the other lidar computes its 360 rays only while it has a
subscriber. At the end the task changes: the motor's temperature, which was dispensable, begins to
matter.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_msgs.msg import String
from std_srvs.srv import Trigger
from tqdm import tqdm

from cmifs_ros.collect.selection_fields import selection_of
from cmifs_ros.core.selection import Selection
from cmifs_ros.core.words import listed
from cmifs_ros.ros.qos import LATCHED_QOS
from cmifs_ros.ros.run_node import make_executor
from cmifs_ros.tools.arguments import number_from
from cmifs_ros.tools.processes import executable, stay_apart
from cmifs_ros.tools.program import CommandError, exit_code
from studies.nodes.process import Process

ROBOT_FILE = """
step: {topic: /odom}
channels:
  x: /odom.pose.pose.position.x
  y: /odom.pose.pose.position.y
  scan: {path: "/scan.ranges[0:12]", inf: range_max}
  motor: /motor.temperature
  acceleration: /imu.linear_acceleration.x
  other_scan: {path: "/other/scan.ranges[0:360:30]", inf: range_max}
reward: succeeded - aborted
episode: {action: /go_to}
"""
SAVING = 'saving: {after: 3, explore_every: %d, explore_episodes: 10}\n'
#: The sensor that matters after the change.
_NEW = 'motor'
#: Goals before the first selection; until then the controller gets all channels.
_FIRST = 120
#: A sensor that adds less than this share can go.
_MARGIN = 0.05
#: Seconds between selections, and that one goal may take at most.
_PERIOD, _PATIENCE = 5.0, 60.0


@dataclass
class Run:
    """What is known of a run.

    Attributes
    ----------
    rewards : list of float
        Of each goal.
    switched_off : list of (int, list of str)
        How many goals had ended, and the topics that were off from then on.
    selections : list of (int, Selection)
        How many goals had ended, and what was published then.
    at : dict of int to dict
        By goals, seconds, CPU seconds of the processes, and messages and bytes of the lidar.

    """

    rewards: list[float] = field(default_factory=list)
    switched_off: list[tuple[int, list[str]]] = field(default_factory=list)
    selections: list[tuple[int, Selection]] = field(default_factory=list)
    at: dict[int, dict[str, float]] = field(default_factory=dict)

    def found_after(self, change_at: int) -> int | None:
        """Return after how many goals of the new task what matters in it was selected."""
        found = [n for n, s in self.selections if n > change_at and _NEW in s.names]
        return found[0] - change_at if found else None

    def doubted_after(self, change_at: int) -> int | None:
        """Return after how many goals of the new task a change was noticed."""
        found = [n for n, s in self.selections if n > change_at and (s.doubt or s.outdated)]
        return found[0] - change_at if found else None

    def share_off(self, topic: str, first: int, last: int) -> float:
        """Return the share of goals during which a topic was off."""
        is_off = np.zeros(last, dtype=bool)
        for since, topics in self.switched_off:
            is_off[since:] = topic in topics
        return float(is_off[first:].mean())


class Observer:
    """The study's own node: it notes what is selected and switched off, and starts selecting."""

    def __init__(self, run: Run):
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node('saving', context=self._context)
        self._executor = make_executor(self._context)
        self._executor.add_node(self._node)
        self._run = run
        self._node.create_subscription(String, 'selection', self._on_selection, LATCHED_QOS)
        self._node.create_subscription(String, 'switched_off', self._on_switched_off, LATCHED_QOS)
        self._select = self._node.create_client(Trigger, 'select_features')
        self._set = self._node.create_client(SetParameters, 'selector/set_parameters')

    def _on_selection(self, message: String) -> None:
        found = selection_of(json.loads(message.data))
        self._run.selections.append((len(self._run.rewards), found))

    def _on_switched_off(self, message: String) -> None:
        self._run.switched_off.append((len(self._run.rewards), json.loads(message.data)))

    def spin(self) -> None:
        """Take what has come."""
        self._executor.spin_once(0.05)

    def begin_to_select(self) -> None:
        """Have the selector select from now on."""
        request = SetParameters.Request()
        request.parameters = [Parameter('selection_period', value=_PERIOD).to_parameter_msg()]
        self._set.call_async(request)
        self._select.call_async(Trigger.Request())

    def close(self) -> None:
        """Leave the graph."""
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)


def drive(options: argparse.Namespace, saving: str) -> Run:
    """Let the robot drive to all its goals, or until the change of task is found out."""
    run, change_at = Run(), options.goals
    num_goals = options.goals + options.more
    with tempfile.TemporaryDirectory(prefix='cmifs_saving_') as name, ExitStack() as stack:
        (logs := Path(name) / 'logs').mkdir()
        (robot_file := Path(name) / 'robot.yaml').write_text(ROBOT_FILE + saving)
        observer = Observer(run)
        stack.callback(observer.close)

        def start(role: str, *arguments) -> Process:
            command = (sys.executable, '-m', 'studies.robot.saving_nodes', role)
            return stack.enter_context(Process(logs, *command, *map(str, arguments)))

        stack.enter_context(
            Process.selector(logs, selection_period=0.0, max_episodes=_FIRST, margin=_MARGIN)
        )
        sampler = stack.enter_context(
            Process(logs, executable('sampler_node'), robot_file=str(robot_file))
        )
        lidar = start('lidar', options.seed + 1, options.speed)
        start('control')
        robot = start('robot', num_goals, change_at, options.seed, options.speed)
        newest, count = time.monotonic(), 0
        with tqdm(total=num_goals, unit=' goals', disable=None, leave=False) as bar:
            while not robot.has_ended() and run.found_after(change_at) is None:
                observer.spin()
                run.rewards = [said['reward'] for said in said_by(robot)]
                if len(run.rewards) == count:
                    if time.monotonic() > newest + _PATIENCE:
                        raise CommandError(f'no goal ended in {_PATIENCE:.0f} s')
                    continue
                newest = time.monotonic()
                if count < _FIRST <= len(run.rewards):
                    observer.begin_to_select()
                bar.update(len(run.rewards) - count)
                count = len(run.rewards)
                run.at[count] = {
                    'seconds': newest,
                    'sampler': sampler.cpu_seconds(),
                    'lidar': lidar.cpu_seconds(),
                    **said_by(lidar)[-1],
                }
    return run


def said_by(process: Process) -> list[dict[str, float]]:
    """Return what a process has printed as JSON, line by line."""
    lines = process.log.read_text().split('\n')[:-1]  # The last one is not whole.
    return [json.loads(line) for line in lines if line.startswith('{')]


def measured(run: Run, first: int, last: int) -> dict[str, str]:
    """Return what a run says of the goals from one to another, and of the change after them."""
    begin, end = (run.at[min(n for n in run.at if n >= number)] for number in (first, last))
    rates = {key: (end[key] - begin[key]) / (end['seconds'] - begin['seconds']) for key in end}
    rewards, off = run.rewards[first:last], run.share_off('/other/scan', first, last)
    return {
        'goals during which `/other/scan` is off': f'{off:.0%}',
        'published by its driver': (
            f'{rates["messages"]:.1f} messages/s, {rates["bytes"] / 1000:.1f} kB/s'
        ),
        'CPU time of its driver': f'{rates["lidar"]:.0%} of a core',
        'CPU time of the sampler': f'{rates["sampler"]:.0%} of a core',
        'return of the controller, with its standard error': (
            f'{np.mean(rewards):.2f} +- {np.std(rewards) / np.sqrt(len(rewards)):.2f}'
        ),
        'the change of the task is noticed': _goals(run.doubted_after(last)),
        "the motor's temperature is selected": _goals(run.found_after(last)),
    }


def _goals(number: int | None) -> str:
    return 'not' if number is None else f'after {number} goals'


def run(options: argparse.Namespace) -> None:
    """Drive twice and print the table."""
    first, found = _FIRST + options.settle, []
    for saving in ('', SAVING % options.every):
        one = drive(options, saving)
        for number, selection in one.selections:
            told = selection.doubt or (selection.outdated and f'{selection.outdated} outdated')
            print(f'goal {number}: {listed(selection.names)} {told or ""}', file=sys.stderr)
        for number, topics in one.switched_off:
            print(f'goal {number}: off {listed(topics)}', file=sys.stderr)
        found.append(measured(one, first, options.goals))
    print(
        f'goals {first} to {options.goals}; then the task changes; margin {_MARGIN:g}; '
        f'{(SAVING % options.every).strip()}\n\n'
        '| | without `saving` | with `saving` |\n|---|---|---|'
    )
    for what in found[0]:
        print(f'| {what} | {found[0][what]} | {found[1][what]} |')


def main(arguments: list[str] | None = None) -> int:
    """Run the study; return the exit code."""
    parser = argparse.ArgumentParser(prog='saving', description=' '.join(__doc__.split()))
    parser.add_argument(
        '--goals', type=number_from(1), default=200, help='before the task changes (default 200)'
    )
    parser.add_argument(
        '--more', type=number_from(1), default=150, help='after that at most (default 150)'
    )
    parser.add_argument(
        '--settle', type=number_from(0), default=20,
        help='after the first selection, before anything is measured (default 20)',
    )  # fmt: skip
    parser.add_argument(
        '--every', type=number_from(1), default=20, help='explore_every (default 20)'
    )
    parser.add_argument('--seed', type=number_from(0), default=0)
    parser.add_argument(
        '--speed', type=float, default=8.0,
        help='speed relative to real time (default 8)',
    )  # fmt: skip
    options = parser.parse_args(arguments)
    if not 0.1 <= options.speed <= 20:
        parser.error(f'--speed is {options.speed:g}; expected 0.1 to 20')
    if options.goals <= _FIRST + options.settle:
        parser.error(f'--goals is {options.goals}; expected more than {_FIRST + options.settle}')
    stay_apart()
    return exit_code('saving', lambda: run(options), 'its nodes are ended')


if __name__ == '__main__':
    sys.exit(main())
