# SPDX-License-Identifier: Apache-2.0

"""The best possible result with this score: an oracle knows all relevant channels but one.

Given the others, it ranks the unknown one among the irrelevant channels. Its rank sum is the
optimum plus the number of irrelevant channels that score higher. Forward selection, which must find
the others too, can hardly do better.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from cmifs_ros.core import Lsmi
from cmifs_ros.tools.program import exit_code
from studies.methods.registry import criterion_of
from studies.tasks.registry import TASKS, what_is_missing
from studies.trials.arguments import add_names, study_parser
from studies.trials.parallel import results_of
from studies.trials.statistics import mean_and_error
from studies.trials.tables import markdown_table

from .rank_sums import USUAL_TASKS


def ranked_higher(task: str, num_episodes: int, seed: int) -> list[int]:
    """Return the number of irrelevant sensors that score higher than each relevant one."""
    episodes = TASKS[task].rollout(num_episodes, seed)
    criterion = criterion_of(Lsmi(), episodes, seed)
    parts = list(TASKS[task].sensors.values())
    relevant = TASKS[task].relevant
    irrelevant = [s for s in range(len(parts)) if s not in relevant]
    found = []
    for unknown in relevant:
        known = [c for c in relevant if c != unknown]
        sets = ([*known, sensor] for sensor in (unknown, *irrelevant))
        scores = criterion([[c for sensor in sensors for c in parts[sensor]] for sensors in sets])
        found.append(int(np.sum(scores[1:] > scores[0])))
    return found


def run(options: argparse.Namespace) -> None:
    """Ask the oracle, then print the table."""
    rows = []
    for task in options.tasks:
        if what_is_missing(task):
            print(f'{task}: {what_is_missing(task)}')
            continue
        for num_episodes in options.episodes:
            seeds = range(options.first_seed, options.first_seed + options.trials)
            arguments = ((task, num_episodes, seed) for seed in seeds)
            with results_of(ranked_higher, arguments, options.jobs) as results:
                found = list(results)
            for sensor, higher in zip(TASKS[task].relevant, zip(*found, strict=True), strict=True):
                mean, error = mean_and_error(higher)
                rows.append((
                    task,
                    num_episodes,
                    TASKS[task].sensor_names[sensor],
                    f'{TASKS[task].optimum + mean:.2f} ± {error:.2f}',
                    sum(count > 0 for count in higher),
                ))  # fmt: skip
    print(f'\n{options.trials} trials, seeds from {options.first_seed}.\n')
    head = ('task', 'episodes', 'not known', 'rank sum', 'trials that miss it')
    print(markdown_table(head, rows), end='')


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Return the options; an invalid one ends the program with a message."""
    parser = study_parser('accuracy_oracle', __doc__, first_seed=1000, episodes='20,40')
    add_names(parser, '--tasks', USUAL_TASKS, ('without_gravel', 'with_gravel'))
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Run the study; return the exit code."""
    options = parse(arguments)
    return exit_code('accuracy_oracle', lambda: run(options))


if __name__ == '__main__':
    sys.exit(main())
