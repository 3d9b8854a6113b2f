# SPDX-License-Identifier: Apache-2.0

"""Runs many trials side by side, on this machine or on a Dask cluster."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from typing import TypeVar

import joblib
from tqdm import tqdm

from cmifs_ros.tools.cluster import IS_OLD_JOBLIB, backend

from .log import TrialLog
from .trial import Outcome, Results, Trial, run_trial

T = TypeVar('T')


@contextmanager
def results_of(
    function: Callable[..., T], arguments: Iterable[tuple], jobs: int | None = None
) -> Iterator[Iterator[T]]:
    """Give an iterator over the results of many calls, in the order in which they are ready."""
    parallel = joblib.Parallel(
        n_jobs=jobs or -1,
        batch_size=1,
        # An old joblib gives results in order only: a row then waits for those before it.
        return_as='generator' if IS_OLD_JOBLIB else 'generator_unordered',
    )
    # A terminal's Ctrl-C reaches the workers too; they inherit that they ignore it. A blocked one
    # would not be lost meanwhile, but loky unblocks it.
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        results = parallel(joblib.delayed(function)(*each) for each in arguments)
    finally:
        signal.signal(signal.SIGINT, handler)
    with closing(results):
        yield results


def finish(
    trials: Sequence[Trial],
    log: TrialLog,
    jobs: int | None = None,
    scheduler: str | None = None,
    *,
    run: Callable[[Trial], Outcome] = run_trial,
) -> Results:
    """Run the trials that the log lacks, with a progress bar, and return all of them.

    Parameters
    ----------
    trials : sequence of Trial
    log : TrialLog
        Gets each trial as soon as it is ready.
    jobs : int, optional
        Processes; None takes one a core.
    scheduler : str, optional
        Address of the Dask scheduler whose cluster runs them.
    run : callable
        Runs one trial.

    Raises
    ------
    CommandError
        If the cluster cannot be used.

    """
    missing = [trial for trial in trials if trial not in log.outcomes]
    if missing:
        done = len(trials) - len(missing)
        with (
            backend(scheduler),
            results_of(run, ((trial,) for trial in missing), jobs) as outcomes,
            tqdm(total=len(trials), initial=done, file=sys.stdout, disable=None) as bar,
        ):
            for outcome in outcomes:
                log.add(outcome)
                bar.update()
    return Results(log.outcomes[trial] for trial in trials)
