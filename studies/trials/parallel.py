# SPDX-License-Identifier: Apache-2.0

"""Run many trials in parallel, on this machine or on a Dask cluster."""

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
    """Return an iterator over the results of many calls, in the order of completion."""
    parallel = joblib.Parallel(
        n_jobs=jobs or -1,
        batch_size=1,
        # An old joblib returns results in order only: a row waits for those before it.
        return_as='generator' if IS_OLD_JOBLIB else 'generator_unordered',
    )
    # Ctrl-C in a terminal reaches the workers, too; they inherit ignoring it. A blocked one
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
        Receives each trial when it is finished.
    jobs : int, optional
        Number of processes; None: one per core.
    scheduler : str, optional
        Address of a Dask scheduler to run them.
    run : callable
        Runs one trial.

    Raises
    ------
    CommandError
        If the cluster is unusable.

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
