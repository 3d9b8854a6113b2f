# SPDX-License-Identifier: Apache-2.0

"""A robot with ordinary topics and its robot file: a live selection, and one from its bag.

The robot, the sampler and the selector are separate processes, and the run is recorded.
select_from_bag must then find the same episodes, byte for byte, and the same selection.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from itertools import zip_longest
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from std_srvs.srv import Trigger
from tqdm import tqdm

from cmifs_ros.collect.episodes.file_reader import read_episodes
from cmifs_ros.collect.selection_fields import selection_of
from cmifs_ros.core import Episode
from cmifs_ros.core.selection import Selection
from cmifs_ros.ros.run_node import make_executor
from cmifs_ros.tools import select_from_bag
from cmifs_ros.tools.arguments import number_from
from cmifs_ros.tools.processes import executable, stay_apart
from cmifs_ros.tools.program import CommandError, exit_code
from studies.nodes.process import Process

from .drive import TOPICS
from .recorder import Recorder

ROBOT_FILE = Path(__file__).with_name('robot.yaml')
#: Seconds to wait for the last episode, and for a selection.
_PATIENCE, _SELECTION = 30.0, 600.0


class Operator:
    """The study's own node: it records, reads diagnostics and requests a selection."""

    def __init__(self, bag: Path):
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node('operator', context=self._context)
        self._executor = make_executor(self._context)
        self._executor.add_node(self._node)
        self.recorder = Recorder(self._node, bag, TOPICS)
        self.diagnostics: dict[str, dict[str, str]] = {}
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        self._select = self._node.create_client(Trigger, 'select_features')

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.diagnostics[status.name] = {pair.key: pair.value for pair in status.values}

    @property
    def num_episodes(self) -> int:
        """Number of episodes of the selector."""
        return int(self.diagnostics.get('selector: input', {}).get('episodes', 0))

    @property
    def is_ready(self) -> bool:
        """Whether sampler and selector are running and connected."""
        return (
            self._node.count_publishers('state') > 0
            and self._node.count_subscribers('state') > 0
            and self._node.count_subscribers('reward') > 0
            and {'sampler: steps', 'selector: input'} <= self.diagnostics.keys()
        )

    def until(self, condition: Callable[[], bool], what: str, seconds: float) -> None:
        """Spin until a condition holds; raise if that takes too long."""
        deadline = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > deadline:
                raise CommandError(f'waited {seconds:.0f} s in vain until {what}')
            self._executor.spin_once(0.05)

    def select(self) -> Selection:
        """Return the reply of the selector."""
        future = self._select.call_async(Trigger.Request())
        self.until(future.done, 'the selector answered', _SELECTION)
        reply = json.loads(future.result().message)
        error = reply.get('error', '')
        if error:
            raise CommandError(f'the selector refused: {error}')
        return selection_of(reply)

    def close(self) -> None:
        """Destroy the node and finish the bag."""
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)
        self.recorder.close()


def drive(folder: Path, options: argparse.Namespace) -> Selection:
    """Let the robot drive; write `live` (episodes) and `bag`; return the live selection."""
    (logs := folder / 'logs').mkdir()
    robot_command = ('-m', 'studies.robot.robot_node', str(options.goals), str(options.seed))
    operator = Operator(folder / 'bag')
    with ExitStack() as stack:
        stack.callback(operator.close)
        stack.enter_context(
            Process(logs, executable('selector_node'), use_sim_time=True, selection_period=0.0,
                    min_episodes=options.goals, max_episodes=options.goals,
                    significance=0.15,  # of which the first selection spends a third
                    episodes_path=str(folder / 'live'))
        )  # fmt: skip
        stack.enter_context(
            Process(logs, executable('sampler_node'), use_sim_time=True, robot_file=str(ROBOT_FILE))
        )
        operator.until(lambda: operator.is_ready, 'sampler and selector are there', _PATIENCE)
        robot = stack.enter_context(
            Process(logs, sys.executable, *robot_command, str(options.speed))
        )
        with tqdm(total=options.goals, unit=' goals', disable=None, leave=False) as bar:

            def is_over() -> bool:
                bar.update(operator.num_episodes - bar.n)
                return robot.has_ended() or operator.num_episodes == options.goals

            operator.until(is_over, 'the robot ended', 60 + 15 * options.goals / options.speed)
        operator.until(
            lambda: operator.num_episodes == options.goals,
            f'all {options.goals} episodes came; {operator.diagnostics}', _PATIENCE,
        )  # fmt: skip
        operator.until(robot.has_ended, 'the robot ended', _PATIENCE)
        for name, values in sorted(operator.diagnostics.items()):
            if name.startswith('sampler: /'):
                print(f'  {name}: {values["messages"]} messages, {values["late"]} late, '
                      f'{values["wrong"]} wrong')  # fmt: skip
        print(f'{operator.num_episodes} episodes live, {operator.recorder.num_messages} recorded')
        print('selecting live ...', flush=True)
        return operator.select()


