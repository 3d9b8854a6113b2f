r"""The file that brings the episodes and the last selection back after a restart.

Format, version 4::

    cmifs_ros episodes 4\n
    {"channels": [...], "lengths": [...], "selection": {...}, "selected_at": ...}\n
    the episodes, oldest first: states (T, v), then rewards (T,), float64, little-endian
    SHA-256 of all that stands before it (32 bytes)
    a record of each episode that was appended since

A record is T (8 bytes, little-endian), the CRC-32 of these (4 bytes), the episode, and the SHA-256
of the record before it (32 bytes). The last one is torn if its writer was killed meanwhile.

The second line is JSON. `lengths` gives the T of each episode before the records; `selection` is
null or what `fields_of` gives, with `means` and `spreads`; `selected_at` is in seconds of Unix
time. Files of versions 2 and 3 differ by their selection, and are read without it. Nothing in it
can run code, and nothing is allocated before its size is known to be within the bounds. Nothing
here knows ROS.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import zlib
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from cmifs_ros.collect.selection_fields import (
    count_of,
    fields_of,
    list_of,
    names_of,
    selection_of,
)
from cmifs_ros.core import Episode
from cmifs_ros.core.channel_names import MAX_CHANNELS
from cmifs_ros.core.selection import Selection
from cmifs_ros.core.words import counted

VERSION = 4
#: What can be read; of the older ones all but the selection.
_READABLE = (2, 3, VERSION)
_MAGIC = b'cmifs_ros episodes '
_MAX_HEADER = 2**25
_MAX_FILE = 2**35
_CHUNK = 2**20
_DIGEST_SIZE = hashlib.sha256().digest_size
_RECORD_HEADER_SIZE = 12
_VALUE = np.dtype('<f8')


class RefusedFileError(ValueError):
    """A file cannot be used; the message, which follows its name, says why."""


@dataclass(frozen=True)
class Saved:
    """What survives a restart.

    Attributes
    ----------
    channel_names : tuple of str or None
        None if no channel is known yet.
    episodes : sequence of Episode
        Oldest first.
    selection : Selection or None
    selected_at : float
        When it was made, in seconds of Unix time; without a selection of no meaning.
    torn_bytes : int
        Of a file that was read: the part that was written of an episode when its writer was killed.

    """

    channel_names: tuple[str, ...] | None
    episodes: Sequence[Episode]
    selection: Selection | None = None
    selected_at: float = 0.0
    torn_bytes: int = 0


class EpisodeFile:
    """A file of episodes: written beside its path, put in its place, then appended to.

    Beside the file itself there is `path` with `.tmp` added, until it is put in place.

    Parameters
    ----------
    path : path-like
    saved : Saved
        What it begins with, which is on the disk itself when the object is made.

    Attributes
    ----------
    channel_names : tuple of str or None
    first_size, size : int
        Bytes at the beginning and now.

    Raises
    ------
    OSError
        If it cannot be written; nothing is left of it then.

    """

    def __init__(self, path: str | os.PathLike, saved: Saved):
        self.channel_names = saved.channel_names
        self._path, self._temporary = os.fspath(path), f'{os.fspath(path)}.tmp'
        Path(self._temporary).unlink(missing_ok=True)  # of a process that was killed
        # O_EXCL follows no link that somebody else has put there.
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
        self._descriptor = os.open(self._temporary, flags, 0o600)
        self.size = 0
        try:
            digest = hashlib.sha256()
            for chunk in _chunks(saved):
                digest.update(chunk)
                self.append(chunk)
            self.append(digest.digest())
            self.sync()
        except BaseException:
            self.discard()
            raise
        self.first_size = self.size

    def append(self, content: bytes) -> None:
        """Add bytes, such as a `record`, to the end: all of them or, with an OSError, none.

        A process that is killed afterwards has not lost them; a machine has, until `sync`.
        """
        try:
            rest = memoryview(content)
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
        except OSError:
            with suppress(OSError):
                os.ftruncate(self._descriptor, self.size)
            raise
        self.size += len(content)

    def sync(self) -> None:
        """Wait until all of it is on the disk itself."""
        os.fsync(self._descriptor)

    def put_in_place(self) -> None:
        """Let it take the place of an older one, at once."""
        os.replace(self._temporary, self._path)

    def close(self) -> None:
        """Append no more."""
        os.close(self._descriptor)

    def discard(self) -> None:
        """Close and remove it, before it was put in place."""
        self.close()
        Path(self._temporary).unlink(missing_ok=True)


def write(path: str | os.PathLike, saved: Saved) -> None:
    """Write a file in the place of another at once, or leave that as it was.

    Raises
    ------
    OSError
        If it cannot be written.

    """
    file = EpisodeFile(path, saved)
    file.put_in_place()
    file.close()
    sync_folder(path)


def sync_folder(path: str | os.PathLike) -> None:
    """Wait until a file that was put in place is so on the disk itself."""
    folder = os.open(os.path.dirname(os.fspath(path)) or '.', os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def record(episode: Episode) -> bytes:
    """Return what appends an episode to a file of its channels."""
    content = b''.join([_record_header(len(episode)), *_arrays(episode)])
    return content + hashlib.sha256(content).digest()


def _record_header(length: int) -> bytes:
    number = length.to_bytes(8, 'little')
    return number + zlib.crc32(number).to_bytes(4, 'little')


def _chunks(saved: Saved) -> Iterator[bytes]:
    """Yield what a file begins with in large pieces, without the checksum.

    To hash and write these leaves the interpreter to other threads, while each small one would
    take it from them.
    """
    selection = saved.selection
    header = {
        'channels': saved.channel_names or (),
        'lengths': [len(episode) for episode in saved.episodes],
        'selection': selection
        and fields_of(selection) | {'means': selection.means, 'spreads': selection.spreads},
        'selected_at': saved.selected_at,
    }
    parts: list[bytes | memoryview]
    parts, size = [_MAGIC + b'%d\n' % VERSION, json.dumps(header).encode(), b'\n'], 0
    for episode in saved.episodes:
        parts += _arrays(episode)
        size += episode.nbytes
        if size >= _CHUNK:
            yield b''.join(parts)
            parts, size = [], 0
    yield b''.join(parts)


def _arrays(episode: Episode) -> list[bytes | memoryview]:
    return [np.ascontiguousarray(v, _VALUE).data for v in (episode.states, episode.rewards)]


def read(path: str | os.PathLike, max_episodes: int, max_bytes: int) -> Saved:
    """Return what a file holds; of its episodes the newest within the bounds.

    Parameters
    ----------
    path : path-like
    max_episodes : int
    max_bytes : int
        Greatest size of the episodes' arrays together.

    Raises
    ------
    RefusedFileError
        If it is no such file, of another version, or damaged.
    OSError
        If it cannot be read; FileNotFoundError if there is none.

    """
    with open(path, 'rb') as file:
        size = os.fstat(file.fileno()).st_size
        if size > _MAX_FILE:
            raise RefusedFileError(f'has {size} bytes; expected at most {_MAX_FILE}')
        version = _version(file.readline(len(_MAGIC) + 16))
        line = file.readline(_MAX_HEADER + 1)
        if not line.endswith(b'\n'):
            raise RefusedFileError(f'is truncated, or its header has more than {_MAX_HEADER} bytes')
        try:
            header = json.loads(line)
            channel_names = names_of(header['channels'], MAX_CHANNELS)
            lengths = [count_of(length, 1) for length in list_of(header['lengths'])]
            selection = None
            if version == VERSION and header['selection'] is not None:
                selection = selection_of(header['selection'])
                if not selection.names:
                    raise ValueError('a selection of nothing')
            selected_at = float(header['selected_at'])
        except (ValueError, TypeError, KeyError, RecursionError, OverflowError) as error:
            raise RefusedFileError(f'has a header that cannot be used: {error!r}') from None
        step_size = _VALUE.itemsize * (len(channel_names) + 1)
        end = file.tell() + step_size * sum(lengths)
        if size < end + _DIGEST_SIZE:
            raise RefusedFileError(
                f'is truncated: it has {size} bytes; expected at least {end + _DIGEST_SIZE}'
            )
        if lengths and not channel_names:
            raise RefusedFileError(f'has {counted(len(lengths), "episode")} without channels')
        # The first byte and the length of each episode.
        places: deque[tuple[int, int]] = deque(maxlen=max_episodes)
        begin = file.tell()
        for length in lengths:
            places.append((begin, length))
            begin += step_size * length
        _check_digest(file, 0, end)
        end += _DIGEST_SIZE
        while (found := _next_record(file, end, size, step_size)) is not None:
            places.append((end + _RECORD_HEADER_SIZE, found))
            end += _RECORD_HEADER_SIZE + step_size * found + _DIGEST_SIZE
        try:
            episodes = _newest(file, places, len(channel_names), max_bytes)
        except ValueError as error:
            raise RefusedFileError(f'has an episode that cannot be used: {error}') from None
    return Saved(channel_names or None, episodes, selection, selected_at, torn_bytes=size - end)


def set_aside(path: str | os.PathLike) -> str:
    """Rename a file to a free name beside it and return that.

    Raises
    ------
    OSError
        If it cannot be renamed.

    """
    path = os.fspath(path)
    aside = f'{path}.refused'
    for number in itertools.count(1):
        if not os.path.lexists(aside):
            break
        aside = f'{path}.refused-{number}'
    os.rename(path, aside)
    return aside


def _version(line: bytes) -> int:
    if not line.startswith(_MAGIC) or not line.endswith(b'\n'):
        raise RefusedFileError('is no episodes file of cmifs_ros')
    version = line[len(_MAGIC) : -1].decode('ascii', 'replace')
    if version not in map(str, _READABLE):
        raise RefusedFileError(f'is of format version {version}; expected {VERSION}')
    return int(version)


def _check_digest(file: BinaryIO, begin: int, end: int) -> None:
    digest = hashlib.sha256()
    file.seek(begin)
    while chunk := file.read(min(_CHUNK, end - file.tell())):
        digest.update(chunk)
    if file.read(_DIGEST_SIZE) != digest.digest():
        raise RefusedFileError(f'is corrupt: the checksum of its bytes {begin} to {end} differs')


def _next_record(file: BinaryIO, begin: int, size: int, step_size: int) -> int | None:
    """Return the length of the episode of a record, or None if there is no whole one."""
    if size < begin + _RECORD_HEADER_SIZE:
        return None
    file.seek(begin)
    header = file.read(_RECORD_HEADER_SIZE)
    length = int.from_bytes(header[:8], 'little')
    if header != _record_header(length) or length < 1 or step_size == _VALUE.itemsize:
        raise RefusedFileError(f'is corrupt: at byte {begin} there is no record of an episode')
    end = begin + _RECORD_HEADER_SIZE + step_size * length
    if size < end + _DIGEST_SIZE:
        return None
    _check_digest(file, begin, end)
    return length


def _newest(
    file: BinaryIO, places: Sequence[tuple[int, int]], num_channels: int, max_bytes: int
) -> list[Episode]:
    episodes: list[Episode] = []
    for begin, length in reversed(places):
        nbytes = _VALUE.itemsize * (num_channels + 1) * length
        max_bytes -= nbytes
        if max_bytes < 0:
            break
        file.seek(begin)
        values = np.frombuffer(file.read(nbytes), _VALUE)
        states, rewards = np.split(values, [length * num_channels])
        episodes.append(Episode(states.reshape(length, num_channels), rewards))
    return episodes[::-1]
