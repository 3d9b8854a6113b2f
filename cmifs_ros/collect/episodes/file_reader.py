"""Reads the file of episodes; `file_format` says what is in it."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections import deque
from collections.abc import Sequence
from typing import BinaryIO

import numpy as np

from cmifs_ros.collect import selection_fields
from cmifs_ros.collect.selection_fields import count_of, list_of, names_of, selection_of
from cmifs_ros.core import Episode
from cmifs_ros.core.channel_names import MAX_CHANNELS
from cmifs_ros.core.words import counted

from .file_format import (
    CHUNK,
    DIGEST_SIZE,
    MAGIC,
    MAX_FILE,
    MAX_HEADER,
    READABLE,
    RECORD_HEADER_SIZE,
    VALUE,
    VERSION,
    Saved,
    record_header,
)


class RefusedFileError(ValueError):
    """A file cannot be used; the message names it and says why."""


def read_episodes(
    path: str | os.PathLike, max_episodes: int | None = None, max_bytes: float = math.inf
) -> Saved:
    """Return what a file holds; of its episodes the newest within the bounds.

    Parameters
    ----------
    path : path-like
        `~` is the user's home folder.
    max_episodes : int, optional
        None: all there are.
    max_bytes : float
        Greatest size of the episodes' arrays together.

    Raises
    ------
    RefusedFileError
        If it is no such file, of another version, or damaged.
    OSError
        If it cannot be read; FileNotFoundError if there is none.

    """
    try:
        with open(os.path.expanduser(path), 'rb') as file:
            return _read(file, max_episodes, max_bytes)
    except RefusedFileError as error:
        raise RefusedFileError(f'{os.fspath(path)} {error}') from None


def _read(file: BinaryIO, max_episodes: int | None, max_bytes: float) -> Saved:
    size = os.fstat(file.fileno()).st_size
    if size > MAX_FILE:
        raise RefusedFileError(f'has {size} bytes; expected at most {MAX_FILE}')
    version = _version(file.readline(len(MAGIC) + 16))
    line = file.readline(MAX_HEADER + 1)
    if not line.endswith(b'\n'):
        raise RefusedFileError(f'is truncated, or its header has more than {MAX_HEADER} bytes')
    try:
        header = json.loads(line)
        channel_names = names_of(header['channels'], MAX_CHANNELS)
        lengths = [count_of(length, 1) for length in list_of(header['lengths'])]
        selection, fields = None, header['selection']
        is_read = version == VERSION and fields is not None
        if is_read and fields['version'] == selection_fields.VERSION:
            selection = selection_of(fields)
            if not selection.names:
                raise ValueError('a selection of nothing')
        selected_at = float(header['selected_at'])
    except (ValueError, TypeError, KeyError, RecursionError, OverflowError) as error:
        raise RefusedFileError(f'has a header that cannot be used: {error!r}') from None
    step_size = VALUE.itemsize * (len(channel_names) + 1)
    end = file.tell() + step_size * sum(lengths)
    if size < end + DIGEST_SIZE:
        raise RefusedFileError(
            f'is truncated: it has {size} bytes; expected at least {end + DIGEST_SIZE}'
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
    end += DIGEST_SIZE
    while (found := _next_record(file, end, size, step_size)) is not None:
        places.append((end + RECORD_HEADER_SIZE, found))
        end += RECORD_HEADER_SIZE + step_size * found + DIGEST_SIZE
    try:
        episodes = _newest(file, places, len(channel_names), max_bytes)
    except ValueError as error:
        raise RefusedFileError(f'has an episode that cannot be used: {error}') from None
    return Saved(channel_names or None, episodes, selection, selected_at, torn_bytes=size - end)


def _version(line: bytes) -> int:
    if not line.startswith(MAGIC) or not line.endswith(b'\n'):
        raise RefusedFileError('is no episodes file of cmifs_ros')
    version = line[len(MAGIC) : -1].decode('ascii', 'replace')
    if version not in map(str, READABLE):
        raise RefusedFileError(f'is of format version {version}; expected {VERSION}')
    return int(version)


def _check_digest(file: BinaryIO, begin: int, end: int) -> None:
    digest = hashlib.sha256()
    file.seek(begin)
    while chunk := file.read(min(CHUNK, end - file.tell())):
        digest.update(chunk)
    if file.read(DIGEST_SIZE) != digest.digest():
        raise RefusedFileError(f'is corrupt: the checksum of its bytes {begin} to {end} differs')


def _next_record(file: BinaryIO, begin: int, size: int, step_size: int) -> int | None:
    """Return the length of the episode of a record, or None if there is no whole one."""
    if size < begin + RECORD_HEADER_SIZE:
        return None
    file.seek(begin)
    header = file.read(RECORD_HEADER_SIZE)
    length = int.from_bytes(header[:8], 'little')
    if header != record_header(length) or length < 1 or step_size == VALUE.itemsize:
        raise RefusedFileError(f'is corrupt: at byte {begin} there is no record of an episode')
    end = begin + RECORD_HEADER_SIZE + step_size * length
    if size < end + DIGEST_SIZE:
        return None
    _check_digest(file, begin, end)
    return length


def _newest(
    file: BinaryIO, places: Sequence[tuple[int, int]], num_channels: int, max_bytes: float
) -> list[Episode]:
    episodes: list[Episode] = []
    for begin, length in reversed(places):
        nbytes = VALUE.itemsize * (num_channels + 1) * length
        max_bytes -= nbytes
        if max_bytes < 0:
            break
        file.seek(begin)
        values = np.frombuffer(file.read(nbytes), VALUE)
        states, rewards = np.split(values, [length * num_channels])
        episodes.append(Episode(states.reshape(length, num_channels), rewards))
    return episodes[::-1]
