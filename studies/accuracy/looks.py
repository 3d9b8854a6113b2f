# SPDX-License-Identifier: Apache-2.0

"""Repeated selections: how often an irrelevant sensor is ever confirmed.

Ten channels and the rewards are independent. Like the selector node, each look takes the episodes
of a buffer, at the level from `core.looks`, begins with the sensors confirmed before, and forgets
the episodes from before a change of the task, which here is always a false alarm. A second table,
with one relevant sensor, shows how many more episodes this needs than a single look at the full
level.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from joblib import Parallel, delayed

from cmifs_ros.collect.episodes.buffer import EpisodeBuffer
from cmifs_ros.core import Episode
from cmifs_ros.core.looks import level_of_look
from cmifs_ros.core.selecting import select
from cmifs_ros.tools.arguments import number_from
from cmifs_ros.tools.program import exit_code

_NUM_CHANNELS, _NUM_STEPS = 10, 12
_SIGNIFICANCE = 0.05
#: Weight of the first channel, if one is relevant.
_WEIGHT = 0.25


def episode_of(seed: int, number: int, weight: float) -> Episode:
    """Return an episode of slow channels and a reward that depends on the first, or on none."""
    rng = np.random.default_rng([seed, number])
    states = rng.normal(size=(_NUM_STEPS, _NUM_CHANNELS))
    for t in range(1, _NUM_STEPS):
        states[t] = 0.8 * states[t - 1] + 0.6 * states[t]
    return Episode(states, weight * states[:, 0] + rng.normal(size=_NUM_STEPS))


def confirmed_at_looks(
    seed: int, weight: float, options: argparse.Namespace, *, spends: bool
) -> tuple[list[tuple[str, ...]], int]:
    """Return what is confirmed at each look, and how often a change of the task was found.

    Without spending, each look is on its own and has the full level.
    """
    names = [f'x{i}' for i in range(_NUM_CHANNELS)]
    buffer = EpisodeBuffer(max(options.buffer, options.every))
    start: tuple[str, ...] = ()
    looks, num_changes = [], 0
    for look in range(options.looks):
        for number in range(look * options.every, (look + 1) * options.every):
            buffer.append(episode_of(seed, number, weight))
        held, level, chosen = buffer.snapshot(), _SIGNIFICANCE, {}
        if spends:
            level = level_of_look(level, buffer.renewals, options.every)
            chosen = {'start': start, 'least_kept': options.every}
        selection = select(held, names, 'conditional_mi', {'significance': level}, **chosen)
        if selection.outdated:
            num_changes += 1
            buffer.forget(held[: selection.outdated])
        if selection.indices:  # Else the one before stays in use.
            start = selection.confirmed
        looks.append(selection.confirmed)
    return looks, num_changes


def first_look(looks: list[tuple[str, ...]], name: str) -> float:
    """Return the number of the first look at which a sensor is confirmed; inf if none."""
    return next((i + 1 for i, found in enumerate(looks) if name in found), np.inf)


def run(options: argparse.Namespace) -> None:
    """Run the trials and print the results."""
    seeds = range(options.first_seed, options.first_seed + options.trials)

    def of_all(weight, spends):
        job = delayed(confirmed_at_looks)
        return Parallel(options.jobs)(job(s, weight, options, spends=spends) for s in seeds)

    if options.power:
        spent, whole = of_all(_WEIGHT, True), of_all(_WEIGHT, False)
        pairs = [
            (first_look(a, 'x0') * options.every, first_look(b, 'x0') * options.every)
            for (a, _), (b, _) in zip(spent, whole, strict=True)
        ]
        print('episodes until the relevant sensor is confirmed, and at the full level:')
        for by_spending, by_whole in pairs:
            print(f'  {by_spending:g}  {by_whole:g}')
        ratio = np.median([a / b for a, b in pairs])
        print(f'median ratio: {ratio:.2f}')
    runs = of_all(0.0, True)
    print(f'changes of the task found: {sum(num_changes for _, num_changes in runs)}')
    ever = sum(any(looks) for looks, _ in runs)
    print(f'ever confirmed: {ever} of {len(runs)} runs, {options.looks} looks each')


def main(arguments: list[str] | None = None) -> int:
    """Run the study; return the exit code."""
    parser = argparse.ArgumentParser(
        prog='looks', description=' '.join(__doc__.split()), allow_abbrev=False
    )
    parser.add_argument('--trials', type=number_from(1), default=100)
    parser.add_argument('--looks', type=number_from(1), default=20)
    parser.add_argument('--every', type=number_from(1), default=20, help='episodes between looks')
    parser.add_argument('--buffer', type=number_from(2), default=400, help='episodes kept')
    parser.add_argument(
        '--power',
        action='store_true',
        help='also measure how much later the relevant sensor is confirmed',
    )
    parser.add_argument('--first-seed', type=number_from(0), default=1000)
    parser.add_argument('--jobs', type=number_from(1), default=2)
    options = parser.parse_args(arguments)
    return exit_code('looks', lambda: run(options), 'nothing is kept')


if __name__ == '__main__':
    sys.exit(main())
