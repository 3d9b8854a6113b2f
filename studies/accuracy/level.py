# SPDX-License-Identifier: Apache-2.0

"""The level of the test and its parts, in worlds where a test easily fails.

In each world, irrelevant sensors of four types are tested given the relevant ones, by each part of
the test and by both. The tables show how often a p-value is at most 0.05, and 0.005, and in how
many recordings the whole procedure confirms an irrelevant sensor.
"""

from __future__ import annotations

import argparse
import sys
import time

import numpy as np

from cmifs_ros.core.products import PARTS, SHIFTS, SIGNS
from cmifs_ros.core.samples import collect_samples
from cmifs_ros.core.targets import RETURN, TargetTest
from cmifs_ros.tools.program import exit_code
from studies.tasks.level_worlds import KINDS, LEVEL_WORLDS
from studies.tasks.registry import TASKS, what_is_missing
from studies.trials.arguments import add_log, add_names, study_parser
from studies.trials.log import TrialLog, kept
from studies.trials.parallel import finish
from studies.trials.statistics import mean_and_error
from studies.trials.tables import markdown_table
from studies.trials.trial import Outcome, Results, Trial, run_trial

GAMMA = 0.95
LEVELS = (0.05, 0.005)
#: Results of a recording: the p-values of the parts, and the selection of the whole procedure.
OF_PARTS, WHOLE = 'parts', 'automatic'


def irrelevant_channels(world: str) -> list[int]:
    """Return the irrelevant channels of a world."""
    task = TASKS[world]
    return [c for c in range(len(task.channel_names)) if c not in task.relevant]


def pvalues_of_parts(trial: Trial) -> Outcome:
    """Return the p-values of all irrelevant channels given the relevant ones, part by part."""
    task, start = TASKS[trial.scenario], time.perf_counter()
    episodes = task.rollout(trial.episodes, trial.seed)
    samples = collect_samples(episodes, gamma=GAMMA, standardize=True)
    candidates = [(c,) for c in irrelevant_channels(trial.scenario)]
    pvalues: list[float] = []
    for part in PARTS:
        test = TargetTest(
            samples,
            RETURN,
            task.channel_names,
            [],
            GAMMA,
            random_state=trial.seed,
            parts=(part,),
        )
        pvalues += [float(f'{p:.4g}') for p in test(candidates, list(task.relevant))]
    return Outcome(trial, tuple(pvalues), time.perf_counter() - start)


def run_either(trial: Trial) -> Outcome:
    """Run a trial of the parts, or of the whole procedure."""
    return pvalues_of_parts(trial) if trial.method == OF_PARTS else run_trial(trial)


def shares(pvalues: np.ndarray, level: float) -> str:
    """Return the share of p-values, shape (trials, k), up to a level, and its standard error.

    Trials are independent; the sensors of one trial are not.
    """
    mean, error = mean_and_error((pvalues <= level).mean(axis=1))
    return f'{mean:.1%} ± {error:.1%}'


def rows_of(world: str, num_episodes: int, results: Results) -> list[tuple]:
    """Return the rows of a world's table, one for each part and one for both."""
    channels = irrelevant_channels(world)
    kinds = np.array([TASKS[world].channel_names[c].split('_')[0] for c in channels])
    found = np.array([outcome.ranking for outcome in results.of(world, OF_PARTS, num_episodes)])
    of_parts = dict(zip(PARTS, np.split(found, len(PARTS), axis=1), strict=True))
    # Up to the level of the test, the greater of both counts.
    of_parts['both'] = np.maximum(of_parts[SIGNS], of_parts[SHIFTS])
    wrong = [bool(set(channels) & set(o.ranking)) for o in results.of(world, WHOLE, num_episodes)]
    selected = '{:.1%} ± {:.1%}'.format(*mean_and_error(wrong))
    return [
        (
            world,
            num_episodes,
            part,
            *(shares(pvalues, level) for level in LEVELS),
            *(shares(pvalues[:, kinds == kind], LEVELS[0]) for kind in KINDS),
            selected if part == 'both' else '',
        )
        for part, pvalues in of_parts.items()
    ]


def run(options: argparse.Namespace) -> None:
    """Run the trials, then print the table."""
    log = TrialLog(options.log, number=float)
    missing = {world: what_is_missing(world) for world in options.worlds}
    for world, hint in missing.items():
        if hint:
            print(f'{world}: {hint}')
    cells = [(w, n) for w in options.worlds if not missing[w] for n in LEVEL_WORLDS[w].episodes]
    last = options.first_seed + options.trials - 1
    wanted = [
        Trial(world, method, num_episodes, number, options.first_seed + number)
        for number in range(options.trials)
        for world, num_episodes in cells
        for method in (OF_PARTS, WHOLE)
    ]
    results = finish(wanted, log, options.jobs, run=run_either)
    print(f'\n{options.trials} draws of each world, seeds {options.first_seed} to {last}.\n')
    head = (
        *('world', 'episodes', 'part', *(f'p <= {level:g}' for level in LEVELS)),
        *(f'{kind}, p <= {LEVELS[0]:g}' for kind in KINDS),
        'something irrelevant confirmed in',
    )
    print(markdown_table(head, [row for cell in cells for row in rows_of(*cell, results)]), end='')


def main(arguments: list[str] | None = None) -> int:
    """Run the study; return the exit code."""
    parser = study_parser('level', __doc__, trials=200, first_seed=1000)
    add_names(parser, '--worlds', LEVEL_WORLDS, LEVEL_WORLDS)
    add_log(parser)
    options = parser.parse_args(arguments)
    return exit_code('level', lambda: run(options), kept(options.log))


if __name__ == '__main__':
    sys.exit(main())
