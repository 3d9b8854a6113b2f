"""The files of a bag: which topics they hold, and the bytes of their messages in order of time.

What a topic's messages mean is not asked here, so that no foreign schema makes a file unreadable.
"""

from __future__ import annotations

import heapq
import sqlite3
import struct
from array import array
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import closing
from io import SEEK_END
from itertools import count
from pathlib import Path
from typing import NamedTuple, Protocol

_MCAP_MESSAGE = 5
_MCAP_MAGIC = b'\x89MCAP0\r\n'


class Connection(NamedTuple):
    """A topic of a file.

    Attributes
    ----------
    id : int
        Of the topic in its file.
    topic, msgtype : str
    encoding, definition : str
        Of its type, such as `ros2msg` and the text of the .msg file; empty if the file has none.
    serialization : str
        How its messages are written: `cdr`, `ros1`, or what this package cannot decode.
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
        When the first and the last message were recorded, in nanoseconds; empty without messages.

    """

    connections: list[Connection]
    times: tuple[int, ...]

    def messages(
        self, connections: Collection[Connection]
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield connection, time of record and bytes of the messages of some connections."""

    def close(self) -> None:
        """Close the file."""


class McapStorage:
    """A `Storage` of MCAP; a file without a whole index is read once to find what it holds."""

    def __init__(self, path: Path):
        from mcap.reader import make_reader

        self._file = path.open('rb')
        self._times, self._offsets = array('q'), array('q')  # Of chunks, and messages outside any.
        self._ids: list[Collection[int]] = []  # The channels of a chunk; empty: not known.
        try:
            self._file.seek(-len(_MCAP_MAGIC), SEEK_END)
            if self._file.read() != _MCAP_MAGIC:
                raise ValueError('it does not end as MCAP files do')
            self._file.seek(0)
            summary = make_reader(self._file).get_summary()
            counts, schemas, channels = (
                self._indexed(summary) if summary and _is_whole(summary) else self._scanned()
            )
        except BaseException:
            self._file.close()
            raise
        self.connections = []
        for channel in channels.values():
            schema = schemas.get(channel.schema_id)
            self.connections.append(
                Connection(
                    channel.id,
                    channel.topic,
                    schema.name if schema else '',
                    schema.encoding if schema else '',
                    schema.data.decode(errors='replace') if schema else '',
                    channel.message_encoding,
                    counts.get(channel.id, 0),
                )
            )

    def _indexed(self, summary) -> tuple[dict, dict, dict]:
        """Take what the summary at the end of the file says; return counts, schemas, channels."""
        statistics = summary.statistics
        for chunk in summary.chunk_indexes:
            self._note(chunk.message_start_time, chunk.chunk_start_offset)
            self._ids.append(chunk.message_index_offsets.keys())
        has_messages = statistics.message_count > 0
        bounds = (statistics.message_start_time, statistics.message_end_time)
        self.times = bounds if has_messages else ()
        return statistics.channel_message_counts, summary.schemas, summary.channels

    def _scanned(self) -> tuple[dict, dict, dict]:
        from mcap.records import Channel, Chunk, Message, Schema
        from mcap.stream_reader import StreamReader, breakup_chunk

        self._file.seek(0)
        counts: Counter[int] = Counter()
        schemas, channels = {}, {}
        bounds: list[int] = []
        offset = 0
        for record in StreamReader(self._file, emit_chunks=True).records:
            if isinstance(record, Chunk):
                self._note(record.message_start_time, offset)
                self._ids.append(())
            elif isinstance(record, Message):
                self._note(record.log_time, offset)
                self._ids.append((record.channel_id,))
            for inner in breakup_chunk(record) if isinstance(record, Chunk) else (record,):
                if isinstance(inner, Schema):
                    schemas[inner.id] = inner
                elif isinstance(inner, Channel):
                    channels[inner.id] = inner
                elif isinstance(inner, Message):
                    counts[inner.channel_id] += 1
                    bounds = [*bounds, inner.log_time]
                    bounds = [min(bounds), max(bounds)]
            offset = self._file.tell()
        self.times = tuple(bounds)
        return counts, schemas, channels

    def _note(self, time: int, offset: int) -> None:
        self._times.append(time)
        self._offsets.append(offset)

    def messages(
        self, connections: Collection[Connection]
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield the messages; only chunks that overlap in time are in memory together."""
        wanted = {connection.id: connection for connection in connections}
        waiting: list = []
        numbers = count()
        for place in sorted(range(len(self._times)), key=self._times.__getitem__):
            while waiting and waiting[0][0] < self._times[place]:
                time, _, connection, data = heapq.heappop(waiting)
                yield connection, time, data
            ids = self._ids[place]
            if ids and not any(number in wanted for number in ids):
                continue
            for connection, time, data in self._at(self._offsets[place], wanted):
                heapq.heappush(waiting, (time, next(numbers), connection, data))
        while waiting:
            time, _, connection, data = heapq.heappop(waiting)
            yield connection, time, data

    def _at(self, offset: int, wanted: dict) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield the messages of a chunk, or the one message that stands there."""
        from mcap.data_stream import ReadDataStream
        from mcap.records import Chunk
        from mcap.stream_reader import get_chunk_data_stream

        self._file.seek(offset)
        head = self._file.read(9)
        opcode, size = struct.unpack('<BQ', head)
        if opcode == _MCAP_MESSAGE:
            data = head + self._file.read(size)
        else:
            chunk = Chunk.read(ReadDataStream(self._file))
            stream, length = get_chunk_data_stream(chunk, validate_crc=True)
            data = stream.read(length)
        position = 0
        while position < len(data):  # Records by hand: most are of topics that nobody asked for.
            opcode, size = struct.unpack_from('<BQ', data, position)
            begin, position = position + 9, position + 9 + size
            if opcode == _MCAP_MESSAGE:
                channel, _, time = struct.unpack_from('<HIQ', data, begin)
                if channel in wanted:
                    yield wanted[channel], time, data[begin + 22 : position]

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _is_whole(summary) -> bool:
    """Tell whether an MCAP summary names every channel, schema and chunk of its file."""
    statistics = summary.statistics
    return statistics is not None and (
        statistics.channel_count == len(summary.channels)
        and {c.schema_id for c in summary.channels.values()} <= {0, *summary.schemas}
        and statistics.chunk_count == len(summary.chunk_indexes)
        and (statistics.chunk_count > 0 or statistics.message_count == 0)
    )


class SqliteStorage:
    """A `Storage` of SQLite, .db3."""

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
            raise ValueError('it has no tables topics and messages')
        definitions = {}
        if 'message_definitions' in tables:  # From Iron on.
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
        self.times = () if begin is None else (begin, end)

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
    """A `Storage` of ROS 1, .bag."""

    def __init__(self, path: Path):
        from rosbags.rosbag1 import Reader

        self._reader = Reader(path)
        self._reader.open()
        self.connections = [
            Connection(c.id, c.topic, c.msgtype, 'ros2msg', c.msgdef.data, 'ros1', c.msgcount)
            for c in self._reader.connections
        ]
        has_messages = any(c.msgcount for c in self.connections)
        self.times = (
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
    """A `Storage` whose messages were compressed one by one, with zstd."""

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
