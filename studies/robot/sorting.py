# SPDX-License-Identifier: Apache-2.0

"""A robot that sorts pieces, and which of its topics can go.

It drops each piece into one of two bins, at random, and the reward is 1 if the bin is that of its
kind. The camera sees the kind as a hue. The other sensors, each with a topic of its own, say
nothing of it. The robot's messages are written as a bag, and `select_from_bag` says what to keep,
what can go and what it would cost.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from cmifs_ros.tools import select_from_bag
from cmifs_ros.tools.arguments import home_path, number_from
from cmifs_ros.tools.program import CommandError, exit_code

ROBOT_FILE = Path(__file__).with_name('sorting.yaml')
#: Of a box, and one more piece that comes after it.
_PIECES = 13
_SECOND = 10**9
#: Between two scans, and between two pieces, in ns.
_SCAN, _PIECE = _SECOND // 10, _SECOND // 2
_RAYS = 90


def readings(boxes: int, seed: int) -> Iterator[tuple[int, str, object]]:
    """Yield time in ns, topic and value of each message, in the order of time."""
    rng = np.random.default_rng(seed)
    time, speed, temperature = 100 * _SECOND, 0.0, 40.0
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


def write_bag(path: Path, boxes: int, seed: int) -> None:
    """Write the messages of a robot that fills so many boxes."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types

    def header(time):
        stamp = types['builtin_interfaces/msg/Time'](*divmod(time, _SECOND))
        return types['std_msgs/msg/Header'](stamp, 'robot')

    def scan(time, ranges):
        ranges = ranges.astype(np.float32)
        span = 0.0, 2 * np.pi, 2 * np.pi / _RAYS, 0.0, 0.1, 0.1, 4.0
        return types['sensor_msgs/msg/LaserScan'](header(time), *span, ranges, ranges[:0])

    def plain(kind):
        return kind, lambda time, value: types[kind](value)

    number = plain('std_msgs/msg/Float64')
    kinds = dict.fromkeys(
        ('/camera/hue', '/belt/weight', '/belt/speed', '/microphone/loudness'), number
    ) | {
        '/gripper/command': plain('std_msgs/msg/Int8'),
        '/judge/fits': plain('std_msgs/msg/Bool'),
        '/lidar/scan': ('sensor_msgs/msg/LaserScan', scan),
        '/motor/temperature': (
            'sensor_msgs/msg/Temperature',
            lambda time, value: types['sensor_msgs/msg/Temperature'](header(time), value, 0.0),
        ),
    }
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {
            topic: writer.add_connection(topic, kind, typestore=store)
            for topic, (kind, _) in kinds.items()
        }
        for time, topic, value in readings(boxes, seed):
            kind, message = kinds[topic]
            writer.write(connections[topic], time, store.serialize_cdr(message(time, value), kind))


def run(options: argparse.Namespace) -> None:
    """Write the bag and select from it."""
    if find_spec('rosbags') is None:
        raise CommandError("rosbags is not here: python3 -m pip install 'rosbags>=0.11,<0.12'")
    bag = options.out / 'bag'
    if bag.exists():
        raise CommandError(f'{bag} exists; expected a folder without it: --out names another')
    options.out.mkdir(parents=True, exist_ok=True)
    write_bag(bag, options.boxes, options.seed)
    arguments = [str(bag), '--robot', str(ROBOT_FILE)]
    print(f'select_from_bag {" ".join(arguments)} --report {options.out / "page"}', flush=True)
    own = ['--out', str(options.out), '--report', str(options.out / 'page')]
    if select_from_bag.main([*arguments, *own]):
        raise CommandError('select_from_bag failed')


def main(arguments: list[str] | None = None) -> int:
    """Run the example; return the exit code."""
    parser = argparse.ArgumentParser(prog='sorting', description=' '.join(__doc__.split()))
    parser.add_argument('--boxes', type=number_from(2), default=150, help='default 150')
    parser.add_argument('--seed', type=number_from(0), default=0)
    parser.add_argument(
        '--out', type=home_path, default=Path('sorting'),
        help='folder of the bag, the selection and its page (default %(default)s)',
    )  # fmt: skip
    options = parser.parse_args(arguments)
    return exit_code('sorting', lambda: run(options), 'nothing more is written')


if __name__ == '__main__':
    sys.exit(main())
