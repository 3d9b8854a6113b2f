"""Saving in the background, so that the node never waits for a disk."""

from __future__ import annotations

import fcntl
import os
import threading
import time

from . import episode_file
from .episode_file import Saved

#: Seconds until a failed save is tried again.
RETRY_PERIOD = 5.0
#: After a save comes a rest of this many times its duration, but not of more seconds than this:
#: saving leaves the disk and the interpreter three quarters of the time.
_REST = 3
_LONGEST_REST = 0.25
#: Seconds that the end of the node waits for the last save.
_LAST_SAVE = 1.0


class EpisodeSaver:
    """Write the newest of what it is given to a file, in a thread.

    What comes when there was nothing to do is saved at once; what comes during a save and its
    rest is saved next, of several the last. A save that fails is tried again, with the newest.

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
        Size and duration of the last that succeeded.

    Raises
    ------
    ValueError
        If the path cannot be a file of its own.

    """

    def __init__(self, path: str):
        self.path = path
        self.error = ''
        self.num_saves = 0
        self.nbytes = 0
        self.seconds = 0.0
        self._lock_file = _lock(path)
        self._pending: Saved | None = None
        self._stopping = False
        self._condition = threading.Condition()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def save(self, saved: Saved) -> None:
        """Have this saved, in place of anything not yet begun. Never blocks."""
        with self._condition:
            self._pending = saved
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
                self._condition.wait_for(lambda: self._pending is not None or self._stopping)
                saved, self._pending = self._pending, None
            if saved is None:
                return
            begin = time.monotonic()
            try:
                self.nbytes = episode_file.write(self.path, saved)
            except (OSError, MemoryError) as error:
                reason = getattr(error, 'strerror', None) or error
                self.error = f'{self.path} cannot be saved: {reason}'
                with self._condition:
                    self._pending = self._pending or saved
                    if self._condition.wait_for(lambda: self._stopping, RETRY_PERIOD):
                        return
            else:
                self.seconds = time.monotonic() - begin
                self.num_saves += 1
                self.error = ''
                with self._condition:
                    rest = min(_REST * self.seconds, _LONGEST_REST)
                    self._condition.wait_for(lambda: self._stopping, rest)


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
