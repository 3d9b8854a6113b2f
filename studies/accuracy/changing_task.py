# SPDX-License-Identifier: Apache-2.0

"""How soon the selection is right again after the task has changed.

A hundred episodes of one task are followed by episodes of another. At intervals, selections are
made from the newest hundred, from these without the outdated ones, and from the new ones alone, as
if the moment of the change were known.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cmifs_ros.core import Episode
from cmifs_ros.core.selecting import select
from cmifs_ros.tools.program import exit_code
from studies.tasks.registry import TASKS
from studies.trials.arguments import study_parser
from studies.trials.parallel import results_of
from studies.trials.tables import markdown_table

WINDOW, LEAST_KEPT = 100, 20
NEW_EPISODES = (0, 20, 40, 60, 80, 100)


def moved(episodes: list[Episode]) -> list[Episode]:
    """Return episodes of the point robot with its goal, and so its positions, 2 units further."""
    return [Episode(e.states + 2.0 * (np.arange(e.num_channels) == 0), e.rewards) for e in episodes]


class Change(NamedTuple):
    """The task before and after the change, and a modification of its episodes.

    A right selection has the relevant sensors and no others, except for weakly informative ones.
    """

    before: str
    after: str
    alter: Callable[[list[Episode]], list[Episode]] = list
    weakly_informative: frozenset[str] = frozenset()


CHANGES = {
    'gravel is laid': Change('without_gravel', 'with_gravel'),
    'gravel is taken away': Change('with_gravel', 'without_gravel'),
    'the goal of the point robot is moved': Change(
        'point_robot', 'point_robot', moved, frozenset({'vx', 'vy'})
    ),
}


def follow(change: str, seed: int) -> list[tuple[bool, bool, bool, int]]:
    """Return, by number of new episodes, which selections are right and what was forgotten."""
    before, after, alter, weakly_informative = CHANGES[change]
    stream = TASKS[before].rollout(WINDOW, seed)
    stream += alter(TASKS[after].rollout(WINDOW, seed + 1_000_000))
    names = TASKS[after].channel_names
    relevant = {names[c] for c in TASKS[after].relevant}
    found = []

    def selected(episodes, least_kept=None):
        options = {'random_state': seed}
        return select(episodes, names, 'conditional_mi', options, least_kept=least_kept)

    def is_right(selection):
        return set(selection.names) - weakly_informative == relevant

    for count in NEW_EPISODES:
        window = stream[count : count + WINDOW]
        kept, forgotten = selected(window), selected(window, LEAST_KEPT)
        alone = count > 0 and is_right(selected(window[-count:]))
        found.append((is_right(kept), is_right(forgotten), alone, forgotten.outdated))
    return found


def run(options: argparse.Namespace) -> None:
    """Simulate all changes, then print the table."""
    rows = []
    for change in CHANGES:
        seeds = range(options.first_seed, options.first_seed + options.trials)
        with results_of(follow, [(change, seed) for seed in seeds], options.jobs) as results:
            found = np.array(list(results))
        for count, (kept, forgotten, alone, outdated) in zip(
            NEW_EPISODES, found.transpose(1, 2, 0), strict=True
        ):
            rows.append((
                change,
                count,
                f'{kept.mean():.0%}',
                f'{forgotten.mean():.0%}',
                f'{alone.mean():.0%}',
                f'{np.mean(outdated > 0):.0%}',
                f'{np.median(outdated[outdated > 0]):.0f}' if outdated.any() else '',
            ))  # fmt: skip
    print(f'\n{options.trials} trials, seeds from {options.first_seed}.\n')
    head = (
        *('change', 'new episodes', f'right from the newest {WINDOW}'),
        *('right where the outdated are forgotten', 'right from the new ones alone'),
        *('forgotten in', 'episodes forgotten (median)'),
    )
    print(markdown_table(head, rows), end='')


def main(arguments: list[str] | None = None) -> int:
    """Run the study; return the exit code."""
    parser = study_parser('changing_task', __doc__, first_seed=1000)
    options = parser.parse_args(arguments)
    return exit_code('changing_task', lambda: run(options))


if __name__ == '__main__':
    sys.exit(main())
