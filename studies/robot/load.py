# SPDX-License-Identifier: Apache-2.0

"""The cost and losses of the sampler under load, compared with nodes that only subscribe.

It also compares the age of `selected_state` with that of a bare relay of the odometry.

Odometry at 50 Hz, a lidar of 720 rays at 20 Hz, an IMU at 400 Hz and 12 joints at 500 Hz.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray

from cmifs_ros.ros.run_node import make_executor
from cmifs_ros.tools.arguments import number_from
from cmifs_ros.tools.processes import executable, stay_apart
from cmifs_ros.tools.program import CommandError, exit_code
from studies.nodes.process import Process

from .load_nodes import PERIODS, TOPICS

ROBOT_FILE = """
step: {topic: /odom}
channels:
  x: /odom.pose.pose.position.x
  scan: {path: "/scan.ranges[0:720:60]", inf: range_max}
  acceleration: /imu.linear_acceleration.x
  joints: "/joint_states.position[0:12]"
reward: "x - before(x)"
episode: {steps: 100}
"""
#: Seconds for discovery, and for the last messages.
_PATIENCE, _REST = 60.0, 3.0


def load_node(folder: Path, *role: str) -> Process:
    """Start one of `load_nodes`."""
    return Process(folder, sys.executable, '-m', 'studies.robot.load_nodes', *role)


def measure(folder: Path, listener: Process, seconds: int) -> tuple[float, dict[str, int]]:
    """Publish for a while; return the listener's share of a core, and messages sent by topic."""
    with load_node(folder, 'publish', str(seconds)) as publisher:
        _until(lambda: 'begin' in publisher.log.read_text(), 'the nodes found each other')
        begin, used = time.monotonic(), listener.cpu_seconds()
        _until(publisher.has_ended, 'all was published', seconds + _PATIENCE)
        share = (listener.cpu_seconds() - used) / (time.monotonic() - begin)
        return share, json.loads(publisher.log.read_text().splitlines()[-1])


def _until(condition, what: str, seconds: float = _PATIENCE) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            raise CommandError(f'waited {seconds:.0f} s in vain until {what}')
        time.sleep(0.05)


def sampled() -> dict[str, int]:
    """Return the numbers of messages that the sampler reports, by topic."""
    counts: dict[str, int] = {}

    def on_diagnostics(message: DiagnosticArray) -> None:
        for status in message.status:
            topic = status.name.removeprefix('sampler: ')
            if topic in TOPICS:
                counts[topic] = int({p.key: p.value for p in status.values}['messages'])

    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node('load', context=context)
    node.create_subscription(DiagnosticArray, '/diagnostics', on_diagnostics, 10)
    executor = make_executor(context)
    executor.add_node(node)

    def are_told() -> bool:
        executor.spin_once(0.1)
        return len(counts) == len(TOPICS)

    try:
        _until(are_told, 'the sampler said what it received')
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)
    return counts


def run(options: argparse.Namespace) -> None:
    """Measure one node after the other, and print a table."""
    rates = ', '.join(f'{topic} {1 / period:.0f} Hz' for topic, period in PERIODS.items())
    print(f'{rates}; for {options.seconds} s each\n')
    print('| node | share of a core | messages sent | lost |\n|---|---|---|---|')
    with tempfile.TemporaryDirectory(prefix='cmifs_load_') as name, ExitStack() as stack:
        (folder := Path(name) / 'logs').mkdir()
        (robot_file := Path(name) / 'robot.yaml').write_text(ROBOT_FILE)
        for what, role in (('subscribes', 'listen'), ('subscribes, raw', 'listen_raw')):
            with load_node(folder, role) as listener:
                share, sent = measure(folder, listener, options.seconds)
                time.sleep(_REST)
            _print(what, share, sent, json.loads(listener.log.read_text().splitlines()[-1]))
        sampler = stack.enter_context(
            Process(folder, executable('sampler_node'), robot_file=str(robot_file))
        )
        with load_node(folder, 'relay'), load_node(folder, 'control') as control:
            before = machine_times()
            share, sent = measure(folder, sampler, options.seconds)
            busy, total = (now - then for now, then in zip(machine_times(), before, strict=True))
            time.sleep(_REST)
        _print('sampler_node', share, sent, sampled())
        ages = json.loads(control.log.read_text().splitlines()[-1])
        print_ages(ages, busy / total)


def machine_times() -> tuple[float, float]:
    """Return busy and total time of all cores since the machine started."""
    times = [float(word) for word in Path('/proc/stat').read_text().split('\n')[0].split()[1:9]]
    return sum(times) - times[3] - times[4], sum(times)


def print_ages(ages: dict[str, list[int]], busy: float) -> None:
    """Print the age on receipt of relayed messages and of those of the sampler."""
    relayed, selected = (np.array(ages[way]) / 1e6 for way in ('relayed', 'selected_state'))
    print(f'\nage as it is received, of {len(relayed)} messages; all cores {busy:.0%} busy\n')
    print('| | p50 in ms | p99 in ms |\n|---|---|---|')
    for what, values in (
        ('bare relay of /odom', relayed),
        ('selected_state of the sampler', selected),
        ('the sampler adds', selected - relayed),
    ):
        p50, p99 = np.percentile(values, [50, 99])
        print(f'| {what} | {p50:.2f} | {p99:.2f} |', flush=True)


def _print(what: str, share: float, sent: dict[str, int], received: dict[str, int]) -> None:
    lost = sum(sent.values()) - sum(received.values())
    print(f'| {what} | {share:.0%} | {sum(sent.values())} | {lost} |', flush=True)


def main(arguments: list[str] | None = None) -> int:
    """Run the study; return the exit code."""
    parser = argparse.ArgumentParser(prog='load', description=' '.join(__doc__.split()))
    parser.add_argument('--seconds', type=number_from(1), default=60, help='default 60')
    options = parser.parse_args(arguments)
    stay_apart()
    return exit_code('load', lambda: run(options), 'its nodes are ended')


if __name__ == '__main__':
    sys.exit(main())