def run(options: argparse.Namespace) -> None:
    """Drive, select live and from the bag, and compare."""
    with tempfile.TemporaryDirectory(prefix='cmifs_robot_') as name:
        folder = Path(name)
        live = drive(folder, options)
        arguments = [str(folder / 'bag'), '--robot', str(ROBOT_FILE), '--out', name]
        arguments += ['--significance', str(live.level)]
        if select_from_bag.main([*arguments, '--episodes-file', str(folder / 'from_bag')]):
            raise CommandError('select_from_bag failed')
        one, other = (
            read_episodes(folder / which, max_episodes=options.goals, max_bytes=10**9)
            for which in ('live', 'from_bag')
        )
        from_bag = selection_of(json.loads((folder / 'selection.json').read_text()))
    pairs = list(zip_longest(one.episodes, other.episodes))
    names = one.channel_names
    differing = {i: what for i, pair in enumerate(pairs) if (what := _difference(*pair, names))}
    if differing:
        raise CommandError(
            f'live and from the bag, episodes differ, by number: {differing}; a best-effort '
            'message may have reached only one of them; on a slow machine, reduce --speed'
        )
    print(f'the same {len(one.episodes)} episodes live and from the bag, byte for byte')
    # The node uses one BLAS thread, which changes the last digits.
    gap = np.inf
    if _words(live) == _words(from_bag):
        gap = np.abs(np.subtract(_numbers(live), _numbers(from_bag))).max(initial=0)
    if gap > 1e-6:
        raise CommandError(
            f'the selections live and from the bag differ, scores by {gap:.1g}: {live} {from_bag}'
        )
    print(
        f'the same selection live and from the bag: {", ".join(live.names) or "nothing"} '
        f'(scores to {gap:.0e})'
    )


def _words(selection: Selection) -> tuple:
    """Return what two selections from the same data must have in common exactly."""
    return (
        selection.indices,
        selection.episodes,
        selection.steps,
        selection.outdated,
        [
            (s.name, s.channels, s.is_constant, s.status, s.supporting_channels, s.redundant_with)
            for s in selection.sensors
        ],
    )


def _numbers(selection: Selection) -> np.ndarray:
    """Return scores and evidence of all sensors, concatenated."""
    return np.concatenate([(s.score, s.pvalue, *(s.null_band or ())) for s in selection.sensors])


def _difference(one: Episode | None, other: Episode | None, names: Sequence[str]) -> str:
    """Return a message about the differences; empty if equal byte for byte."""
    if one is None or other is None:
        return 'in only one of them'
    if len(one) != len(other):
        return f'{len(one)} and {len(other)} steps'
    if one.states.tobytes() != other.states.tobytes():
        return ', '.join(np.array(names)[np.any(one.states != other.states, axis=0)])
    return '' if one.rewards.tobytes() == other.rewards.tobytes() else 'rewards'


def main(arguments: list[str] | None = None) -> int:
    """Run the study; return the exit code."""
    parser = argparse.ArgumentParser(prog='robot', description=' '.join(__doc__.split()))
    parser.add_argument('--goals', type=number_from(2), default=80, help='default 80')
    parser.add_argument('--seed', type=number_from(0), default=0)
    parser.add_argument(
        '--speed', type=float, default=2.0,
        help='speed relative to real time (default 2)',
    )  # fmt: skip
    options = parser.parse_args(arguments)
    if not 0.1 <= options.speed <= 20:
        parser.error(f'--speed is {options.speed:g}; expected 0.1 to 20')
    stay_apart()
    return exit_code('robot', lambda: run(options), 'its nodes are ended')


if __name__ == '__main__':
    sys.exit(main())
