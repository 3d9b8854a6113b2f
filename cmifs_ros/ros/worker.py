# SPDX-License-Identifier: Apache-2.0

"""The process that computes, so that the node's own process never does."""

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
from contextlib import contextmanager
from multiprocessing.connection import wait

#: In a worker process, the share `done` of its job, which its parent reads.
_shared: dict[str, ctypes.c_double] = {}


class WorkerProcess:
    """Run one job at a time in a process of its own, which a new one replaces if it dies.

    The process is spawned, since a fork would copy the middleware's locks without the threads
    that hold them. It ignores Ctrl-C, runs at a lower priority than the robot's controllers,
    keeps the linear algebra library to one thread, and ends when its parent does, however
    that ends.

    Parameters
    ----------
    prepare : callable
        What every new process does first, so that a job need not: loading, compiling.

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
        """Share of the newest job that is done, from 0 to 1, as far as it told."""
        return self._done.value

    @property
    def busy(self) -> bool:
        """Whether a job was submitted and its outcome not yet collected."""
        return self._future is not None

    @property
    def pid(self) -> int | None:
        """Process id, or None when no process runs."""
        alive = self._process is not None and self._process.is_alive()
        return self._process.pid if alive else None

    def start(self) -> None:
        """Start the process before there is a job, which then finds it prepared.

        Raises
        ------
        OSError
            If the system gives no process.

        """
        self._submit(os.getpid)

    def submit(self, function: Callable, *args) -> None:
        """Start a job; `function`, its arguments and its result have to be picklable.

        Raises
        ------
        RuntimeError
            If a job is under way.
        OSError
            If the system gives no process.

        """
        if self.busy:
            raise RuntimeError('a job is under way; collect its outcome first')
        if self.pid is None:  # None has run yet, or it died while it was idle.
            self.stop()
        try:
            self._future = self._submit(function, *args)
        except BrokenProcessPool:  # It died just now.
            self.stop()
            self._future = self._submit(function, *args)

    def outcome(self) -> Future | None:
        """Return the finished job, once, or None while there is none.

        The result of the future is that of the function. Its exception is that of the
        function, or `BrokenProcessPool` if the process died.
        """
        if self._future is None or not self._future.done():
            return None
        future, self._future = self._future, None
        if isinstance(future.exception(), BrokenProcessPool):
            self.stop()
        return future

    def stop(self) -> None:
        """End the process at once, whatever it is doing."""
        if self._process is not None:
            self._process.kill()
        if self._pool is not None:
            # Nobody reads what is on its way, for which old Pythons would wait (gh-94777).
            self._pool._call_queue._reader.close()
            self._pool.shutdown(wait=True, cancel_futures=True)
        self._pool = self._process = self._future = None

    def _submit(self, function: Callable, *args) -> Future:
        self._done.value = 0.0
        if self._pool is not None:
            return self._pool.submit(function, *args)
        # A worker is killed, and Python's tracker then removes what it shared, which is no news.
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
        # None if it is dead already, which its future then tells.
        self._process = next(iter(set(multiprocessing.active_children()) - others), None)
        return future


def report_progress(fraction: float) -> None:
    """Tell the parent of this worker process what share of the job is done."""
    _shared['done'].value = fraction


@contextmanager
def _inherited() -> Iterator[None]:
    """Make what a new process inherits from this one.

    No Ctrl-C, which reaches the whole terminal group: a process that is still importing would print
    a traceback. And one thread for the linear algebra, which reads that when it is imported.
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
    """Have this process end as soon as the one that started it does, however that ends."""

    def watch():
        wait([multiprocessing.parent_process().sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
