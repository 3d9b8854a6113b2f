# SPDX-License-Identifier: Apache-2.0

"""Time and quality of a ranking: direct port, this package, KDR and the peers.

All methods get the same data of the grid world and take turns, so that other load on the machine
affects all of them. Each measurement is a separate process.
"""

from __future__ import annotations

import argparse
import datetime
import json
import platform
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import joblib
import numpy as np
import scipy
from tqdm import tqdm

from cmifs_ros.sim import SCENARIOS
from cmifs_ros.sim.grid_world import MAX_EPISODE_STEPS, NUM_CHANNELS
from cmifs_ros.tools.arguments import number_from
from cmifs_ros.tools.program import exit_code
from studies.methods.registry import METHODS, what_is_missing
from studies.tasks.registry import TASKS
from studies.trials.arguments import add_names, numbers_from, study_parser
from studies.trials.statistics import mean_and_error, rank_sum
from studies.trials.tables import markdown_table

from .measurement import Job, Measurement, job_of, measure

#: In the order of the table; the others are compared with the first.
TABLE = (
    'direct_port',
    'score_as_port',
    'score',
    'default',
    'paper',
    'kdr',
    'ennemi',
    'sklearn',
    'forest',
)
#: Methods of this package, which have their own threads.
OURS = ('score_as_port', 'score', 'default', 'paper')
#: Methods that may be faster with all cores or with one, depending on their libraries.
CALIBRATED = ('direct_port', 'kdr', 'ennemi')


class Row(NamedTuple):
    """One line of the table: a method with a number of cores, and its measurements."""

    method: str
    cores: int | None
    measurements: list[Measurement]

    @property
    def label(self) -> str:
        """Its name in the table."""
        return METHODS[self.method]

    @property
    def seconds(self) -> float:
        """Median of the trials."""
        return float(np.median([m.seconds for m in self.measurements]))

    @property
    def peak_bytes(self) -> int:
        """Greatest of the trials."""
        return max(m.peak_bytes for m in self.measurements)


def row_job(options: argparse.Namespace, method: str, cores: int) -> Job:
    """Return the job of a row."""
    # This package has its own threads; the others use BLAS threads.
    return job_of(options, method, cores, cores if method in CALIBRATED else 1)


def best_cores(options: argparse.Namespace, method: str) -> int:
    """Return the number of threads, 1 or one per core, with which a method is faster."""
    counts = sorted({1, joblib.cpu_count()})
    if method not in CALIBRATED or len(counts) == 1:
        return 1
    return min(counts, key=lambda n: measure(row_job(options, method, n)._replace(top=1)).seconds)


def rows_of(options: argparse.Namespace) -> list[Row]:
    """Return the rows to measure; this package has one for each number of cores."""
    rows = []
    for method in options.methods:
        if what_is_missing(method):
            rows.append(Row(method, None, []))
        elif method in OURS:
            rows += [Row(method, cores, []) for cores in options.jobs]
        else:
            rows.append(Row(method, best_cores(options, method), []))
    return rows


def run_trials(options: argparse.Namespace, rows: Iterable[Row]) -> None:
    """Measure each row once per trial, in turns."""
    present = [row for row in rows if row.cores]
    with tqdm(total=options.trials * len(present), file=sys.stderr, disable=None) as bar:
        for seed in range(options.first_seed, options.first_seed + options.trials):
            for row in present:
                job = row_job(options, row.method, row.cores)._replace(seed=seed)
                row.measurements.append(measure(job))
                bar.update()


def summary(options: argparse.Namespace, rows: list[Row]) -> list[dict]:
    """Return the values of each row for the table and `--json`, as JSON types."""
    relevant = TASKS[options.scenario].relevant
    port = next((r for r in rows if r.method == 'direct_port'), None)
    found = []
    for row in rows:
        entry = {'method': row.method, 'label': row.label, 'cores': row.cores}
        if row.cores is None:
            found.append(entry | {'missing': what_is_missing(row.method)})
            continue
        sums = [rank_sum(m.ranking, relevant, options.channels) for m in row.measurements]
        mean, error = mean_and_error(sums)
        entry |= {
            'seconds': row.seconds,
            'seconds_of_trials': [m.seconds for m in row.measurements],
            'times_faster_than_direct_port': port and port.seconds / row.seconds,
            'rank_sum': mean,
            'rank_sum_error': error,
            'rank_sums': sums,
            'peak_bytes': row.peak_bytes,
        }
        if port and row.method == 'score_as_port':
            pairs = list(zip(row.measurements, port.measurements, strict=True))
            entry['same_rankings_as_direct_port'] = sum(a.ranking == b.ranking for a, b in pairs)
            entry['greatest_difference_of_scores'] = max(
                float(np.abs(np.subtract(a.scores, b.scores)).max()) for a, b in pairs
            )
        found.append(entry)
    return found


