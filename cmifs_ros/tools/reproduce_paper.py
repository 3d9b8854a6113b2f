"""Figures 6 and 7 of Hachiya & Sugiyama (2010), recomputed.

Trials run side by side, on this machine or on a Dask cluster. An interrupted run continues
where it stopped when the same command is given again.
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from pathlib import Path

import joblib
from tqdm import tqdm

from .paper_figures import Results, markdown, save_figures
from .study import METHODS, Outcome, Trial, plan, run_trial
from .trial_log import TrialLog

FIGURES = ('6a', '6b', '7')
#: Ubuntu 24.04's joblib 1.3 gives results in order only: a row then waits for those before it.
IS_OLD_JOBLIB = tuple(map(int, joblib.__version__.split('.')[:2])) < (1, 4)


class StudyError(RuntimeError):
    """The study cannot go on; the message says why."""


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


def run_trials(trials: Sequence[Trial], jobs: int | None) -> Iterator[Outcome]:
    """Return an iterator over the outcomes in the order in which they are ready."""
    parallel = joblib.Parallel(
        n_jobs=jobs or -1,
        batch_size=1,
        return_as='generator' if IS_OLD_JOBLIB else 'generator_unordered',
    )
    # A terminal's Ctrl-C reaches the workers too; they inherit that they ignore it.
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        return parallel(joblib.delayed(run_trial)(trial) for trial in trials)
    finally:
        signal.signal(signal.SIGINT, handler)


def run(options: argparse.Namespace) -> None:
    """Run the trials that are missing, then draw and tabulate those asked for."""
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        log = TrialLog(options.out / 'trials.csv')
    except (OSError, ValueError) as error:
        raise StudyError(str(error)) from error
    wanted = plan(options.figure, options.methods, options.episodes, options.trials, options.seed)
    missing = [trial for trial in wanted if trial not in log.outcomes]
    done = len(wanted) - len(missing)
    print(f'{len(wanted)} trials, {done} of them already in {options.out / "trials.csv"}')
    if missing:
        with (
            backend(options.scheduler),
            closing(run_trials(missing, options.jobs)) as outcomes,
            tqdm(total=len(wanted), initial=done, file=sys.stdout, disable=None) as bar,
        ):
            for outcome in outcomes:
                log.add(outcome)
                bar.update()
    results = Results(log.outcomes[trial] for trial in wanted)
    table = markdown(results, options.figure)
    (options.out / 'table.md').write_text(table)
    paths = save_figures(results, options.figure, options.out)
    print(f'\n{table}\nwritten: {", ".join(map(str, [options.out / "table.md", *paths]))}')


def _numbers(text: str) -> list[int]:
    try:
        numbers = sorted({int(part) for part in text.split(',')})
    except ValueError:
        numbers = []
    if not numbers or numbers[0] < 2:
        raise argparse.ArgumentTypeError(f'it is {text!r}; expected numbers from 2 as in 20,40,100')
    return numbers


def _methods(text: str) -> list[str]:
    names = text.split(',')
    if not set(names) <= set(METHODS):
        raise argparse.ArgumentTypeError(
            f'it is {text!r}; expected some of {", ".join(METHODS)}, separated by commas'
        )
    return [method for method in METHODS if method in names]


def _at_least(least: int):
    def number(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f'it is {text!r}; expected a number from {least}')
        return int(text)

    return number


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Return the options; a bad one ends the program with a sentence."""
    parser = argparse.ArgumentParser(
        prog='reproduce_paper', description=' '.join(__doc__.split()), allow_abbrev=False
    )
    parser.add_argument('--figure', choices=(*FIGURES, 'all'), default='all')
    parser.add_argument('--trials', type=_at_least(1), default=50, help='repetitions (default 50)')
    parser.add_argument(
        '--episodes',
        type=_numbers,
        default='10,20,30,40,50,60,70,80,90,100',
        metavar='M,M,...',
        help='numbers of episodes, figure 7 takes the greatest (default %(default)s)',
    )
    parser.add_argument(
        '--methods',
        type=_methods,
        default=','.join(METHODS),
        metavar='NAME,...',
        help='default %(default)s',
    )
    parser.add_argument(
        '--seed', type=_at_least(0), default=0, help='trial i has the seed SEED + i (default 0)'
    )
    parser.add_argument(
        '--out',
        type=Path,
        default=Path('reproduction'),
        metavar='DIR',
        help='folder of the results, and of the trials to continue with (default %(default)s)',
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument('--jobs', type=_at_least(1), help='processes (default: one a core)')
    where.add_argument(
        '--scheduler', metavar='ADDRESS', help='run on the cluster of this Dask scheduler'
    )
    options = parser.parse_args(arguments)
    options.figure = FIGURES if options.figure == 'all' else (options.figure,)
    return options


def main(arguments: list[str] | None = None) -> int:
    """Run the study; return the exit code."""
    options = parse(arguments)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        run(options)
    except StudyError as error:
        print(f'reproduce_paper: {error}', file=sys.stderr)
        return 1
    except BrokenProcessPool:
        print(
            'reproduce_paper: a worker process died; the same command continues where it stopped',
            file=sys.stderr,
        )
        return 1
    except KeyboardInterrupt:
        print('\nreproduce_paper: interrupted; the same command continues where it stopped')
        return 128 + signal.SIGINT
    return 0


if __name__ == '__main__':
    sys.exit(main())
