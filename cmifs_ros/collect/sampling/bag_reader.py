"""A recorded bag's messages, read, not played: MCAP and db3, and ROS 1.

rosbags is optional: `pip install 'rosbags>=0.11,<0.12'`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

#: rclpy's serialize_message may leave so many bytes at the end, which the middleware ignores.
_MAX_SURPLUS = 16
_MEND = 'one that was cut off is mended by `mcap recover` (MCAP) or `ros2 bag reindex`'


class BagError(Exception):
    """A bag cannot be used; the message says why."""


class Undecoded(NamedTuple):
    """Stands for a message that was not decoded; `cause` is None if it was not wanted."""

    cause: str | None


def unwatched(messages: Iterable, total: int) -> Iterable:
    """Pass messages on."""
    return messages


@contextmanager
def open_bag(path: str | Path) -> Iterator:
    """Open a bag as a reader of rosbags; raise a BagError if it cannot be opened."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise BagError(
            "bags are read by rosbags; install it: pip install 'rosbags>=0.11,<0.12'"
        ) from None
    if not Path(path).exists():
        raise BagError(f'{path} does not exist; expected a bag, a file or a folder')
    try:
        reader = AnyReader([Path(path)], default_typestore=get_typestore(Stores.ROS2_JAZZY))
        reader.open()
    except Exception as error:  # A foreign or torn file breaks its readers in many ways.
        raise BagError(
            f'{path} cannot be read as a bag: {_shown(error)}; expected a folder with its '
            f'metadata.yaml, or a file .mcap, .db3 or .bag; {_MEND}'
        ) from error
    try:
        yield reader
    finally:
        reader.close()


def messages_of(
    reader,
    path: str | Path,
    topics: Collection[str],
    is_wanted: Callable[[str, bytes], bool] = lambda topic, data: True,
) -> Iterator[tuple]:
    """Yield topic, message and time of record of an open bag's messages, in order of time.

    `Undecoded` stands for a message that cannot be decoded, or is not wanted by its topic and
    bytes.
    """
    connections = [c for c in reader.connections if c.topic in topics]
    try:
        for connection, recorded, data in reader.messages(connections):
            is_read = is_wanted(connection.topic, data)
            message = _decoded(reader, data, connection.msgtype) if is_read else Undecoded(None)
            yield connection.topic, message, recorded
    except Exception as error:  # What is raised where this is used does not pass here.
        raise BagError(f'{path} breaks off: {_shown(error)}; {_MEND}') from error


def _decoded(reader, data: bytes, kind: str) -> object:
    try:
        return reader.deserialize(data, kind)
    except Exception as error:  # Foreign bytes break its decoders in many ways.
        cause = f'{kind} cannot be decoded: {_shown(error)}'
    for surplus in range(4, _MAX_SURPLUS + 1, 4):  # Up to 3 more are ignored.
        with suppress(Exception):
            return reader.deserialize(data[:-surplus], kind)
    return Undecoded(cause)


def _shown(error: Exception) -> str:
    return f'{type(error).__name__}: {" ".join(str(error).split())[:300]}'
