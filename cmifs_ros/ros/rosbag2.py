# SPDX-License-Identifier: Apache-2.0

"""Bags by rosbag2_py and the installed message types, for where rosbags is not installed."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path

from rclpy.serialization import deserialize_message

from cmifs_ros.collect.robot_file.observed_fields import TypeField
from cmifs_ros.collect.sampling.bag_reader import BagReader, opened
from cmifs_ros.collect.sampling.storages import Connection, Storage

from . import conversions
from .graph_survey import fields_of


def open_bag(path: str | Path) -> AbstractContextManager[BagReader]:
    """Open a bag, a file or a folder; raise a BagError if it cannot be opened."""
    return opened(path, _storages, InstalledTypes)


def _storages(path: Path, stack: ExitStack) -> list[Storage]:
    return [Rosbag2Storage(path)]  # One for all files of the bag.


class Rosbag2Storage:
    """A `Storage` by rosbag2_py, of all storages and compressions that are installed."""

    def __init__(self, path: Path):
        from rosbag2_py import Info

        self._path = str(path)
        about = Info().read_metadata(self._path, '')
        self._is_compressed = bool(about.compression_mode)
        topics = [(info.topic_metadata, info.message_count)
                  for info in about.topics_with_message_count]  # fmt: skip
        self.connections = [
            Connection(number, topic.name, topic.type, '', '', topic.serialization_format, count)
            for number, (topic, count) in enumerate(topics)
        ]
        begin = about.starting_time.nanoseconds
        self.times: tuple[int, ...] = (
            (begin, begin + about.duration.nanoseconds) if about.message_count else ()
        )  # fmt: skip

    def messages(
        self, connections: Collection[Connection]
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield the messages."""
        from rosbag2_py import (
            ConverterOptions,
            SequentialCompressionReader,
            SequentialReader,
            StorageFilter,
            StorageOptions,
        )

        reader = SequentialCompressionReader() if self._is_compressed else SequentialReader()
        reader.open(StorageOptions(uri=self._path), ConverterOptions())
        wanted = {connection.topic: connection for connection in connections}
        reader.set_filter(StorageFilter(topics=list(wanted)))
        while reader.has_next():
            topic, data, time = reader.read_next()
            yield wanted[topic], time, data

    def close(self) -> None:
        """Do nothing: readers close with the last message."""


class InstalledTypes:
    """`MessageTypes` of the packages that are sourced."""

    def __init__(self, connections: Iterable[Connection]):
        self._classes: dict[str, type] = {}
        self.unreadable: dict[str, str] = {}
        for connection in connections:
            topic, kind, form = connection.topic, connection.msgtype, connection.serialization
            if form != 'cdr':
                self.unreadable[topic] = f'its messages are {form or "of no format"}; expected cdr'
                continue
            try:
                self._classes[kind] = conversions.message_type(kind)
            except (ValueError, ImportError, AttributeError):
                self.unreadable[topic] = (
                    f'its type {kind} is not installed here; source it, or pip install '
                    "'rosbags>=0.11,<0.12' mcap, which reads it from the bag"
                )

    def decode(self, connection: Connection, data: bytes) -> object:
        """Return a message."""
        return deserialize_message(data, self._classes[connection.msgtype])

    def fields_of(self, kind: str) -> list[TypeField]:
        """Return the fields of a type, in order."""
        return fields_of(kind)
