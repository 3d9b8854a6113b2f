# SPDX-License-Identifier: Apache-2.0

"""How often the evidence is right: the right sensors are confirmed, and no others.

Each row of the table asks one question about one task. `shuffled` is the same task with the states
of other episodes, so that no sensor is relevant.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cmifs_ros.tools.program import exit_code
from studies.methods.registry import METHODS
from studies.tasks.registry import TASKS, what_is_missing
from studies.trials.arguments import add_log, add_names, study_parser
from studies.trials.log import TrialLog, kept
from studies.trials.parallel import finish
from studies.trials.tables import markdown_table
from studies.trials.trial import Trial

#: Takes the selected names in order, the relevant ones and the others; returns whether a trial
#: shows what is asked for, or to what share.
Question = Callable[[list[str], set[str], set[str]], float]


def exactly(selected: list[str], relevant: set[str], others: set[str]) -> bool:
    """All relevant sensors and no others."""
    return set(selected) == relevant


def are_first(selected: list[str], relevant: set[str], others: set[str]) -> bool:
    """All relevant sensors, before any others."""
    return set(selected[: len(relevant)]) == relevant


def all_found(selected: list[str], relevant: set[str], others: set[str]) -> bool:
    """All relevant sensors, and possibly others."""
    return relevant <= set(selected)


def one_of_a_pair(selected: list[str], relevant: set[str], others: set[str]) -> bool:
    """Either x or its copy, and the weaker sensor y."""
    return len({'x', 'copy'} & set(selected)) == 1 and 'y' in selected


def the_other_of_a_pair(selected: list[str], relevant: set[str], others: set[str]) -> bool:
    """Either x or its copy, and no others."""
    return len(selected) == 1 and selected[0] in ('x', 'copy')


def anything(selected: list[str], relevant: set[str], others: set[str]) -> bool:
    """Any sensor at all."""
    return bool(selected)


def anything_else(selected: list[str], relevant: set[str], others: set[str]) -> bool:
    """Any irrelevant sensor."""
    return bool(set(selected) - relevant)


def a_force(selected: list[str], relevant: set[str], others: set[str]) -> bool:
    """Either force, or both."""
    return bool(set(selected) & relevant)


def noise(selected: list[str], relevant: set[str], others: set[str]) -> bool:
    """Noise."""
    return any(name.startswith('noise_') for name in selected)


def the_weak_one(selected: list[str], relevant: set[str], others: set[str]) -> bool:
    """Weak sensor."""
    return 'weak' in selected


def half_a_pair(selected: list[str], relevant: set[str], others: set[str]) -> bool:
    """One of two sensors that matter only together."""
    return bool(set(selected) & relevant)


def share_of_irrelevant(selected: list[str], relevant: set[str], others: set[str]) -> float:
    """Each irrelevant sensor."""
    return len(set(selected) & others) / len(others)


#: The name of this package's method in tables.
OURS = ('default', 'automatic', 'automatic_shuffled')


class Row(NamedTuple):
    """A question, with the required share of trials."""

    task: str
    episodes: int
    question: Question
    asked: str
    method: str = 'automatic'


ROWS = (
    Row('point_robot', 60, are_first, '>= 90 %'),
    Row('point_robot', 60, are_first, 'to compare', 'forest'),
    Row('lidar_world', 80, are_first, 'to compare', 'default'),
    Row('lidar_world', 80, are_first, 'to compare', 'forest'),
    Row('lidar_world', 80, all_found, '>= 80 %'),
    Row('lidar_world', 80, anything_else, '<= 5 %'),
    Row('without_gravel', 100, exactly, '>= 85 %'),
    Row('with_gravel', 100, exactly, '>= 95 %'),
    Row('chain', 60, exactly, '>= 80 %'),
    Row('cart_pole', 60, exactly, '>= 80 %'),
    Row('pendulum', 60, exactly, '>= 80 %'),
    Row('copy', 60, one_of_a_pair, '>= 90 %'),
    Row('noisy_copy', 60, one_of_a_pair, '>= 90 %'),
    Row('copy', 60, the_other_of_a_pair, 'to see', 'redundant'),
    Row('noisy_copy', 60, the_other_of_a_pair, 'to see', 'redundant'),
    Row('with_gravel', 100, anything, '<= 5 %', 'redundant'),
    Row('two_switches', 60, exactly, '>= 90 %'),
    Row('wild_readings', 60, all_found, '>= 90 %'),
    Row('one_wild_reading', 60, all_found, '>= 90 %'),
    Row('one_of_twelve', 60, all_found, '>= 90 %'),
    Row('twelve_of_noise', 60, anything_else, '<= 10 %'),
    Row('dead_channel', 60, exactly, '>= 90 %'),
    Row('beside', 60, anything_else, '<= 7 % each'),
    Row('drift', 60, anything, '<= 5 %'),
    Row('wandering', 100, anything, '<= 5 %'),
    *(
        Row(f'readme_reward_{factor}', 60, question, asked, method)
        for factor, power in (('0.1', 'to see'), ('1', '>= 90 %'), ('10', '>= 90 %'))
        for question, asked, method in (
            *((all_found, power, 'automatic'), (all_found, 'to compare', 'linear')),
            (noise, '<= 5 %', 'automatic'),
        )
    ),
    Row('rare_goal', 150, all_found, '>= 90 %'),
    Row('rare_goal', 150, all_found, 'to compare', 'linear'),
    Row('rare_goal', 150, anything_else, '<= 5 %'),
    Row('one_great_penalty', 60, all_found, '>= 90 %'),
    Row('grasps', 80, a_force, '>= 80 %'),
    Row('grasps', 80, anything_else, '<= 5 %'),
    Row('heavy_tails', 60, anything_else, '<= 5 %'),
    *(
        Row(f'windows_memory_{memory}', windows, anything, '<= 5 %')
        for memory in (0, 50, 200, 1000)
        for windows in (50, 200)
    ),
    *(
        Row('weak_sensor', episodes, question, asked, method)
        for episodes in (400, 1600)
        for question, asked, method in (
            *((the_weak_one, 'as the linear model', 'automatic'), (noise, '<= 5 %', 'automatic')),
            *((the_weak_one, 'to compare', 'linear'), (are_first, 'to compare', 'forest')),
        )
    ),
    *(
        Row(fleet, 60, question, asked)
        for fleet in ('fleet', 'fleet_without_sources')
        for question, asked in ((all_found, '>= 80 %'), (anything_else, '<= 5 %'))
    ),
    *(
        Row('three_percent', episodes, the_weak_one, '<= 5 %', 'dispensable')
        for episodes in (30, 60, 100, 300)
    ),
    *(
        Row(task, 100, share_of_irrelevant, '>= 80 %', 'dispensable')
        for task in ('three_percent', 'without_gravel', 'with_gravel')
    ),
    *(
        Row(pair, episodes, half_a_pair, 'never', 'dispensable')
        for pair, numbers in (
            *(('two_switches', (10, 20)), ('faint_switches', (30, 100))),
            ('faint_product', (30, 100)),
        )
        for episodes in numbers
    ),
    *(Row('independent_noise', episodes, anything, '<= 5 %') for episodes in (6, 10, 15)),
    *(
        Row(task, episodes, anything, '<= 5 %', 'automatic_shuffled')
        for task, episodes in (
            *(('point_robot', 60), ('lidar_world', 80), ('without_gravel', 100)),
            *(('with_gravel', 100), ('chain', 60), ('cart_pole', 60), ('pendulum', 60)),
        )
    ),
)


def run(options: argparse.Namespace) -> None:
    """Run the trials, then print the table."""
    log = TrialLog(options.log)
    missing = {task: what_is_missing(task) for task in options.tasks}
    for task, hint in missing.items():
        if hint:
            print(f'{task}: {hint}')
    rows = [row for row in ROWS if row.task in missing and not missing[row.task]]
    numbers = range(options.trials)
    wanted = dict.fromkeys(
        Trial(row.task, row.method, row.episodes, number, options.first_seed + number)
        for row in rows
        for number in numbers
    )
    results = finish(list(wanted), log, options.jobs)
    last = options.first_seed + options.trials - 1
    print(f'\n{options.trials} trials, seeds {options.first_seed} to {last}.\n')
    table = []
    for row in rows:
        task = TASKS[row.task]
        relevant = {task.sensor_names[i] for i in task.relevant}
        others = set(task.sensor_names) - relevant
        outcomes = results.of(row.task, row.method, row.episodes)
        answers = [
            row.question([task.sensor_names[i] for i in outcome.ranking], relevant, others)
            for outcome in outcomes
        ]
        share = np.mean(answers)
        error = np.std(answers) / np.sqrt(len(answers))
        table.append(
            (
                row.task + ', shuffled' * (row.method == 'automatic_shuffled'),
                row.episodes,
                row.question.__doc__.rstrip('.'),
                'ours' if row.method in OURS else METHODS[row.method],
                row.asked,
                f'{share:.0%} ± {error:.0%}',
                f'{np.median([outcome.seconds for outcome in outcomes]):.1f}',
            )
        )
    head = ('task', 'episodes', 'selected', 'by', 'asked', 'found in', 'seconds')
    print(markdown_table(head, table), end='')


def main(arguments: list[str] | None = None) -> int:
    """Run the study; return the exit code."""
    parser = study_parser('evidence', __doc__, first_seed=1000)
    names = list(dict.fromkeys(row.task for row in ROWS))
    add_names(parser, '--tasks', names, names)
    add_log(parser)
    options = parser.parse_args(arguments)
    return exit_code('evidence', lambda: run(options), kept(options.log))


if __name__ == '__main__':
    sys.exit(main())
