# SPDX-License-Identifier: Apache-2.0

"""Loads on the selector, compared with bare nodes."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from rcl_interfaces.srv import ListParameters

from studies.nodes.process import Process

from .messages import LENGTH
from .part import Part, quantiles
from .robot import Robot, robot_and


class Loads(Part):
    """Executors, rates and a million transitions."""

    def executors(self):
        """Compare the executors with the same nodes and messages, in turns."""
        for node in ('relay', 'selector'):
            found = {}
            for executor in ('single', 'chosen') * 2:
                process = self.bare(node, executor, selection_period=0.0)
                with robot_and(process) as robot:
                    robot.wait_for('selected_state')
                    used, begin = process.cpu_seconds(), time.monotonic()
                    robot.run(500, self.count(5000))
                    share = (process.cpu_seconds() - used) / (time.monotonic() - begin)
                    latencies, shares = found.setdefault(executor, ([], []))
                    latencies.append(robot.measured())
                    shares.append(share)
            for executor, (latencies, shares) in found.items():
                name = 'SingleThreadedExecutor' if executor == 'single' else 'the chosen executor'
                yield (
                    f'500 transitions/s, {node} in {name}',
                    f'{sum(map(len, latencies))} transitions',
                    f'{quantiles(np.concatenate(latencies))}, {np.mean(shares):.0%} of a core',
                )

    def load(self):
        """1 kHz, with selections back to back, against a bare relay in turns of 5 s."""
        path = self.folder / 'load'
        # The rewards count up, so that older episodes would be forgotten as of another task.
        selector = Process.selector(
            self.folder, selection_period=0.0, episodes_path=str(path), forget_outdated=False
        )
        relay = self.bare('relay', namespace='/relay')
        with robot_and(selector, relay) as robot:
            robot.wait_for('selected_state')
            robot.wait_for('/relay/selected_state')
            for is_busy in (False, True):
                latencies, shares = {'': [], '/relay': []}, {'': [], '/relay': []}
                begin_number = robot.number
                robot.run(1000, 2000)  # as many episodes as are kept
                robot.measured()
                if is_busy:
                    robot.select_back_to_back()
                for _ in range(self.count(12 if is_busy else 6)):
                    for to, process in (('', selector), ('/relay', relay)):
                        used, begin = process.cpu_seconds(), time.monotonic()
                        robot.run(1000, 5000, to)
                        shares[to].append(
                            (process.cpu_seconds() - used) / (time.monotonic() - begin)
                        )
                        latencies[to].append(robot.measured())
                what = 'with selections back to back' if is_busy else 'without selections'
                count = robot.number - begin_number
                yield (
                    f'1000 transitions/s {what}',
                    f'{count} transitions, {robot.num_selections} selections',
                    self._lost(robot, path),
                )
                ours, theirs = (np.concatenate(latencies[to]) for to in ('', '/relay'))
                yield (
                    f'latency, {what}',
                    f'{len(ours)} and {len(theirs)} states',
                    f'{quantiles(ours)}; bare relay {quantiles(theirs)}: {ratios(ours, theirs)}',
                )
                yield (
                    f'processor, {what}',
                    '',
                    f'{np.mean(shares[""]):.0%} of a core; '
                    f'bare relay, which gets no rewards, {np.mean(shares["/relay"]):.0%}',
                )
            robot.is_selecting = False

    def _lost(self, robot: Robot, path: Path) -> str:
        """Return what a selector lost of everything sent to it, according to its file."""
        lost = robot.number - robot.settled_transitions()
        drops = {k: v for k, v in robot.input.items() if 'dropped' in k}
        sent = list(range(robot.number))
        newest = [sent[i : i + LENGTH] for i in range(0, len(sent), LENGTH)][-100:]
        kept = robot.numbers_in(path)[-100:]  # what would be restored
        same = 'equal those sent' if kept == newest else 'DIFFER from those sent'
        return f'{lost} lost{f", {drops}" if drops else ""}; the 100 buffered episodes {same}'

    def rates(self):
        """Find the highest rate without loss, of the selector and of a bare subscriber."""
        best = {}
        for node, output in (('counter', 'counts'), ('selector', 'selected_state')):
            if node == 'selector':
                process = Process.selector(self.folder, selection_period=0.0)
            else:
                process = self.bare(node)
            # The sender is busy: nobody subscribes to the selected states.
            with robot_and(process, listens=False) as robot:
                robot.wait_for(output)
                rate = 1000.0
                while True:
                    before, begin = robot.number, time.monotonic()
                    robot.run(rate, self.count(int(4 * rate)))
                    achieved = (robot.number - before) / (time.monotonic() - begin)
                    robot.rest(3.0)
                    got = (
                        min(robot.counts) if node == 'counter' else int(robot.input['transitions'])
                    )
                    if got < robot.number or achieved < 0.95 * rate:
                        why = f'{robot.number - got} lost at {rate:.0f}/s'
                        if got == robot.number:
                            why = f'the sender cannot do more than {achieved:.0f}/s'
                        break
                    best[node] = achieved
                    rate *= 1.15
                yield (
                    f'highest rate without loss, {node}',
                    '4 s a rate, each 15 % above the last',
                    f'{best.get(node, 0):.0f} transitions/s ({why})',
                )
        if 'counter' in best:
            share = best.get('selector', 0) / best['counter']
            yield 'the same, selector against bare counter', '', f'{share:.0%}'

    def million(self):
        """Collect a million transitions; the memory must not grow."""
        total = self.count(1_000_000)
        path = self.folder / 'million'
        process = Process.selector(
            self.folder, selection_period=5.0, num_features=1, episodes_path=str(path),
            forget_outdated=False,
        )  # fmt: skip
        with robot_and(process, listens=False) as robot:
            robot.wait_for('selected_state')
            sizes, slowest = [], 0.0
            begin = time.monotonic()
            for _ in range(50):
                robot.run(3000, total // 50 // LENGTH * LENGTH)
                asked = time.monotonic()
                robot.call(robot.parameters, ListParameters.Request())
                slowest = max(slowest, time.monotonic() - asked)
                robot.diagnostics.clear()
                robot.until(lambda: robot.input, 'diagnostics came')
                robot.measured()
                sizes.append(process.resident_bytes())
            full = sizes[4]
            yield (
                'a million transitions' if self.scale == 1 else 'many transitions',
                f'{robot.number} in {time.monotonic() - begin:.0f} s',
                f'{self._lost(robot, path)}; memory {full / 1e6:.1f} MB after a tenth, '
                f'{sizes[-1] / 1e6:.1f} MB at the end ({sizes[-1] / full - 1:+.1%}), at most '
                f'{max(sizes) / 1e6:.1f} MB; a service answered within {slowest:.2f} s',
            )


def ratios(ours: np.ndarray, theirs: np.ndarray) -> str:
    """Return the ratios of p50 and p99 as text."""
    if not (len(ours) and len(theirs)):
        return 'no ratio'
    p50, p99 = np.percentile(ours, (50, 99)) / np.percentile(theirs, (50, 99))
    return f'{p50:.2f} times and {p99:.2f} times'
