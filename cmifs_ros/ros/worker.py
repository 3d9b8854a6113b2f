# SPDX-License-Identifier: Apache-2.0

"""The worker process, so that the node's own process never computes."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing.connection import wait

#: In a worker process, the completed share of its job, read by its parent.
_shared: dict[str, ctypes.c_double] = {}


class WorkerProcess:
    """Run one job at a time in a separate process, which is replaced if it dies.

    The process is spawned, because a fork would copy the middleware's locks without the threads
    that hold them. It ignores Ctrl-C, runs at a lower priority than the robot's controllers, limits
    the linear algebra library to one thread, and ends with its parent, even if that is killed.

    Parameters
    ----------
    prepare : callable
        Called first in each new process, to load and compile code before the first job.

    """

    def __init__(self, prepare: Callable[[], None]):
        self._prepare = prepare
        self._pool: ProcessPoolExecutor | None = None
        self._process: multiprocessing.process.BaseProcess | None = None
        self._future: Future | None = None
        self._context = multiprocessing.get_context('spawn')
        self._done = self._context.RawValue('d')

    @property
    def progress(self) -> float:
        """Reported progress of the newest job, 0 to 1."""
        return self._done.value

    @property
    def busy(self) -> bool:
        """Whether there is a job whose outcome has not been collected."""
        return self._future is not None

    @property
    def pid(self) -> int | None:
        """Process id, or None if no process is running."""
        alive = self._process is not None and self._process.is_alive()
        return self._process.pid if alive else None

    def start(self) -> None:
        """Start the process before the first job.

        Raises
        ------
        OSError
            If the process cannot be started.

        """
        self._submit(os.getpid)

    def submit(self, function: Callable, *args) -> None:
        """Start a job; `function`, its arguments and its result must be picklable.

        Raises
        ------
        RuntimeError
            If a job is running.
        OSError
            If the process cannot be started.

        """
        if self.busy:
            raise RuntimeError('a job is running; collect its outcome first')
        if self.pid is None:  # Not started yet, or it died while idle.
            self.stop()
        try:
            self._future = self._submit(function, *args)
        except BrokenProcessPool:  # It died just now.
            self.stop()
            self._future = self._submit(function, *args)

    def outcome(self) -> Future | None:
        """Return the finished job once; None if there is none.

        The future has the result or the exception of the function, or `BrokenProcessPool` if the
        process died.
        """
        if self._future is None or not self._future.done():
            return None
        future, self._future = self._future, None
        if isinstance(future.exception(), BrokenProcessPool):
            self.stop()
        return future

    def stop(self) -> None:
        """Kill the process."""
        if self._pool is not None:
            # Nobody reads a job on its way, for which old Pythons would wait (gh-94777). The pool
            # of a process that has died may be closing this end, too.
            with suppress(OSError):
                self._pool._call_queue._reader.close()
        if self._process is not None:
            self._process.kill()
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
        self._pool = self._process = self._future = None

    def _submit(self, function: Callable, *args) -> Future:
        self._done.value = 0.0
        if self._pool is not None:
            return self._pool.submit(function, *args)
        # Python's resource tracker cleans up after a killed worker; its warning is noise.
        quiet = 'ignore:resource_tracker:UserWarning'
        if quiet not in sys.warnoptions:
            sys.warnoptions.append(quiet)
        self._pool = ProcessPoolExecutor(
            1,
            mp_context=self._context,
            initializer=_initialize,
            initargs=(self._done, self._prepare),
        )
        others = set(multiprocessing.active_children())
        with _inherited():
            future = self._pool.submit(function, *args)
        # None if it is dead already; its future then says so.
        self._process = next(iter(set(multiprocessing.active_children()) - others), None)
        return future


def report_progress(fraction: float) -> None:
    """Report the completed share of the job to the parent of this worker process."""
    _shared['done'].value = fraction


@contextmanager
def _inherited() -> Iterator[None]:
    """Set what a new process inherits.

    Ctrl-C is ignored: it reaches the whole terminal group, and a process that is still importing
    would print a traceback. Linear algebra gets one thread, a setting that is read on import.
    """
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    names = [f'{library}_NUM_THREADS' for library in ('OPENBLAS', 'MKL', 'OMP', 'BLIS')]
    own = {name: os.environ[name] for name in names if name in os.environ}
    os.environ |= dict.fromkeys(names, '1')
    try:
        yield
    finally:
        for name in names:
            del os.environ[name]
        os.environ |= own
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def _initialize(done: ctypes.c_double, prepare: Callable[[], None]) -> None:
    _shared['done'] = done
    os.nice(5)
    end_with_parent()
    prepare()


def end_with_parent() -> None:
    """End this process as soon as its parent ends, even if the parent is killed."""

    def watch():
        wait([multiprocessing.parent_process().sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
