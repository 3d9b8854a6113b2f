# SPDX-License-Identifier: Apache-2.0

"""Figures 6 and 7 of Hachiya & Sugiyama (2010), recomputed.

Trials run side by side, on this machine or on a Dask cluster. An interrupted run continues
where it stopped when the same command is given again.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from cmifs_ros.tools.arguments import folder_to_write, number_from
from cmifs_ros.tools.program import exit_code
from studies.trials.arguments import add_names, study_parser
from studies.trials.log import TrialLog
from studies.trials.parallel import finish

from .figures import markdown, plan, save_figures

FIGURES = ('6a', '6b', '7')
#: The method of the paper, its baseline, and the default of this package.
METHODS = ('paper', 'kdr', 'default')


def run(options: argparse.Namespace) -> None:
    """Run the missing trials, then draw and tabulate the requested ones."""
    log = TrialLog(options.out / 'trials.csv')
    wanted = plan(
        options.figure, options.methods, options.episodes, options.trials, options.first_seed
    )
    done = sum(trial in log.outcomes for trial in wanted)
    print(f'{len(wanted)} trials, {done} of them already in {options.out / "trials.csv"}')
    results = finish(wanted, log, options.jobs, options.scheduler)
    table = markdown(results, options.figure)
    (options.out / 'table.md').write_text(table)
    paths = save_figures(results, options.figure, options.out)
    print(f'\n{table}\nwritten: {", ".join(map(str, [options.out / "table.md", *paths]))}')


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Return the options; an invalid one ends the program with a message."""
    episodes = '10,20,30,40,50,60,70,80,90,100'  # Figure 7 uses the greatest.
    parser = study_parser(
        'reproduce_paper', __doc__, first_seed=0, episodes=episodes, has_jobs=False
    )
    parser.add_argument('--figure', choices=(*FIGURES, 'all'), default='all')
    add_names(parser, '--methods', METHODS, METHODS)
    parser.add_argument(
        '--out',
        type=folder_to_write,
        default=Path('reproduction'),
        metavar='DIR',
        help='folder of the results, and of the trials to continue with (default %(default)s)',
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        '--jobs', type=number_from(1), help='number of processes (default: one per core)'
    )
    where.add_argument(
        '--scheduler', metavar='ADDRESS', help='run on the cluster of this Dask scheduler'
    )
    options = parser.parse_args(arguments)
    options.figure = FIGURES if options.figure == 'all' else (options.figure,)
    return options


def main(arguments: list[str] | None = None) -> int:
    """Run the study; return the exit code."""
    options = parse(arguments)
    return exit_code(
        'reproduce_paper', lambda: run(options), 'the same command continues where it stopped'
    )


if __name__ == '__main__':
    sys.exit(main())
