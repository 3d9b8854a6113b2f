# SPDX-License-Identifier: Apache-2.0

"""Write the file of episodes; `file_format` describes it."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np

from cmifs_ros.collect.selection_fields import fields_of
from cmifs_ros.core import Episode

from .file_format import CHUNK, MAGIC, VALUE, VERSION, RecordHeader, Saved


class EpisodeFile:
    """A file of episodes: written next to its path, moved into place, then appended to.

    Until it is moved into place, it is called `path` with `.tmp` added.

    Parameters
    ----------
    path : path-like
    saved : Saved
        Initial contents, which are on disk when the constructor returns.

    Attributes
    ----------
    channel_names : tuple of str or None
    action_names : tuple of str
    first_size, size : int
        Initial and current size in bytes.

    Raises
    ------
    OSError
        If it cannot be written; the partial file is removed.

    """

    def __init__(self, path: str | os.PathLike, saved: Saved):
        self.channel_names, self.action_names = saved.channel_names, saved.action_names
        self._path, self._temporary = os.fspath(path), f'{os.fspath(path)}.tmp'
        Path(self._temporary).unlink(missing_ok=True)  # left by a process that was killed
        # O_EXCL does not follow a link that somebody else placed there.
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
        """Append bytes, such as a `record`: all of them or, with an OSError, none.

        They survive the end of the process; until `sync`, they do not survive a power failure.
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
        """Wait until everything is on disk."""
        os.fsync(self._descriptor)

    def put_in_place(self) -> None:
        """Replace the older file atomically."""
        os.replace(self._temporary, self._path)

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)

    def discard(self) -> None:
        """Close and remove the file before it was moved into place."""
        self.close()
        Path(self._temporary).unlink(missing_ok=True)


def write(path: str | os.PathLike, saved: Saved) -> None:
    """Replace a file atomically, or leave it unchanged.

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
    """Wait until the renaming of a file is on disk."""
    folder = os.open(os.path.dirname(os.fspath(path)) or '.', os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def set_aside(path: str | os.PathLike) -> str:
    """Rename a file to a free name next to it, and return the new name.

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


def record(episode: Episode, renewals: float = 0.0) -> bytes:
    """Return the bytes that append an episode to a file with its channels and actions.

    `renewals` is that of the buffer with this episode.
    """
    source = episode.source.encode(errors='surrogateescape')
    header = RecordHeader(len(episode), episode.actions.shape[1], len(source), renewals).packed()
    content = b''.join([header, source, *_arrays(episode)])
    return content + hashlib.sha256(content).digest()


def _chunks(saved: Saved) -> Iterator[bytes]:
    """Yield the initial contents of a file in large pieces, without the checksum.

    Hashing and writing large pieces releases the interpreter lock; many small ones would not.
    """
    selection = saved.selection
    places = {source: i for i, source in enumerate(dict.fromkeys(e.source for e in saved.episodes))}
    header = {
        'channels': saved.channel_names or (),
        'actions': saved.action_names,
        'sources': list(places),
        'episodes': [(len(e), e.actions.shape[1], places[e.source]) for e in saved.episodes],
        'renewals': saved.renewals,
        'selection': selection
        and fields_of(selection) | {'means': selection.means, 'spreads': selection.spreads},
        'selected_at': saved.selected_at,
    }
    parts: list[bytes | memoryview]
    parts, size = [MAGIC + b'%d\n' % VERSION, json.dumps(header).encode(), b'\n'], 0
    for episode in saved.episodes:
        parts += _arrays(episode)
        size += episode.nbytes
        if size >= CHUNK:
            yield b''.join(parts)
            parts, size = [], 0
    yield b''.join(parts)


def _arrays(episode: Episode) -> list[bytes | memoryview]:
    arrays = (episode.states, episode.rewards, episode.actions)
    return [np.ascontiguousarray(values, VALUE).data for values in arrays if values.size]
