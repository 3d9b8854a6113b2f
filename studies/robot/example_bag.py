# SPDX-License-Identifier: Apache-2.0

"""What the examples that write a bag and select from it have in common."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

from cmifs_ros.tools import select_from_bag
from cmifs_ros.tools.arguments import home_path, number_from
from cmifs_ros.tools.program import CommandError

SECOND = 10**9


class BagWriter:
    """Write messages as an MCAP bag, by rosbags; a context manager.

    Parameters
    ----------
    path : pathlib.Path

    """

    def __init__(self, path: Path):
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore

        self._store = get_typestore(Stores.ROS2_JAZZY)
        self._writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
        self._connections: dict = {}

    def __enter__(self) -> BagWriter:
        self._writer.open()
        return self

    def __exit__(self, *_) -> None:
        self._writer.close()

    def message(self, kind: str, *fields):
        """Return a message of a type, such as `std_msgs/msg/Bool`."""
        return self._store.types[kind](*fields)

    def header(self, time: int):
        """Return a header with a time in ns."""
        stamp = self.message('builtin_interfaces/msg/Time', *divmod(time, SECOND))
        return self.message('std_msgs/msg/Header', stamp, 'robot')

    def write(self, topic: str, time: int, kind: str, *fields) -> None:
        """Write a message, given its fields, at a time in ns."""
        if topic not in self._connections:
            added = self._writer.add_connection(topic, kind, typestore=self._store)
            self._connections[topic] = added
        data = self._store.serialize_cdr(self.message(kind, *fields), kind)
        self._writer.write(self._connections[topic], time, data)


def example_parser(program: str, text: str) -> argparse.ArgumentParser:
    """Return a parser with the options that the examples share."""
    parser = argparse.ArgumentParser(prog=program, description=' '.join(text.split()))
    parser.add_argument('--seed', type=number_from(0), default=0)
    parser.add_argument(
        '--out', type=home_path, default=Path(program),
        help='folder of the bag, the selection and its page (default %(default)s)',
    )  # fmt: skip
    return parser


def write_example(write: Callable[[BagWriter], None], out: Path) -> Path:
    """Write a bag into a folder and return its path; raise CommandError if that fails."""
    if find_spec('rosbags') is None:
        raise CommandError("rosbags is not here: python3 -m pip install 'rosbags>=0.11,<0.12'")
    bag = out / 'bag'
    if bag.exists():
        raise CommandError(f'{bag} exists; expected a folder without it: --out names another')
    out.mkdir(parents=True, exist_ok=True)
    with BagWriter(bag) as writer:
        write(writer)
    return bag


def select(bag: Path, robot_file: Path, out: Path) -> None:
    """Select from a bag and write a page; raise CommandError if that fails."""
    arguments = [str(bag), '--robot', str(robot_file)]
    print(f'select_from_bag {" ".join(arguments)} --report {out / "page"}', flush=True)
    if select_from_bag.main([*arguments, '--out', str(out), '--report', str(out / 'page')]):
        raise CommandError('select_from_bag failed')
