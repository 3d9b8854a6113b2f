# SPDX-License-Identifier: Apache-2.0

"""Accuracy with few episodes: rank sums of the relevant channels on many tasks, by method.

With --number: how often the automatic number selects exactly the relevant channels.

The tasks are the paper's grid world in both scenarios, its chain, Gymnasium environments, small
synthetic worlds and a lidar world; distractor channels are appended to tasks without their own.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import numpy as np

from cmifs_ros.tools.program import CommandError, exit_code
from studies.methods import registry as methods
from studies.methods.registry import METHODS, SELECTING
from studies.tasks import registry as tasks
from studies.tasks.registry import OF_EVIDENCE, TASKS
from studies.trials.arguments import add_log, add_names, study_parser
from studies.trials.log import TrialLog, kept
from studies.trials.parallel import finish
from studies.trials.tables import markdown_table
from studies.trials.trial import Results, Trial

#: The default methods, first in the table.
USUAL_METHODS = ('default', 'paper', 'kdr', 'ennemi', 'sklearn', 'forest')
#: The methods of --number: the automatic number on the task, and with shuffled states.
NUMBER_METHODS = ('automatic', 'automatic_shuffled')
#: Methods that rank all channels.
ALL_METHODS = tuple(m for m in dict.fromkeys((*USUAL_METHODS, *METHODS)) if m not in SELECTING)
#: `with_fixed_gravel` is another reading of the paper; rank sums need relevant channels.
USUAL_TASKS = tuple(
    name
    for name, task in TASKS.items()
    if task.relevant and name not in ('with_fixed_gravel', *OF_EVIDENCE)
)


def available(names: Sequence[str], what_is_missing) -> list[str]:
    """Return the available names; print what the others need."""
    missing = {name: what_is_missing(name) for name in names}
    for name, hint in missing.items():
        if hint:
            print(f'{name}: {hint}')
    return [name for name in names if missing[name] is None]


def table(results: Results, wanted: Sequence[Trial]) -> str:
    """Return the table: a row for each task and number of episodes, a column for each method."""
    columns = [method for method in ALL_METHODS if method in results.methods]
    rows = []
    for scenario, episodes in dict.fromkeys((t.scenario, t.episodes) for t in wanted):
        cells = (
            '{:.2f} ± {:.2f}'.format(*results.rank_sum(scenario, method, episodes))
            for method in columns
        )
        task = TASKS[scenario]
        rows.append((scenario, episodes, task.optimum, f'{task.chance:g}', *cells))
    head = ('task', 'episodes', 'optimum', 'by chance', *(METHODS[m] for m in columns))
    return markdown_table(head, rows)


def number_table(results: Results, wanted: Sequence[Trial]) -> str:
    """Return the table of what trials select: a row for each task and number of episodes."""
    rows = []
    for scenario, episodes in dict.fromkeys((t.scenario, t.episodes) for t in wanted):
        relevant = set(TASKS[scenario].relevant)
        outcomes, shuffled = (results.of(scenario, m, episodes) for m in NUMBER_METHODS)
        selected = [set(outcome.ranking) for outcome in outcomes]
        rows.append(
            (
                scenario,
                episodes,
                len(relevant),
                f'{np.mean([len(s) for s in selected]):.2f}',
                f'{np.mean([s == relevant for s in selected]):.0%}',
                f'{np.mean([bool(relevant - s) for s in selected]):.0%}',
                f'{np.mean([bool(s - relevant) for s in selected]):.0%}',
                f'{np.mean([bool(o.ranking) for o in shuffled]):.0%}',
                f'{np.median([o.seconds for o in outcomes]):.1f}',
            )
        )
    head = (
        *('task', 'episodes', 'relevant', 'selected', 'exactly the relevant'),
        *('some relevant missing', 'some irrelevant selected'),
        *('shuffled: any selected', 'seconds'),
    )
    return markdown_table(head, rows)


def run(options: argparse.Namespace) -> None:
    """Run the trials, then print the table."""
    log = TrialLog(options.log)
    chosen_methods = available(
        NUMBER_METHODS if options.number else options.methods, methods.what_is_missing
    )
    chosen_tasks = available(options.tasks, tasks.what_is_missing)
    wanted = [
        Trial(task, method, episodes, number, options.first_seed + number)
        for task in chosen_tasks
        for episodes in options.episodes
        for number in range(options.trials)
        for method in chosen_methods
    ]
    if not wanted:
        raise CommandError('none of the requested packages is installed')
    results = finish(wanted, log, options.jobs)
    seeds = f'{options.first_seed} to {options.first_seed + options.trials - 1}'
    if options.number:
        print(f'\nThe automatic number in {options.trials} trials, seeds {seeds}.\n')
        print(number_table(results, wanted), end='')
    else:
        print(f'\nMean and standard error of {options.trials} trials, seeds {seeds}.\n')
        print(table(results, wanted), end='')


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Return the options; an invalid one ends the program with a message."""
    parser = study_parser('accuracy', __doc__, first_seed=1000, episodes='20,40,100')
    add_names(parser, '--tasks', TASKS, USUAL_TASKS)
    add_names(parser, '--methods', ALL_METHODS, USUAL_METHODS)
    parser.add_argument(
        '--number',
        action='store_true',
        help='instead of rank sums: what the automatic number selects, on the task and with the '
        'states shuffled between episodes',
    )
    add_log(parser)
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Run the study; return the exit code."""
    options = parse(arguments)
    return exit_code('accuracy', lambda: run(options), kept(options.log))


if __name__ == '__main__':
    sys.exit(main())
