"""Runs many trials side by side, on this machine or on a Dask cluster."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from typing import TypeVar

import joblib
from tqdm import tqdm

from cmifs_ros.tools.program import StudyError

from .trial_log import TrialLog
from .trials import Results, Trial, run_trial

T = TypeVar('T')

#: Ubuntu 24.04's joblib 1.3 gives results in order only: a row then waits for those before it.
IS_OLD_JOBLIB = tuple(map(int, joblib.__version__.split('.')[:2])) < (1, 4)


@contextmanager
def backend(scheduler: str | None) -> Iterator[None]:
    """Have joblib work on this machine, or on the cluster of a Dask scheduler."""
    if scheduler is None:
        # More threads than processes would only get into each other's way.
        with joblib.parallel_config(backend='loky', inner_max_num_threads=1):
            yield
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise StudyError(
            '--scheduler needs the package distributed, here and on the cluster: '
            'python3 -m pip install distributed'
        ) from error
    if IS_OLD_JOBLIB:
        raise StudyError(f'--scheduler needs joblib 1.4 or newer; this is {joblib.__version__}')
    try:
        client = Client(scheduler, timeout=10)
    except (OSError, ValueError) as error:
        raise StudyError(f'no Dask scheduler answers at {scheduler}: {error}') from error
    with client, joblib.parallel_config(backend='dask'):
        yield


@contextmanager
def results_of(
    function: Callable[..., T], arguments: Iterable[tuple], jobs: int | None = None
) -> Iterator[Iterator[T]]:
    """Give an iterator over the results of many calls, in the order in which they are ready."""
    parallel = joblib.Parallel(
        n_jobs=jobs or -1,
        batch_size=1,
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
    trials: Sequence[Trial], log: TrialLog, jobs: int | None = None, scheduler: str | None = None
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

    Raises
    ------
    StudyError
        If the cluster cannot be used.

    """
    missing = [trial for trial in trials if trial not in log.outcomes]
    if missing:
        done = len(trials) - len(missing)
        with (
            backend(scheduler),
            results_of(run_trial, ((trial,) for trial in missing), jobs) as outcomes,
            tqdm(total=len(trials), initial=done, file=sys.stdout, disable=None) as bar,
        ):
            for outcome in outcomes:
                log.add(outcome)
                bar.update()
    return Results(log.outcomes[trial] for trial in trials)
