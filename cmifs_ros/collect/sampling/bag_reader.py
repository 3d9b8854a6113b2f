# SPDX-License-Identifier: Apache-2.0

"""Read the messages of a bag (MCAP, db3 or ROS 1) without playing it.

rosbags and mcap are optional: `pip install 'rosbags>=0.11,<0.12' mcap`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import NamedTuple

import yaml

from cmifs_ros.collect.recorded_episodes import RecordingError

from .mcap_storage import McapStorage
from .message_types import MessageTypes, RosbagsTypes, shown
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
    types : MessageTypes
    num_messages, num_bytes : dict of str to int
        Numbers of messages and bytes read, by topic.

    """

    def __init__(self, storages: list[Storage], types: Callable[[list[Connection]], MessageTypes]):
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
        self.types = types(self.connections)
        self.unreadable = self.types.unreadable
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


def has_rosbags() -> bool:
    """Return whether the packages that `open_bag` needs are installed."""
    return all(find_spec(package) is not None for package in ('rosbags', 'mcap'))


#: A function that opens a bag, like `open_bag`.
OpenBag = Callable[[str | Path], AbstractContextManager[BagReader]]


def open_bag(path: str | Path) -> AbstractContextManager[BagReader]:
    """Open a bag, a file or a folder, by rosbags; raise BagError if it cannot be opened."""
    if not has_rosbags():
        raise BagError("bags need rosbags and mcap: pip install 'rosbags>=0.11,<0.12' mcap")
    return opened(path, storages_of, RosbagsTypes)


@contextmanager
def opened(
    path: str | Path,
    storages: Callable[[Path, ExitStack], list[Storage]],
    types: Callable[[list[Connection]], MessageTypes],
) -> Iterator[BagReader]:
    """Open a bag with given readers of files and messages; raise BagError if that fails.

    Parameters
    ----------
    path : path
    storages : callable
        As `storages_of`.
    types : callable
        Returns the message types of the given topics.

    """
    path = Path(path)
    if not path.exists():
        raise BagError(f'{path} does not exist; expected a bag, a file or a folder')
    with ExitStack() as stack:
        try:
            reader = BagReader(storages(path, stack), types)
        except PermissionError as error:
            raise BagError(f'{error.filename} cannot be read: {error.strerror}') from error
        except Exception as error:  # Invalid files make the readers raise almost anything.
            raise BagError(
                f'{path} cannot be read as a bag: {shown(error)}; expected a folder with its '
                f'metadata.yaml, or a file .mcap, .db3 or .bag; {_MEND}'
            ) from error
        yield reader


def storages_of(path: Path, stack: ExitStack) -> list[Storage]:
    """Open the files of a bag, in order; the stack closes them."""
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
        raise BagError(f'{path} ends early: {shown(error)}; {_MEND}') from error


def _decoded(reader: BagReader, connection: Connection, data: bytes) -> object:
    if connection.topic in reader.unreadable:
        return Undecoded(reader.unreadable[connection.topic])
    try:
        return reader.types.decode(connection, data)
    except Exception as error:  # Invalid bytes make the decoders raise almost anything.
        cause = f'{connection.msgtype} cannot be decoded: {shown(error)}'
    for surplus in range(4, _MAX_SURPLUS + 1, 4):  # Up to 3 further bytes are ignored.
        with suppress(Exception):
            return reader.types.decode(connection, data[:-surplus])
    return Undecoded(cause)
