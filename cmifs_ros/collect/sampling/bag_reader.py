# SPDX-License-Identifier: Apache-2.0

"""Read the messages of a bag (MCAP, db3 or ROS 1) without playing it.

rosbags and mcap are optional: `pip install 'rosbags>=0.11,<0.12' mcap`.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import yaml

from cmifs_ros.collect.recorded_episodes import RecordingError

from .mcap_storage import McapStorage
from .storages import (
    CompressedMessages,
    Connection,
    Ros1Storage,
    SqliteStorage,
    Storage,
)

#: rclpy's serialize_message may append this many bytes, which the middleware ignores.
_MAX_SURPLUS = 16
_MEND = 'repair a truncated bag with `mcap recover` (MCAP) or `ros2 bag reindex`'
#: Supported serialisation formats.
_DECODED = ('cdr', 'ros1')
#: Separator of the types in a definition.
_IDL = re.compile(r'(?m)^=+\nIDL: .*\n')
_STORAGES: dict[str, Callable[[Path], Storage]] = {
    '.mcap': McapStorage,
    '.db3': SqliteStorage,
    '.bag': Ros1Storage,
}


class BagError(RecordingError):
    """A bag cannot be used; the message says why."""


class Undecoded(NamedTuple):
    """A message that was not decoded; `cause` is None if it was not requested."""

    cause: str | None


class Topic(NamedTuple):
    """A topic of a bag: its type, its number of messages, and their connections."""

    msgtype: str
    msgcount: int
    connections: list[Connection]


def unwatched(messages: Iterable, total: int) -> Iterable:
    """Pass messages on."""
    return messages


class BagReader:
    """An open bag.

    Attributes
    ----------
    topics : dict of str to Topic
    duration : int
        Time from the first to the last message, in nanoseconds.
    unreadable : dict of str to str
        By topic, why its messages cannot be decoded. The other topics remain readable.
    typestore
        The message types, in the form of rosbags.
    num_messages, num_bytes : dict of str to int
        Numbers of messages and bytes read, by topic.

    """

    def __init__(self, storages: list[Storage]):
        self._storages = storages
        found: dict[str, list[Connection]] = {}
        for storage in storages:
            for connection in storage.connections:
                found.setdefault(connection.topic, []).append(connection)
        self.topics = {
            topic: Topic(parts[0].msgtype, sum(part.msgcount for part in parts), parts)
            for topic, parts in sorted(found.items())
        }
        times = [time for storage in storages for time in storage.times]
        self.duration = max(times, default=0) - min(times, default=0)
        self.typestore, self.unreadable = _typestore(self.connections)
        self.num_messages, self.num_bytes = Counter[str](), Counter[str]()

    @property
    def connections(self) -> list[Connection]:
        """Every topic of every file."""
        return [c for storage in self._storages for c in storage.connections]

    def messages(self, topics: Collection[str]) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield connection, recording time and bytes of the messages of some topics."""
        for storage in self._storages:
            wanted = [c for c in storage.connections if c.topic in topics]
            for connection, recorded, data in storage.messages(wanted) if wanted else ():
                self.num_messages[connection.topic] += 1
                self.num_bytes[connection.topic] += len(data)
                yield connection, recorded, data

    def decode(self, connection: Connection, data: bytes) -> object:
        """Decode a message; pass on any exception of its decoder."""
        if connection.serialization == 'ros1':
            return self.typestore.deserialize_ros1(data, connection.msgtype)
        return self.typestore.deserialize_cdr(data, connection.msgtype)


@contextmanager
def open_bag(path: str | Path) -> Iterator[BagReader]:
    """Open a bag, a file or a folder; raise BagError if it cannot be opened."""
    if any(find_spec(package) is None for package in ('rosbags', 'mcap')):
        raise BagError("bags need rosbags and mcap: pip install 'rosbags>=0.11,<0.12' mcap")
    path = Path(path)
    if not path.exists():
        raise BagError(f'{path} does not exist; expected a bag, a file or a folder')
    with ExitStack() as stack:
        try:
            storages = _storages(path, stack)
            reader = BagReader(storages)
        except Exception as error:  # Invalid files make the readers raise almost anything.
            raise BagError(
                f'{path} cannot be read as a bag: {_shown(error)}; expected a folder with its '
                f'metadata.yaml, or a file .mcap, .db3 or .bag; {_MEND}'
            ) from error
        yield reader


