# SPDX-License-Identifier: Apache-2.0

"""A robot that sorts pieces, and which of its topics can go.

It drops each piece into one of two bins, at random, and the reward is 1 if it is the right bin for
this type of piece. The camera sees the type as a hue. The other sensors, each with a topic of its
own, do not show it. The robot's messages are written as a bag, and `select_from_bag` says what to
keep, what can go and what it would cost.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cmifs_ros.tools.arguments import number_from
from cmifs_ros.tools.program import exit_code

from .example_bag import SECOND, BagWriter, example_parser, select, write_example

ROBOT_FILE = Path(__file__).with_name('sorting.yaml')
#: Of a box, and one more piece that comes after it.
_PIECES = 13
#: Between two scans, and between two pieces, in ns.
_SCAN, _PIECE = SECOND // 10, SECOND // 2
_RAYS = 90


def readings(boxes: int, seed: int) -> Iterator[tuple[int, str, object]]:
    """Yield time in ns, topic and value of each message, in the order of time."""
    rng = np.random.default_rng(seed)
    time, speed, temperature = 100 * SECOND, 0.0, 40.0
    for _ in range(boxes * _PIECES):
        kind, chosen = rng.integers(0, 2, size=2)
        speed, temperature = 0.9 * speed + rng.normal(), temperature + 0.05 * rng.normal()
        for scan in range(_PIECE // _SCAN):
            at = time + scan * _SCAN - _SCAN // 2
            yield at, '/lidar/scan', rng.uniform(0.2, 4.0, size=_RAYS)
            yield at, '/microphone/loudness', rng.exponential()
        yield time - 4, '/belt/weight', 1.0 + 0.1 * rng.normal()
        yield time - 3, '/belt/speed', 0.5 + 0.01 * speed
        yield time - 2, '/motor/temperature', temperature
        yield time, '/camera/hue', kind + 0.2 * rng.normal()
        yield time + _PIECE // 4, '/gripper/command', int(chosen)
        yield time + _PIECE // 3, '/judge/fits', bool(kind == chosen)
        time += _PIECE


def write(bag: BagWriter, boxes: int, seed: int) -> None:
    """Write the messages of a robot that fills so many boxes."""
    kinds = {'/gripper/command': 'std_msgs/msg/Int8', '/judge/fits': 'std_msgs/msg/Bool'}
    for time, topic, value in readings(boxes, seed):
        if topic == '/lidar/scan':
            span = 0.0, 2 * np.pi, 2 * np.pi / _RAYS, 0.0, 0.1, 0.1, 4.0
            ranges = value.astype(np.float32)
            parts = bag.header(time), *span, ranges, ranges[:0]
            bag.write(topic, time, 'sensor_msgs/msg/LaserScan', *parts)
        elif topic == '/motor/temperature':
            parts = bag.header(time), value, 0.0
            bag.write(topic, time, 'sensor_msgs/msg/Temperature', *parts)
        else:
            bag.write(topic, time, kinds.get(topic, 'std_msgs/msg/Float64'), value)


def main(arguments: list[str] | None = None) -> int:
    """Run the example; return the exit code."""
    parser = example_parser('sorting', __doc__)
    parser.add_argument('--boxes', type=number_from(2), default=150, help='default 150')
    options = parser.parse_args(arguments)

    def run() -> None:
        bag = write_example(lambda bag: write(bag, options.boxes, options.seed), options.out)
        select(bag, ROBOT_FILE, options.out)

    return exit_code('sorting', run, 'nothing more is written')


if __name__ == '__main__':
    sys.exit(main())
