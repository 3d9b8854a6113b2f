# SPDX-License-Identifier: Apache-2.0

"""Save episodes so that a killed process loses nothing and the node never waits for the disk."""

from __future__ import annotations

import fcntl
import os
import threading
import time
from dataclasses import dataclass, field

from cmifs_ros.core import Episode

from . import file as episode_file
from .file import EpisodeFile
from .file_format import Saved

#: Seconds until a failed save is tried again.
RETRY_PERIOD = 5.0
#: The file is rewritten when the appended bytes exceed this and its initial size.
_LEAST_APPENDED = 1_000_000
#: Seconds between two synchronisations; a power failure loses what is newer.
_SYNC_PERIOD = 1.0
#: Seconds that shutdown waits for the last save.
_LAST_SAVE = 1.0


@dataclass(frozen=True)
class _Save:
    """The initial contents of a file, and the records of the episodes appended since."""

    saved: Saved
    records: list[bytes] = field(default_factory=list)


class EpisodeSaver:
    """Keep a file of episodes: episodes are appended at once, a thread saves everything else.

    An appended episode survives if the process is killed: the operating system has it and writes it
    to disk later; the thread waits for that. A save writes a new file with the newest contents,
    including episodes appended meanwhile, and replaces the old one. A failed save is retried with
    the newest contents.

    Parameters
    ----------
    path : str
        The file. A lock file, `path` with `.lock` added, reserves it for this object.

    Attributes
    ----------
    error : str
        Why the last save failed; empty if it succeeded.
    num_saves : int
        Number of successful saves.
    nbytes, seconds : int, float
        Size of the file, and duration of the last successful save.

    Raises
    ------
    ValueError
        If the path cannot be used for such a file.

    """

    def __init__(self, path: str):
        self.path = path
        self.error = ''
        self.num_saves = 0
        self.seconds = 0.0
        self._lock_file = _lock(path)
        self._file: EpisodeFile | None = None
        self._is_synced = True
        self._writing: _Save | None = None
        self._pending: _Save | None = None
        self._stopping = False
        self._condition = threading.Condition()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def nbytes(self) -> int:
        """Size of the file."""
        return 0 if self._file is None else self._file.size

    def append(
        self,
        episode: Episode,
        channel_names: tuple[str, ...],
        action_names: tuple[str, ...] = (),
        renewals: float = 0.0,
    ) -> bool:
        """Append an episode to the file; return False if everything must be saved instead.

        `renewals` is that of the buffer with this episode.
        """
        names = channel_names, action_names
        with self._condition:
            saves = [save for save in (self._pending, self._writing) if save is not None]
            newest = saves[0].saved if saves else self._file
            if self.error or newest is None or _names(newest) != names:
                return False
            record = episode_file.record(episode, renewals)
            for save in saves:
                if _names(save.saved) == names:
                    save.records.append(record)
            file = self._file
            if file is None or _names(file) != names:
                return True
            try:
                file.append(record)
            except OSError as error:
                self._fail(error)
                return False
            self._is_synced = False
            self._condition.notify()
            is_long = file.size - file.first_size > max(_LEAST_APPENDED, file.first_size)
            return bool(saves) or not is_long

    def save(self, saved: Saved) -> None:
        """Request a save, which replaces any save not yet started. Never blocks."""
        with self._condition:
            self._pending = _Save(saved)
            self._condition.notify()

    def stop(self) -> None:
        """Finish the running and the requested save, if that takes no longer than a second."""
        with self._condition:
            self._stopping = True
            self._condition.notify()
        self._thread.join(_LAST_SAVE)
        if self._lock_file is not None:
            os.close(self._lock_file)
            self._lock_file = None

    def _run(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(
                    lambda: self._pending is not None or not self._is_synced or self._stopping
                )
                self._writing, self._pending = self._pending, None
                is_synced, self._is_synced = self._is_synced, True
            if self._writing is None and is_synced:
                return
            try:
                if self._writing is not None:
                    self._write(self._writing)
                else:
                    self._file.sync()
            except (OSError, MemoryError) as error:
                with self._condition:
                    self._fail(error)
                    self._pending, self._writing = self._pending or self._writing, None
                    if self._condition.wait_for(lambda: self._stopping, RETRY_PERIOD):
                        return
            with self._condition:
                self._condition.wait_for(
                    lambda: self._pending is not None or self._stopping, _SYNC_PERIOD
                )

    def _write(self, save: _Save) -> None:
        begin = time.monotonic()
        file = EpisodeFile(self.path, save.saved)
        with self._condition:  # Nothing is appended to the old file from here on.
            try:
                for record in save.records:
                    file.append(record)
                file.put_in_place()
            except OSError:
                file.discard()
                raise
            old, self._file = self._file, file
            self._writing = None
            self._is_synced = not save.records
            self.error = ''
        if old is not None:
            old.close()
        episode_file.sync_folder(self.path)
        self.seconds = time.monotonic() - begin
        self.num_saves += 1

    def _fail(self, error: OSError | MemoryError) -> None:
        reason = getattr(error, 'strerror', None) or error
        self.error = f'{self.path} cannot be saved: {reason}'


def _names(content: Saved | EpisodeFile) -> tuple:
    return content.channel_names, content.action_names


def _lock(path: str) -> int | None:
    folder = os.path.dirname(path)
    if not os.path.isdir(folder):
        raise ValueError(f'episodes_path is {path!r}; there is no folder {folder}')
    if os.path.lexists(path) and not os.path.isfile(path):
        raise ValueError(f'episodes_path is {path!r}; expected the path of a file')
    try:
        descriptor = os.open(f'{path}.lock', os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    except OSError:
        return None  # The disk is full or read-only, which the first save will report.
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise ValueError(f'episodes_path is {path!r}, which another selector uses') from None
    except OSError:
        pass  # A file system without locks.
    return descriptor
