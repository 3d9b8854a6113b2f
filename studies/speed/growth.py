# SPDX-License-Identifier: Apache-2.0

"""How time and memory grow with episodes, steps and channels.

Each size is measured several times, each time in a separate process, on the grid world. The slope
of the logarithms is the exponent of growth.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import joblib
import numpy as np
from tqdm import tqdm

from cmifs_ros.sim import SCENARIOS
from cmifs_ros.sim.grid_world import MAX_EPISODE_STEPS, NUM_CHANNELS
from cmifs_ros.tools.arguments import folder_to_write, number_from
from cmifs_ros.tools.program import exit_code
from studies.methods.registry import METHODS
from studies.trials.arguments import names_among, numbers_from, study_parser
from studies.trials.tables import markdown_table

from .benchmark import machine
from .measurement import job_of, measure

#: Dimensions, and the default sizes to measure.
SIZES = {
    'episodes': (50, 100, 200, 500, 1000, 2000),
    'steps': (10, 20, 50, 100, 200, 500, 1000),
    'channels': (14, 25, 50, 100),
}


class Point(NamedTuple):
    """One size: the median times of the trials and the greatest memory."""

    size: int
    seconds: float
    cpu_seconds: float
    peak_bytes: int


def measure_growth(options: argparse.Namespace, dimension: str) -> list[Point]:
    """Measure all sizes of one dimension; the options give the others."""
    base = job_of(options, options.method, options.jobs, blas_threads=1)
    sizes = options.sizes or SIZES[dimension]
    measurements = {size: [] for size in sizes}
    # All sizes once, then all again: other load on the machine affects each of them.
    seeds = range(options.first_seed, options.first_seed + options.trials)
    jobs = [
        (size, base._replace(**{dimension: size}, seed=seed)) for seed in seeds for size in sizes
    ]
    for size, job in tqdm(jobs, desc=dimension, file=sys.stderr, disable=None):
        measurements[size].append(measure(job))
    return [
        Point(
            size,
            float(np.median([m.seconds for m in ms])),
            float(np.median([m.cpu_seconds for m in ms])),
            max(m.peak_bytes for m in ms),
        )
        for size, ms in measurements.items()
    ]


def exponent(points: Sequence[Point]) -> float:
    """Return the slope of log time over log size, by least squares."""
    sizes, seconds, *_ = zip(*points, strict=True)
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def table(dimension: str, points: Sequence[Point]) -> str:
    """Return the points as a table, each with the exponent since the previous one."""
    local = ['', *(f'{exponent(pair):.2f}' for pair in itertools.pairwise(points))]
    rows = [
        (
            point.size,
            f'{point.seconds:.3g}',
            slope,
            f'{point.cpu_seconds:.3g}',
            f'{point.peak_bytes / 1e6:.0f} MB',
        )
        for point, slope in zip(points, local, strict=True)
    ]
    heads = (dimension, 'seconds', 'exponent since', 'processor seconds', 'peak memory')
    return markdown_table(heads, rows)


def save_plot(dimension: str, points: Sequence[Point], path: Path) -> None:
    """Plot time and memory over size."""
    from matplotlib.figure import Figure

    sizes, seconds, _, peaks = (np.array(values) for values in zip(*points, strict=True))
    slope = exponent(points)
    figure = Figure(figsize=(8, 3.4), layout='constrained')
    left, right = figure.subplots(1, 2)
    left.loglog(sizes, seconds, 'o', color='tab:blue')
    middle = np.exp(np.mean(np.log(seconds)) - slope * np.mean(np.log(sizes)))
    left.loglog(
        sizes, middle * sizes**slope, ':', color='gray', label=f'{dimension}$^{{{slope:.2f}}}$'
    )
    left.set_ylabel('seconds')
    left.legend()
    right.semilogx(sizes, peaks / 1e6, 'o-', color='tab:orange')
    right.set_ylim(bottom=0)
    right.set_ylabel('peak memory [MB]')
    for axes in (left, right):
        axes.set_xlabel(dimension)
        axes.set_xticks(sizes, sizes)
        axes.minorticks_off()
    figure.savefig(path, dpi=150)


def run(options: argparse.Namespace) -> None:
    """Measure, print and plot each dimension."""
    options.out.mkdir(parents=True, exist_ok=True)
    print(', '.join(f'{name} {value}' for name, value in machine().items()))
    for dimension in options.dimensions:
        points = measure_growth(options, dimension)
        others = (f'{getattr(options, name)} {name}' for name in SIZES if name != dimension)
        print(
            f'\n{METHODS[options.method]}, {options.jobs} threads, {", ".join(others)}, '
            f'{"all" if options.top is None else f"the best {options.top}"} ranked, '
            f'{options.trials} trials\n\n{table(dimension, points)}'
        )
        if len(points) > 1:
            path = options.out / f'growth_{dimension}.png'
            save_plot(dimension, points, path)
            print(f'time grows with {dimension}^{exponent(points):.2f}; written: {path}')


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Return the options; an invalid one ends the program with a message."""
    parser = study_parser('benchmark_growth', __doc__, trials=3, first_seed=0, has_jobs=False)
    parser.add_argument(
        'dimensions',
        nargs='?',
        type=names_among(SIZES),
        default=','.join(SIZES),
        metavar='DIMENSION,...',
        help='dimensions to vary (default %(default)s)',
    )
    parser.add_argument(
        '--sizes', type=numbers_from(2), metavar='N,...', help='sizes, if one dimension is named'
    )
    parser.add_argument('--scenario', choices=SCENARIOS, default='with_gravel')
    parser.add_argument('--episodes', type=number_from(2), default=100, help='default 100')
    parser.add_argument('--steps', type=number_from(2), default=MAX_EPISODE_STEPS)
    parser.add_argument('--channels', type=number_from(4), default=NUM_CHANNELS)
    parser.add_argument(
        '--top', type=number_from(1), default=8, help='number of channels to rank (default 8)'
    )
    parser.add_argument('--method', choices=METHODS, default='default')
    parser.add_argument(
        '--jobs',
        type=number_from(1),
        default=joblib.cpu_count(),
        help='number of threads (default: one per core)',
    )
    parser.add_argument(
        '--out',
        type=folder_to_write,
        default=Path('growth'),
        metavar='DIR',
        help='default %(default)s',
    )
    options = parser.parse_args(arguments)
    if options.sizes and len(options.dimensions) > 1:
        parser.error('argument --sizes: name one dimension for them')
    grows = options.dimensions == ['channels'] and options.sizes
    least = options.sizes[0] if grows else options.channels
    if options.top > least:
        parser.error(f'argument --top: it is {options.top}; there are {least} channels')
    return options


def main(arguments: list[str] | None = None) -> int:
    """Run the study; return the exit code."""
    options = parse(arguments)
    return exit_code('benchmark_growth', lambda: run(options))


if __name__ == '__main__':
    sys.exit(main())
