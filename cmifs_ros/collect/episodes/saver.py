"""Saving so that a killed process loses nothing, and the node never waits for a disk."""

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
#: Least number of bytes appended before the file is written anew; else as many as it began with.
_LEAST_APPENDED = 1_000_000
#: Seconds between two waits for the disk: what is newer is lost with the machine's power.
_SYNC_PERIOD = 1.0
#: Seconds that the end of the node waits for the last save.
_LAST_SAVE = 1.0


@dataclass(frozen=True)
class _Save:
    """What a file is to begin with, and the records of the episodes that came since."""

    saved: Saved
    records: list[bytes] = field(default_factory=list)


class EpisodeSaver:
    """Keep a file of episodes: each new one is appended at once, all else is saved in a thread.

    An episode that was appended outlives a process that is killed: the system has it, and brings it
    to the disk later, for which the thread waits. To save is to write a new file with the newest of
    what is given and with the episodes appended meanwhile, and to put it in the place of the old
    one. A save that fails is tried again, with the newest.

    Parameters
    ----------
    path : str
        The file; it belongs to this object alone, which `path` with `.lock` added tells others.

    Attributes
    ----------
    error : str
        Why the last save failed; empty if it did not.
    num_saves : int
        How many succeeded.
    nbytes, seconds : int, float
        Size of the file, and duration of the last save that succeeded.

    Raises
    ------
    ValueError
        If the path cannot be a file of its own.

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

    def append(self, episode: Episode, channel_names: tuple[str, ...]) -> bool:
        """Add an episode to the file, now; return False if everything is to be saved instead."""
        with self._condition:
            saves = [save for save in (self._pending, self._writing) if save is not None]
            newest = saves[0].saved if saves else self._file
            if self.error or newest is None or newest.channel_names != channel_names:
                return False
            record = episode_file.record(episode)
            for save in saves:
                if save.saved.channel_names == channel_names:
                    save.records.append(record)
            file = self._file
            if file is None or file.channel_names != channel_names:
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
        """Have this saved, in place of anything not yet begun. Never blocks."""
        with self._condition:
            self._pending = _Save(saved)
            self._condition.notify()

    def stop(self) -> None:
        """Finish what is under way and the last save, if that takes no longer than a second."""
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
        with self._condition:  # Nothing is appended to the old file any more.
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


def _lock(path: str) -> int | None:
    folder = os.path.dirname(path)
    if not os.path.isdir(folder):
        raise ValueError(f'episodes_path is {path!r}; there is no folder {folder}')
    if os.path.lexists(path) and not os.path.isfile(path):
        raise ValueError(f'episodes_path is {path!r}; expected the path of a file')
    try:
        descriptor = os.open(f'{path}.lock', os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    except OSError:
        return None  # A full or read-only disk, as the first save will tell.
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise ValueError(f'episodes_path is {path!r}, which another selector uses') from None
    except OSError:
        pass  # A file system without locks.
    return descriptor
