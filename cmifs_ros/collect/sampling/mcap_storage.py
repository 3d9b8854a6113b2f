# SPDX-License-Identifier: Apache-2.0

"""MCAP files: their chunks, and the messages in order of time."""

from __future__ import annotations

import heapq
import struct
from array import array
from collections import Counter
from collections.abc import Collection, Iterator
from io import SEEK_END
from itertools import count
from pathlib import Path

from .storages import Connection

_MESSAGE = 5
_MAGIC = b'\x89MCAP0\r\n'


class McapStorage:
    """A `Storage` for MCAP; a file without a complete index is scanned once."""

    def __init__(self, path: Path):
        from mcap.reader import make_reader

        self._file = path.open('rb')
        # Of chunks, and of messages outside of chunks.
        self._times, self._offsets = array('q'), array('q')
        self.times: tuple[int, ...] = ()
        self._ids: list[Collection[int]] = []  # The channels of a chunk; empty if unknown.
        try:
            self._file.seek(-len(_MAGIC), SEEK_END)
            if self._file.read() != _MAGIC:
                raise ValueError('it does not end like an MCAP file')
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
        """Read the summary at the end of the file; return counts, schemas, channels."""
        statistics = summary.statistics
        for chunk in summary.chunk_indexes:
            self._note(chunk.message_start_time, chunk.chunk_start_offset)
            self._ids.append(chunk.message_index_offsets.keys())
        has_messages = statistics.message_count > 0
        bounds = (statistics.message_start_time, statistics.message_end_time)
        if has_messages:
            self.times = bounds
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
        """Yield the messages; only chunks that overlap in time share the memory."""
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
        """Yield the messages of a chunk, or the single message there."""
        from mcap.data_stream import ReadDataStream
        from mcap.records import Chunk
        from mcap.stream_reader import get_chunk_data_stream

        self._file.seek(offset)
        head = self._file.read(9)
        opcode, size = struct.unpack('<BQ', head)
        if opcode == _MESSAGE:
            data = head + self._file.read(size)
        else:
            chunk = Chunk.read(ReadDataStream(self._file))
            stream, length = get_chunk_data_stream(chunk, validate_crc=True)
            data = stream.read(length)
        position = 0
        # Parsed by hand: most records belong to topics that are not requested.
        while position < len(data):
            opcode, size = struct.unpack_from('<BQ', data, position)
            begin, position = position + 9, position + 9 + size
            if opcode == _MESSAGE:
                channel, _, time = struct.unpack_from('<HIQ', data, begin)
                if channel in wanted:
                    yield wanted[channel], time, data[begin + 22 : position]

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _is_whole(summary) -> bool:
    """Return whether an MCAP summary lists every channel, schema and chunk of its file."""
    statistics = summary.statistics
    return statistics is not None and (
        statistics.channel_count == len(summary.channels)
        and {c.schema_id for c in summary.channels.values()} <= {0, *summary.schemas}
        and statistics.chunk_count == len(summary.chunk_indexes)
        and (statistics.chunk_count > 0 or statistics.message_count == 0)
    )
