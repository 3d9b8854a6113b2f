# SPDX-License-Identifier: Apache-2.0

"""How each constant of the test matters: power and level with other values.

Power is the mean of -log10 p of the relevant sensors, each tested given the other relevant ones.
Level is the share of p-values of at most 0.05 of irrelevant sensors, given all relevant ones.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed

from cmifs_ros.core import Episode
from cmifs_ros.core.samples import collect_samples
from cmifs_ros.core.targets import RETURN, TargetTest
from cmifs_ros.tools.program import exit_code
from studies.tasks.registry import TASKS
from studies.trials.arguments import study_parser
from studies.trials.tables import markdown_table

_GAMMA = 0.95
_TASKS = ('with_gravel', 'without_gravel', 'point_robot', 'cart_pole', 'chain')
_NUM_EPISODES = 40
#: Smaller p-values count as this one.
_LEAST = 1e-6


class Constant(NamedTuple):
    """A constant of a module of core, and alternative values."""

    module: str
    name: str
    others: tuple


CONSTANTS = (
    Constant('evidence', '_NUM_CENTERS', ((25, 25), (100, 100))),
    Constant('evidence', '_NUM_FUNCTIONS', (30, 120)),
    Constant('evidence', '_LEAST_OWN_SHARE', (1e-5, 1e-2)),
    Constant('episode_rows', '_NUM_FOLDS', (3, 10)),
    Constant('cyclic_shifts', '_MAX_SHIFTS', (20,)),
    Constant('episode_rows', '_FEWEST_BLOCKS', (3, 10)),
    Constant('episode_rows', '_NUM_STEP_COSINES', (0, 3, 10)),
    Constant('products', '_LEAST_VARIANCE', (1e-1, 1e-3)),
    Constant('kernel_regression', '_WIDTHS', ((1.2,), (0.6, 2.4))),
    Constant('kernel_regression', '_RANKS', (np.array([0, 4, 16, 64]), np.arange(12))),
    Constant('kernel_regression', '_LEAST_VARIANCE', (1e-4, 1e-9)),
    Constant('drift', '_PRICE', (2.0, 1e9)),
    Constant('evidence', '_BY_STEP', (0, 6)),
    Constant('chance', '_GREATEST', (0.99,)),
)


def outcome(task: str, seed: int) -> tuple[list[float], list[float]]:
    """Return the p-values of the relevant channels, and of the irrelevant ones."""
    of_task = TASKS[task]
    sensors = list(of_task.sensors.values())
    relevant = [c for i in of_task.relevant for c in sensors[i]]
    episodes = [Episode(e.states, e.rewards) for e in of_task.rollout(_NUM_EPISODES, seed)]
    samples = collect_samples(episodes, gamma=_GAMMA, standardize=True)
    test = TargetTest(samples, RETURN, of_task.channel_names, [], _GAMMA, random_state=seed)
    power = [float(test([(c,)], [r for r in relevant if r != c])[0]) for c in relevant]
    rest = [(c,) for c in range(samples.states.shape[1]) if c not in relevant]
    return power, test(rest, relevant).tolist()


@contextmanager
def changed(constant: Constant, value) -> Iterator[None]:
    """Temporarily set a constant to another value."""
    module = importlib.import_module(f'cmifs_ros.core.{constant.module}')
    before = getattr(module, constant.name)
    setattr(module, constant.name, value)
    try:
        yield
    finally:
        setattr(module, constant.name, before)


def measured(constant: Constant | None, value, seeds: range) -> tuple[float, float]:
    """Return the power and the level, with one constant changed or none."""

    def all_outcomes():
        return [outcome(task, seed) for task in _TASKS for seed in seeds]

    if constant is None:
        outcomes = all_outcomes()
    else:
        with changed(constant, value):
            outcomes = all_outcomes()
    power = [p for of_relevant, _ in outcomes for p in of_relevant]
    level = [p for _, of_rest in outcomes for p in of_rest]
    return (
        float(np.mean(-np.log10(np.maximum(power, _LEAST)))),
        float(np.mean(np.array(level) <= 0.05)),
    )


def run(options: argparse.Namespace) -> None:
    """Measure each constant, and print the table."""
    seeds = range(options.first_seed, options.first_seed + options.trials)
    jobs = [(None, None)] + [(c, value) for c in CONSTANTS for value in c.others]
    results = Parallel(options.jobs or -1)(delayed(measured)(*job, seeds) for job in jobs)
    rows = []
    for (constant, value), (power, level) in zip(jobs, results, strict=True):
        name = f'{constant.module}.{constant.name}' if constant else 'as they are'
        shown = '' if constant is None else np.array2string(np.asarray(value), threshold=6)
        rows.append((name, shown, f'{power:.2f}', f'{level:.1%}'))
    print(f'\n{options.trials} trials, seeds {seeds.start} to {seeds.stop - 1}.\n')
    print(markdown_table(('constant', 'set to', 'power', 'level at 5 %'), rows), end='')


def main(arguments: list[str] | None = None) -> int:
    """Run the study; return the exit code."""
    parser = study_parser('constants', __doc__, trials=16, first_seed=1000)
    options = parser.parse_args(arguments)
    return exit_code('constants', lambda: run(options), 'nothing is kept')


if __name__ == '__main__':
    sys.exit(main())
