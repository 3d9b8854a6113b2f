# SPDX-License-Identifier: Apache-2.0

"""Read the file of episodes; `file_format` describes it."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections import deque
from collections.abc import Sequence
from typing import BinaryIO, NamedTuple

import numpy as np

from cmifs_ros.collect import selection_fields
from cmifs_ros.collect.json_values import count_of, list_of, names_of
from cmifs_ros.collect.selection_fields import selection_of
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
    VALUE,
    VERSION,
    WITH_ACTIONS,
    RecordHeader,
    Saved,
    record_header_size,
)


class RefusedFileError(ValueError):
    """A file is unusable; the message names it and says why."""


def read_episodes(
    path: str | os.PathLike, max_episodes: int | None = None, max_bytes: float = math.inf
) -> Saved:
    """Return the contents of a file, with the newest episodes within the bounds.

    Parameters
    ----------
    path : path-like
        `~` is the user's home folder.
    max_episodes : int, optional
        None: all.
    max_bytes : float
        Greatest total size of the episodes' arrays.

    Raises
    ------
    RefusedFileError
        If it is not such a file, has another version, or is damaged.
    OSError
        If it cannot be read; FileNotFoundError if it does not exist.

    """
    try:
        with open(os.path.expanduser(path), 'rb') as file:
            return _read(file, max_episodes, max_bytes)
    except RefusedFileError as error:
        raise RefusedFileError(f'{os.fspath(path)} {error}') from None


class _Place(NamedTuple):
    """The place of an episode: its first byte and its shape."""

    begin: int
    length: int
    num_actions: int = 0
    source: str = ''
    renewals: float = 0.0

    def nbytes(self, num_channels: int) -> int:
        """Return the size of its arrays."""
        return VALUE.itemsize * (num_channels + 1 + self.num_actions) * self.length


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
        action_names = names_of(header['actions'], MAX_CHANNELS) if version >= WITH_ACTIONS else ()
        described = _described(header, version, len(action_names))
        selection, fields = None, header['selection']
        is_read = version >= WITH_ACTIONS and fields is not None
        if is_read and fields['version'] == selection_fields.VERSION:
            selection = selection_of(fields)
            if not (selection.names and channel_names):
                raise ValueError('a selection without channels')
        selected_at = float(header['selected_at'])
        renewals = float(header['renewals']) if version == VERSION else 0.0
        if not 0 <= renewals < math.inf:
            raise ValueError(f'renewals {renewals}')
    except (ValueError, TypeError, LookupError, RecursionError, OverflowError) as error:
        raise RefusedFileError(f'has an invalid header: {error!r}') from None
    if described and not channel_names:
        raise RefusedFileError(f'has {counted(len(described), "episode")} without channels')
    places: deque[_Place] = deque(maxlen=max_episodes)
    end = file.tell()
    for length, num_actions, source in described:
        place = _Place(end, length, num_actions, source)
        places.append(place)
        end += place.nbytes(len(channel_names))
    if size < end + DIGEST_SIZE:
        raise RefusedFileError(
            f'is truncated: it has {size} bytes; expected at least {end + DIGEST_SIZE}'
        )
    _check_digest(file, 0, end)
    end += DIGEST_SIZE
    while found := _next_record(file, version, len(channel_names), len(action_names)):
        places.append(found)
        renewals = max(renewals, found.renewals)
        end = file.tell()
    try:
        episodes = _newest(file, places, len(channel_names), max_bytes)
    except ValueError as error:
        raise RefusedFileError(f'has an invalid episode: {error}') from None
    torn_bytes = size - end
    return Saved(
        channel_names or None, episodes, selection, selected_at, torn_bytes, action_names, renewals
    )


def _described(header: dict, version: int, num_actions: int) -> list[tuple[int, int, str]]:
    """Return length, number of action values and source of each episode before the records."""
    if version < WITH_ACTIONS:
        return [(count_of(length, 1), 0, '') for length in list_of(header['lengths'])]
    sources = list_of(header['sources'])
    if not all(isinstance(source, str) for source in sources):
        raise ValueError('a source that is not a text')
    described = []
    for item in list_of(header['episodes']):
        length, actions, source = map(count_of, list_of(item))
        if actions not in (0, num_actions):
            raise ValueError(f'an episode with {counted(actions, "action")} of {num_actions}')
        described.append((count_of(length, 1), actions, sources[source]))
    return described


def _version(line: bytes) -> int:
    if not line.startswith(MAGIC) or not line.endswith(b'\n'):
        raise RefusedFileError('is not an episodes file of cmifs_ros')
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


def _next_record(
    file: BinaryIO, version: int, num_channels: int, num_actions: int
) -> _Place | None:
    """Return the place of the episode in the record that begins here; None if incomplete."""
    header_size, size = record_header_size(version), os.fstat(file.fileno()).st_size
    begin = file.tell()
    if size < begin + header_size:
        return None
    content = file.read(header_size)
    header = RecordHeader.unpacked(content, version)
    if (
        content != header.packed(version)
        or header.length < 1
        or not num_channels
        or header.num_actions not in (0, num_actions)
        or not 0 <= header.renewals < math.inf
    ):
        raise RefusedFileError(f'is corrupt: at byte {begin} there is no record of an episode')
    place = _Place(begin + header_size + header.source_size, header.length, header.num_actions)
    end = place.begin + place.nbytes(num_channels)
    if size < end + DIGEST_SIZE:
        return None
    source = file.read(header.source_size).decode(errors='surrogateescape')
    _check_digest(file, begin, end)
    return place._replace(source=source, renewals=header.renewals)


def _newest(
    file: BinaryIO, places: Sequence[_Place], num_channels: int, max_bytes: float
) -> list[Episode]:
    episodes: list[Episode] = []
    for place in reversed(places):
        nbytes, length = place.nbytes(num_channels), place.length
        max_bytes -= nbytes
        if max_bytes < 0:
            break
        file.seek(place.begin)
        values = np.frombuffer(file.read(nbytes), VALUE)
        states, rewards, actions = np.split(
            values, [length * num_channels, length * (num_channels + 1)]
        )
        episodes.append(
            Episode(
                states.reshape(length, num_channels),
                rewards,
                actions.reshape(length, place.num_actions),
                place.source,
            )
        )
    return episodes[::-1]
