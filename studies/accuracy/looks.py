# SPDX-License-Identifier: Apache-2.0

"""Repeated selections: how often an irrelevant sensor is ever confirmed.

Ten channels and the rewards are independent. Like the selector node, each look takes the newest
episodes, at the level from `core.looks`, and begins with the sensors confirmed before. A second
table, with one relevant sensor, shows how many more episodes this needs than a single look at the
full level.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from joblib import Parallel, delayed

from cmifs_ros.core import Episode
from cmifs_ros.core.looks import level_of_look
from cmifs_ros.core.selection import select
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
) -> list[set[str]]:
    """Return what is confirmed at each look; without spending, each look has the full level."""
    names = [f'x{i}' for i in range(_NUM_CHANNELS)]
    episodes: list[Episode] = []
    confirmed: set[str] = set()
    looks = []
    for look in range(1, options.looks + 1):
        while len(episodes) < look * options.every:
            episodes.append(episode_of(seed, len(episodes), weight))
        newest = episodes[-options.buffer :]
        level = _SIGNIFICANCE
        if spends:
            level = level_of_look(level, len(episodes), options.every, options.buffer)
        settings = {'significance': level, 'random_state': look}
        start = confirmed if spends else ()
        selection = select(newest, names, 'conditional_mi', settings, start=start)
        confirmed = set(selection.confirmed)
        looks.append(confirmed)
    return looks


def first_look(looks: list[set[str]], name: str) -> float:
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
            for a, b in zip(spent, whole, strict=True)
        ]
        print('episodes until the relevant sensor is confirmed, and at the full level:')
        for by_spending, by_whole in pairs:
            print(f'  {by_spending:g}  {by_whole:g}')
        ratio = np.median([a / b for a, b in pairs])
        print(f'median ratio: {ratio:.2f}')
    runs = of_all(0.0, True)
    ever = sum(any(looks) for looks in runs)
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
