# SPDX-License-Identifier: Apache-2.0

"""The files of a bag: their topics, and the bytes of their messages in order of time.

Message types are not interpreted here, so an unknown schema does not make a file unreadable.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path
from typing import NamedTuple, Protocol


class Connection(NamedTuple):
    """A topic of a file.

    Attributes
    ----------
    id : int
        Id of the topic in its file.
    topic, msgtype : str
    encoding, definition : str
        Format and text of its type, such as `ros2msg` and the .msg file; empty if not stored.
    serialization : str
        Format of its messages: `cdr`, `ros1`, or another, which cannot be decoded.
    msgcount : int

    """

    id: int
    topic: str
    msgtype: str
    encoding: str
    definition: str
    serialization: str
    msgcount: int


class Storage(Protocol):
    """One open file of a bag.

    Attributes
    ----------
    connections : list of Connection
    times : tuple of int
        Recording times of the first and the last message in nanoseconds; empty without messages.

    """

    connections: list[Connection]
    times: tuple[int, ...]

    def messages(
        self, connections: Collection[Connection]
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield connection, recording time and bytes of the messages of some connections."""

    def close(self) -> None:
        """Close the file."""


class SqliteStorage:
    """A `Storage` for SQLite, .db3."""

    def __init__(self, path: Path):
        self._database = sqlite3.connect(f'{path.absolute().as_uri()}?immutable=1', uri=True)
        try:
            self._read_topics()
        except BaseException:
            self._database.close()
            raise

    def _read_topics(self) -> None:
        tables = {name for (name,) in self._rows('SELECT name FROM sqlite_master')}
        if not {'topics', 'messages'} <= tables:
            raise ValueError('it lacks the tables topics and messages')
        definitions = {}
        if 'message_definitions' in tables:  # Since Iron.
            definitions = {
                kind: (encoding, definition)
                for kind, encoding, definition in self._rows(
                    'SELECT topic_type, encoding, encoded_message_definition '
                    'FROM message_definitions'
                )
            }
        counts = dict(self._rows('SELECT topic_id, count(*) FROM messages GROUP BY topic_id'))
        self.connections = [
            Connection(
                number, topic, kind, *definitions.get(kind, ('', '')), form, counts.get(number, 0)
            )
            for number, topic, kind, form in self._rows(
                'SELECT id, name, type, serialization_format FROM topics ORDER BY id'
            )
        ]
        ((begin, end),) = self._rows('SELECT min(timestamp), max(timestamp) FROM messages')
        self.times: tuple[int, ...] = () if begin is None else (begin, end)

    def _rows(self, query: str, *values) -> Iterator[tuple]:
        with closing(self._database.execute(query, values)) as cursor:
            yield from cursor

    def messages(
        self, connections: Collection[Connection]
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield the messages."""
        wanted = {connection.id: connection for connection in connections}
        marks = ', '.join('?' * len(wanted))
        for number, time, data in self._rows(
            f'SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks}) '
            'ORDER BY timestamp, id', *wanted,
        ):  # fmt: skip
            yield wanted[number], time, data

    def close(self) -> None:
        """Close the database."""
        self._database.close()


class Ros1Storage:
    """A `Storage` for ROS 1, .bag."""

    def __init__(self, path: Path):
        from rosbags.rosbag1 import Reader

        self._reader = Reader(path)
        self._reader.open()
        self.connections = [
            Connection(c.id, c.topic, c.msgtype, 'ros2msg', c.msgdef.data, 'ros1', c.msgcount)
            for c in self._reader.connections
        ]
        has_messages = any(c.msgcount for c in self.connections)
        self.times: tuple[int, ...] = (
            (self._reader.start_time, self._reader.end_time - 1) if has_messages else ()
        )  # fmt: skip

    def messages(
        self, connections: Collection[Connection]
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield the messages."""
        wanted = {connection.id: connection for connection in connections}
        of_reader = [c for c in self._reader.connections if c.id in wanted]
        for connection, time, data in self._reader.messages(of_reader):
            yield wanted[connection.id], time, data

    def close(self) -> None:
        """Close the file."""
        self._reader.close()


class CompressedMessages:
    """A `Storage` whose messages were compressed individually with zstd."""

    def __init__(self, storage: Storage):
        self._storage = storage
        self.connections, self.times = storage.connections, storage.times

    def messages(
        self, connections: Collection[Connection]
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield the messages."""
        from zstandard import ZstdDecompressor

        for connection, time, data in self._storage.messages(connections):
            yield connection, time, ZstdDecompressor().decompressobj().decompress(data)

    def close(self) -> None:
        """Close the file."""
        self._storage.close()
