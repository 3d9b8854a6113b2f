# SPDX-License-Identifier: Apache-2.0

"""A queue of requests for selections, which shares computations between requests."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass

from cmifs_ros.core import Episode
from cmifs_ros.core.selection import Selection

from .selection_job import prepare, run_selection
from .worker import WorkerProcess

CANCELLED = 'the selection was cancelled'
STOPPED = 'the selector is shutting down'

#: Calls that may wait for an answer.
MAX_WAITING = 1000


@dataclass(frozen=True)
class Job:
    """A selection to be made.

    Attributes
    ----------
    revision : int
        Changes with the data and the settings.
    num_clears : int
        How often the episodes had been cleared.
    cause : str
        What it was requested by.
    arguments : tuple
        The arguments of `run_selection`; the first are the episodes.
    held : sequence of Episode
        These episodes as the buffer holds them.
    note : str
        Which of the data are left out, if any.

    """

    revision: int
    num_clears: int
    cause: str
    arguments: tuple
    held: Sequence[Episode] = ()
    note: str = ''


@dataclass(frozen=True)
class Outcome:
    """A selection, or the reason why there is none.

    Attributes
    ----------
    selection : Selection or None
    error : str
        Why there is none.
    job : Job or None
        None: nothing failed; no job was started, or it was cancelled.

    """

    selection: Selection | None = None
    error: str = ''
    job: Job | None = None


class RefusedError(Exception):
    """A selection cannot be started; the message says why."""


class SelectionQueue:
    """Run one selection at a time and pass its outcome to all who requested it.

    A request made while a job runs joins this job if nothing has changed since it started,
    otherwise the next one.

    Parameters
    ----------
    make_job : callable
        Takes a cause; returns a job for the newest data and settings, or raises `RefusedError`.
    current_revision : callable
        Returns the revision that `make_job` would use now.
    on_outcome : callable
        Called with each outcome; returns the outcome to pass on.
    timeout : float
        Seconds after which a selection is cancelled; 0: never.

    """

    def __init__(
        self,
        make_job: Callable[[str], Job],
        current_revision: Callable[[], int],
        on_outcome: Callable[[Outcome], Outcome],
        timeout: float,
    ):
        self._make_job = make_job
        self._current_revision = current_revision
        self._on_outcome = on_outcome
        self.timeout = timeout
        self._worker = WorkerProcess(prepare)
        self._running: Job | None = None
        self._started_at = 0.0
        self._joined: list[Callable[[Outcome], None]] = []
        self._waiting: list[Callable[[Outcome], None]] = []
        self._cause = ''  # of the next job

    @property
    def busy(self) -> bool:
        """Whether a selection is running."""
        return self._worker.busy

    @property
    def running_for(self) -> float:
        """Seconds since the running selection was started; 0 if none is running."""
        return time.monotonic() - self._started_at if self.busy else 0.0

    @property
    def progress(self) -> float:
        """Completed share of the running selection, 0 to 1."""
        return self._worker.progress if self.busy else 0.0

    @property
    def worker_pid(self) -> int | None:
        """Process id of the worker, or None if none is running."""
        return self._worker.pid

    def start(self) -> None:
        """Start the worker before the first selection."""
        with suppress(OSError):  # Reported when a selection needs it.
            self._worker.start()

    def request(self, cause: str, answer: Callable[[Outcome], None]) -> None:
        """Request a selection; `answer` is called with its outcome."""
        if len(self._joined) + len(self._waiting) >= MAX_WAITING:
            reason = f'{MAX_WAITING} calls are already waiting for a selection'
            answer(Outcome(error=reason))
        elif self.busy and self._running.revision == self._current_revision():
            self._joined.append(answer)
        else:
            self._cause = self._cause if self._waiting else cause
            self._waiting.append(answer)
            self._start_next()

    def poll(self) -> None:
        """Collect a finished selection and start the next one. Never blocks."""
        finished = self._worker.outcome()
        if finished is not None:
            error = finished.exception()
            if error is None:
                self._finish(finished.result())
            elif isinstance(error, BrokenProcessPool):
                self._finish(error='the worker process died during the selection')
            elif isinstance(error, ValueError):  # It says what is wrong.
                self._finish(error=str(error))
            else:
                self._finish(error=repr(error))
        elif self.busy and 0 < self.timeout < self.running_for:
            self._worker.stop()
            reason = f'the selection took longer than {self.timeout:g} s (selection_timeout)'
            self._finish(error=reason)
        self._start_next()

    def cancel(self) -> bool:
        """Cancel the running selection; return whether there was one.

        All waiting requests are answered, including those for the next selection.
        """
        if not self.busy:
            return False
        self._abandon(CANCELLED)
        return True

    def stop(self) -> bool:
        """Kill the worker and answer all waiting requests; return whether there were any."""
        return self._abandon(STOPPED)

    def _abandon(self, reason: str) -> bool:
        self._worker.stop()
        waiting, self._joined, self._waiting = self._joined + self._waiting, [], []
        self._running = None
        self._answer(waiting, Outcome(error=reason))
        return bool(waiting)

    def _start_next(self) -> None:
        if self.busy or not self._waiting:
            return
        waiting, self._waiting = self._waiting, []
        try:
            job = self._make_job(self._cause)
        except RefusedError as error:
            self._answer(waiting, Outcome(error=str(error)))
            return
        try:
            self._worker.submit(run_selection, *job.arguments)
        except OSError as error:
            reason = f'cannot start a worker process: {error}'
            self._answer(waiting, Outcome(error=reason, job=job))
            return
        self._running, self._joined = job, waiting
        self._started_at = time.monotonic()

    def _finish(self, selection: Selection | None = None, error: str = '') -> None:
        joined, self._joined = self._joined, []
        # Not kept: the memory bound of the buffer covers all episodes held.
        job, self._running = self._running, None
        self._answer(joined, Outcome(selection, error, job))

    def _answer(self, answers: list[Callable[[Outcome], None]], outcome: Outcome) -> None:
        outcome = self._on_outcome(outcome)
        for answer in answers:
            answer(outcome)
