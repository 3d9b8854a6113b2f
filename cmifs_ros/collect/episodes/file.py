# SPDX-License-Identifier: Apache-2.0

"""Writes the file of episodes; `file_format` says what is in it."""

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
    action_names : tuple of str
    first_size, size : int
        Bytes at the beginning and now.

    Raises
    ------
    OSError
        If it cannot be written; nothing is left of it then.

    """

    def __init__(self, path: str | os.PathLike, saved: Saved):
        self.channel_names, self.action_names = saved.channel_names, saved.action_names
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


def record(episode: Episode) -> bytes:
    """Return what appends an episode to a file of its channels and actions."""
    source = episode.source.encode(errors='surrogateescape')
    header = RecordHeader(len(episode), episode.actions.shape[1], len(source)).packed()
    content = b''.join([header, source, *_arrays(episode)])
    return content + hashlib.sha256(content).digest()


def _chunks(saved: Saved) -> Iterator[bytes]:
    """Yield what a file begins with in large pieces, without the checksum.

    To hash and write these leaves the interpreter to other threads, while each small one would
    take it from them.
    """
    selection = saved.selection
    places = {source: i for i, source in enumerate(dict.fromkeys(e.source for e in saved.episodes))}
    header = {
        'channels': saved.channel_names or (),
        'actions': saved.action_names,
        'sources': list(places),
        'episodes': [(len(e), e.actions.shape[1], places[e.source]) for e in saved.episodes],
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