def _storages(path: Path, stack: ExitStack) -> list[Storage]:
    """Open the files of a bag, in order."""
    if path.is_file():
        return [_opened(path, stack)]
    about = yaml.safe_load((path / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    files = [path / PurePath(name).name for name in about['relative_file_paths']]
    compression = str(about.get('compression_mode') or '').lower()
    if compression == 'file':
        folder = stack.enter_context(TemporaryDirectory())
        files = [_decompressed(file, Path(folder)) for file in files]
    storages = [_opened(file, stack) for file in files]
    return list(map(CompressedMessages, storages)) if compression == 'message' else storages


def _opened(file: Path, stack: ExitStack) -> Storage:
    if file.suffix not in _STORAGES:
        raise ValueError(f'{file.name} is none of {", ".join(_STORAGES)}')
    storage = _STORAGES[file.suffix](file)
    stack.callback(storage.close)
    return storage


def _decompressed(file: Path, folder: Path) -> Path:
    from zstandard import ZstdDecompressor

    with file.open('rb') as source, (folder / file.stem).open('wb') as target:
        ZstdDecompressor().copy_stream(source, target)
    return folder / file.stem


def _typestore(connections: Iterable[Connection]) -> tuple[Any, dict[str, str]]:
    """Return the types of a bag, and by topic why messages cannot be decoded."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    jazzy = get_typestore(Stores.ROS2_JAZZY).fielddefs
    types: dict = {}
    causes: dict[str, str] = {}
    for connection in connections:
        kind, encoding, text = connection.msgtype, connection.encoding, connection.definition
        if connection.serialization not in _DECODED:
            causes[connection.topic] = (
                f'its messages are {connection.serialization or "in an unknown format"}; '
                f'expected {" or ".join(_DECODED)}'
            )
        elif kind in types:
            continue
        elif not text.strip():  # Files before Iron have none; it is empty for an empty message.
            if kind not in jazzy:
                causes[connection.topic] = f'the bag does not define its type {kind or "at all"}'
        else:
            try:
                if encoding == 'ros2msg':
                    found = get_types_from_msg(text, kind)
                else:
                    found = {}
                    for part in _IDL.split(text):
                        found |= get_types_from_idl(part) if part.strip() else {}
                get_typestore(Stores.EMPTY).register(found)
                types |= found
            except Exception as error:  # Invalid texts make the parsers raise almost anything.
                causes[connection.topic] = f'its type {kind} cannot be read: {_shown(error)}'
    typestore = get_typestore(Stores.EMPTY)
    typestore.register({**jazzy, **types})
    return typestore, causes


def messages_of(
    reader: BagReader,
    path: str | Path,
    topics: Collection[str],
    is_wanted: Callable[[str, bytes], bool] = lambda topic, data: True,
) -> Iterator[tuple]:
    """Yield topic, message and recording time of an open bag's messages, in order of time.

    A message that cannot be decoded, or is not wanted, comes as `Undecoded`.
    """
    try:
        for connection, recorded, data in reader.messages(topics):
            is_read = is_wanted(connection.topic, data)
            message = _decoded(reader, connection, data) if is_read else Undecoded(None)
            yield connection.topic, message, recorded
    except Exception as error:  # Exceptions raised by the consumer do not pass here.
        raise BagError(f'{path} ends early: {_shown(error)}; {_MEND}') from error


def _decoded(reader: BagReader, connection: Connection, data: bytes) -> object:
    if connection.topic in reader.unreadable:
        return Undecoded(reader.unreadable[connection.topic])
    try:
        return reader.decode(connection, data)
    except Exception as error:  # Invalid bytes make the decoders raise almost anything.
        cause = f'{connection.msgtype} cannot be decoded: {_shown(error)}'
    for surplus in range(4, _MAX_SURPLUS + 1, 4):  # Up to 3 further bytes are ignored.
        with suppress(Exception):
            return reader.decode(connection, data[:-surplus])
    return Undecoded(cause)


def _shown(error: Exception) -> str:
    return f'{type(error).__name__}: {" ".join(str(error).split())[:300]}'