def table(options: argparse.Namespace, entries: list[dict]) -> str:
    """Return the table, followed by a comparison of results with the port's."""
    head = ('method', 'cores', 'seconds', 'speed-up', 'rank sum', 'peak memory')
    lines, notes = [], []
    for entry in entries:
        if 'missing' in entry:
            lines.append((entry['label'], '', entry['missing'], '', '', ''))
            continue
        ratio = entry['times_faster_than_direct_port']
        lines.append(
            (
                entry['label'],
                entry['cores'],
                f'{entry["seconds"]:.3g}',
                '' if ratio is None else f'{ratio:.3g}',
                f'{entry["rank_sum"]:.1f} ± {entry["rank_sum_error"]:.1f}',
                f'{entry["peak_bytes"] / 1e6:.0f} MB',
            )
        )
        if 'same_rankings_as_direct_port' in entry:
            notes.append(
                f'{entry["label"]}, {entry["cores"]} cores: the ranking of the direct port in '
                f'{entry["same_rankings_as_direct_port"]} of {options.trials} trials, '
                f'scores within {entry["greatest_difference_of_scores"]:.1g}\n'
            )
    return markdown_table(head, lines) + ''.join(['\n', *notes] if notes else [])


def machine() -> dict[str, str]:
    """Return the date, the machine and the versions, on which times depend."""
    cpu = platform.processor()
    if Path('/proc/cpuinfo').exists():
        lines = Path('/proc/cpuinfo').read_text().splitlines()
        names = [line.split(':', 1)[1].strip() for line in lines if line.startswith('model name')]
        cpu = names[0] if names else cpu
    return {
        'date': datetime.date.today().isoformat(),
        'machine': f'{joblib.cpu_count()} cores of {cpu}',
        'Python': platform.python_version(),
        'NumPy': np.__version__,
        'SciPy': scipy.__version__,
    }


def run(options: argparse.Namespace) -> None:
    """Measure, then print the table."""
    rows = rows_of(options)
    run_trials(options, rows)
    entries = summary(options, rows)
    data = {
        name: getattr(options, name)
        for name in ('scenario', 'episodes', 'steps', 'channels', 'top', 'first_seed', 'trials')
    }
    if options.json:
        print(json.dumps({**machine(), 'data': data, 'rows': entries}, indent=2))
        return
    print(', '.join(f'{name} {value}' for name, value in machine().items()))
    print(', '.join(f'{name} {value}' for name, value in data.items() if value is not None))
    print(f'\nThe optimum of the rank sum is {TASKS[options.scenario].optimum}.\n')
    print(table(options, entries), end='')


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Return the options; an invalid one ends the program with a message."""
    parser = study_parser('benchmark', __doc__, trials=5, first_seed=0, has_jobs=False)
    parser.add_argument('--scenario', choices=SCENARIOS, default='with_gravel')
    parser.add_argument('--episodes', type=number_from(2), default=100, help='default 100')
    parser.add_argument(
        '--steps',
        type=number_from(2),
        default=MAX_EPISODE_STEPS,
        help='steps per episode; more than 20 are several rounds (default %(default)s)',
    )
    parser.add_argument(
        '--channels',
        type=number_from(4),
        default=NUM_CHANNELS,
        help='channels; further ones are noise (default %(default)s)',
    )
    parser.add_argument(
        '--top', type=number_from(1), help='number of channels to rank (default: all)'
    )
    add_names(parser, '--methods', TABLE, [method for method in TABLE if method != 'paper'])
    parser.add_argument(
        '--jobs',
        type=numbers_from(1),
        default=sorted({1, joblib.cpu_count()}),
        metavar='N,...',
        help='numbers of threads of this package (default: 1 and one per core)',
    )
    parser.add_argument('--json', action='store_true', help='print JSON instead of the table')
    options = parser.parse_args(arguments)
    if options.top and options.top > options.channels:
        parser.error(f'argument --top: it is {options.top}; there are {options.channels} channels')
    return options


def main(arguments: list[str] | None = None) -> int:
    """Run the study; return the exit code."""
    options = parse(arguments)
    return exit_code('benchmark', lambda: run(options))


if __name__ == '__main__':
    sys.exit(main())
