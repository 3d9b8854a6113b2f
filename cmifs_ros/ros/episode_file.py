r"""The file that brings the episodes and the last selection back after a restart.

Format, version 1::

    cmifs_ros episodes 1\n
    {"channels": [...], "lengths": [...], "selection": {...}, "selected_at": ...}\n
    the episodes, oldest first: states (T, v), then rewards (T,), float64, little-endian
    SHA-256 of all that stands before it (32 bytes)

The second line is JSON. `lengths` gives the T of each episode; `selection` is null or the fields
of `Selection`; `selected_at` is in seconds of Unix time. Nothing in it can run code, and nothing
is allocated before its size is known to be within the bounds. Nothing here knows ROS.
"""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from cmifs_ros.core import Episode
from cmifs_ros.core.selection import Selection

from .transitions import MAX_CHANNELS, MAX_NAME_LENGTH

VERSION = 1
_MAGIC = b'cmifs_ros episodes '
_MAX_HEADER = 2**25
_MAX_FILE = 2**35
_CHUNK = 2**20
_DIGEST_SIZE = hashlib.sha256().digest_size
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

    """

    channel_names: tuple[str, ...] | None
    episodes: Sequence[Episode]
    selection: Selection | None = None
    selected_at: float = 0.0


def write(path: str | os.PathLike, saved: Saved) -> int:
    """Put a file in the place of another at once, or leave that as it was; return the bytes.

    Beside the file itself, `path` with `.tmp` added is written, and gone afterwards.

    Raises
    ------
    OSError
        If it cannot be written.

    """
    path, temporary = os.fspath(path), f'{os.fspath(path)}.tmp'
    Path(temporary).unlink(missing_ok=True)  # of a process that was killed
    # O_EXCL follows no link that somebody else has put there.
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
    try:
        with os.fdopen(descriptor, 'wb', buffering=_CHUNK) as file:
            _write(file, saved)
            file.flush()
            os.fsync(file.fileno())
            size = file.tell()
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    folder = os.open(os.path.dirname(path) or '.', os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
    return size


def _write(file: BinaryIO, saved: Saved) -> None:
    header = {
        'channels': saved.channel_names or (),
        'lengths': [len(episode) for episode in saved.episodes],
        'selection': saved.selection and dataclasses.asdict(saved.selection),
        'selected_at': saved.selected_at,
    }
    digest = hashlib.sha256()
    for chunk in _chunks(json.dumps(header).encode(), saved.episodes):
        digest.update(chunk)
        file.write(chunk)
    file.write(digest.digest())


def _chunks(header: bytes, episodes: Sequence[Episode]) -> Iterator[bytes]:
    """Yield the file's content in large pieces.

    To hash and write these leaves the interpreter to other threads, while each small one would
    take it from them.
    """
    parts, size = [_MAGIC + b'%d\n' % VERSION, header, b'\n'], 0
    for episode in episodes:
        parts += (np.ascontiguousarray(v, _VALUE).data for v in (episode.states, episode.rewards))
        size += episode.nbytes
        if size >= _CHUNK:
            yield b''.join(parts)
            parts, size = [], 0
    yield b''.join(parts)


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
        _check_version(file.readline(len(_MAGIC) + 16))
        begin = file.tell()
        _check_digest(file, size - _DIGEST_SIZE)
        file.seek(begin)
        line = file.readline(_MAX_HEADER + 1)
        if len(line) > _MAX_HEADER:
            raise RefusedFileError(f'has a header of more than {_MAX_HEADER} bytes')
        try:
            header = json.loads(line)
            channel_names = _names(header['channels'], MAX_CHANNELS)
            lengths = [_count(length, 1) for length in _list(header['lengths'])]
            selection = _selection(header['selection'])
            selected_at = float(header['selected_at'])
        except (ValueError, TypeError, KeyError, RecursionError, OverflowError) as error:
            raise RefusedFileError(f'has a header that cannot be used: {error!r}') from None
        width = len(channel_names) + 1
        end = file.tell() + _VALUE.itemsize * width * sum(lengths) + _DIGEST_SIZE
        if size != end or (lengths and not channel_names):
            raise RefusedFileError(f'has {size} bytes; expected {end} after its header')
        try:
            episodes = _newest(
                file,
                end - _DIGEST_SIZE,
                lengths,
                width,
                max_episodes=max_episodes,
                max_bytes=max_bytes,
            )
        except ValueError as error:
            raise RefusedFileError(f'has an episode that cannot be used: {error}') from None
    return Saved(channel_names or None, episodes, selection, selected_at)


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


def _check_version(line: bytes) -> None:
    if not line.startswith(_MAGIC) or not line.endswith(b'\n'):
        raise RefusedFileError('is no episodes file of cmifs_ros')
    version = line[len(_MAGIC) : -1].decode('ascii', 'replace')
    if version != str(VERSION):
        raise RefusedFileError(f'is of format version {version}; expected {VERSION}')


def _check_digest(file: BinaryIO, end: int) -> None:
    digest = hashlib.sha256()
    file.seek(0)
    while chunk := file.read(max(0, min(_CHUNK, end - file.tell()))):
        digest.update(chunk)
    if file.read(_DIGEST_SIZE) != digest.digest():
        raise RefusedFileError('is truncated or corrupt: its checksum differs')


def _newest(
    file: BinaryIO,
    end: int,
    lengths: list[int],
    width: int,
    *,
    max_episodes: int,
    max_bytes: int,
) -> list[Episode]:
    episodes: list[Episode] = []
    for length in lengths[: -max_episodes - 1 : -1]:
        nbytes = _VALUE.itemsize * width * length
        max_bytes -= nbytes
        if max_bytes < 0:
            break
        end -= nbytes
        file.seek(end)
        values = np.frombuffer(file.read(nbytes), _VALUE)
        states, rewards = np.split(values, [length * (width - 1)])
        episodes.append(Episode(states.reshape(length, width - 1), rewards))
    return episodes[::-1]


def _selection(fields: dict | None) -> Selection | None:
    if fields is None:
        return None
    selection = Selection(
        indices=tuple(_count(index) for index in _list(fields['indices'])),
        names=_names(fields['names'], MAX_CHANNELS),
        ranking=_names(fields['ranking'], MAX_CHANNELS),
        scores=tuple(float(score) for score in _list(fields['scores'])),
        episodes=_count(fields['episodes']),
        steps=_count(fields['steps']),
        seconds=float(fields['seconds']),
        means=tuple(float(mean) for mean in _list(fields['means'])),
        spreads=tuple(float(spread) for spread in _list(fields['spreads'])),
    )
    if len(selection.means) != len(selection.spreads):
        raise ValueError(f'{len(selection.means)} means for {len(selection.spreads)} spreads')
    if not 0 < len(selection.names) == len(selection.indices) <= MAX_CHANNELS:
        raise ValueError(f'{len(selection.indices)} indices for {len(selection.names)} names')
    if len(selection.scores) != len(selection.ranking):
        raise ValueError(f'{len(selection.scores)} scores for {len(selection.ranking)} sensors')
    if max(selection.indices) >= MAX_CHANNELS:
        raise ValueError(f'index {max(selection.indices)}; expected less than {MAX_CHANNELS}')
    return selection


def _list(value) -> list:
    if not isinstance(value, list):
        raise TypeError(f'{type(value).__name__} in place of a list')
    return value


def _count(value, least: int = 0) -> int:
    if type(value) is not int or value < least:
        raise ValueError(f'{value!r} in place of an integer of at least {least}')
    return value


def _names(value, most: int) -> tuple[str, ...]:
    names = tuple(_list(value))
    if len(names) > most or len(set(names)) < len(names):
        raise ValueError(f'{len(names)} names; expected at most {most}, all different')
    if not all(isinstance(name, str) and 0 < len(name) <= MAX_NAME_LENGTH for name in names):
        raise ValueError(f'a name that is no text of 1 to {MAX_NAME_LENGTH} characters')
    return names
