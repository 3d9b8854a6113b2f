# SPDX-License-Identifier: Apache-2.0

"""Whether learning gets easier: fitted Q iteration on all channels, and on those selected.

The policy learned from the same episodes on all channels, on ours, on KDR's and on the relevant
ones acts in fresh episodes; the table shows its mean return. Ours takes its automatic number,
KDR is told how many are relevant. With `again` the second half of the episodes is collected by what
was learned from the first, and what is seen is chosen anew from all of them, as the selector of a
running robot does. An interrupted run goes on where it was.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import sys
import time
import warnings
from collections import Counter
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from cmifs_ros.core import ConditionalMISelector, Episode, KDRSelector
from cmifs_ros.tools.arguments import file_to_write
from cmifs_ros.tools.program import CommandError, exit_code
from studies.tasks.registry import TASKS, what_is_missing
from studies.trials.arguments import add_names, study_parser
from studies.trials.parallel import results_of
from studies.trials.statistics import mean_and_error
from studies.trials.tables import markdown_table

from .fitted_q import REGRESSORS, FittedQ
from .worlds import LEARNING_TASKS, Transitions, collect, returns_of

SEES = ('all', 'ours', 'kdr', 'relevant', 'all_again', 'ours_again', 'relevant_again')
#: Share of random actions where a learned policy collects.
EXPLORATION = 0.2
#: The seed of trial 0.
FIRST_SEED = 1000
FRESH_EPISODES = 100
NUM_DECISIONS = 50
COLUMNS = ('task', 'episodes', 'sees', 'trial', 'regressor', 'channels', 'behaviour', 'return',
           'seconds', 'ms_per_decision')  # fmt: skip


class Case(NamedTuple):
    """One choice of channels in one trial; all regressors learn on it."""

    task: str
    episodes: int
    sees: str
    trial: int


def choose(case: Case, episodes: list[Episode]) -> list[int]:
    """Return the channels that the learner sees."""
    task = TASKS[case.task]
    chosen_by = case.sees.removesuffix('_again')
    if chosen_by == 'all':
        return list(range(len(task.channel_names)))
    if chosen_by == 'relevant':
        return list(task.relevant)
    if chosen_by == 'ours':
        selector = ConditionalMISelector(random_state=case.trial)
    else:
        selector = KDRSelector(len(task.relevant), target=task.target, random_state=case.trial)
    # With no evidence for anything a robot goes on with all it has.
    return selector.fit(episodes).get_support(indices=True).tolist() or list(
        range(len(task.channel_names))
    )


def gather(case: Case, regressor: str, seed: int) -> tuple[list[Episode], Transitions, list[int]]:
    """Return the episodes of the behaviour, all transitions to learn from, and the channels."""
    if not case.sees.endswith('_again'):
        episodes, transitions = collect(case.task, case.episodes, seed)
        return episodes, transitions, choose(case, episodes)
    num_actions = LEARNING_TASKS[case.task].num_actions
    episodes, transitions = collect(case.task, case.episodes // 2, seed)
    policy = FittedQ(transitions, choose(case, episodes), num_actions, regressor, seed=seed)

    def explore(state, rng):
        is_random = rng.random() < EXPLORATION
        return int(rng.integers(num_actions) if is_random else policy.act(state[None])[0])

    rest = case.episodes - len(episodes)
    improved, further = collect(case.task, rest, seed + 2_000_000, explore)
    transitions = Transitions(*map(np.concatenate, zip(transitions, further, strict=True)))
    return episodes, transitions, choose(case, episodes + improved)


def run_case(case: Case, regressors: list[str]) -> list[tuple]:
    """Choose, learn and act; return a row of `COLUMNS` for each regressor."""
    warnings.filterwarnings('ignore', message='lbfgs failed to converge')  # Few are meant.
    seed = FIRST_SEED + case.trial
    rows = []
    for regressor in regressors:
        if not rows or case.sees.endswith('_again'):  # Else it is the same for all.
            episodes, transitions, channels = gather(case, regressor, seed)
        begin = time.perf_counter()
        policy = FittedQ(
            transitions, channels, LEARNING_TASKS[case.task].num_actions, regressor, seed=seed
        )
        seconds = time.perf_counter() - begin
        behaviour = np.mean([episode.rewards.sum() for episode in episodes])
        # Fresh episodes are the same ones for all that are compared, and not those learned from.
        returns = returns_of(case.task, policy.act, FRESH_EPISODES, seed + 1_000_000)
        begin = time.perf_counter()
        for state in transitions.states[:NUM_DECISIONS]:
            policy.act(state[None])
        decision = (time.perf_counter() - begin) / min(NUM_DECISIONS, len(transitions.states))
        shown = ' '.join(map(str, channels))
        rows.append((*case, regressor, shown, f'{behaviour:.4f}', f'{returns.mean():.4f}',
                     f'{seconds:.2f}', f'{1000 * decision:.3f}'))  # fmt: skip
    return rows


def read(path: Path) -> list[dict[str, str]]:
    """Return the rows that a file holds; a last line without its end is dropped from it."""
    content = path.read_text() if path.exists() else ''
    complete = content[: content.rfind('\n') + 1]
    if not complete:
        path.write_text(','.join(COLUMNS) + '\n')
        return []
    path.write_text(complete)
    head, *rows = csv.reader(complete.splitlines())
    if tuple(head) != COLUMNS:
        raise CommandError(f'{path} begins with {head}; expected {COLUMNS}: move it away')
    return [dict(zip(COLUMNS, row, strict=True)) for row in rows]


def learned_table(rows: list[dict[str, str]], options: argparse.Namespace, tasks: list[str]) -> str:
    """Return the mean return that is learned on each choice of channels, as Markdown."""
    lines = []
    for task, episodes, regressor in itertools.product(tasks, options.episodes, options.regressors):
        own = [r for r in rows if (r['task'], r['regressor']) == (task, regressor)]
        own = [r for r in own if int(r['episodes']) == episodes]
        if not own:
            continue
        cells = []
        for sees in options.sees:
            returns = [float(r['return']) for r in own if r['sees'] == sees]
            mean, error = mean_and_error(returns) if returns else (np.nan, np.nan)
            cells.append(f'{mean:.1f} ± {error:.1f}')
        behaviour = np.mean([float(r['behaviour']) for r in own if not r['sees'].endswith('again')])
        trials = min(Counter(r['sees'] for r in own).values())
        lines.append((task, episodes, regressor, trials, f'{behaviour:.1f}', *cells))
    return markdown_table(
        ('task', 'episodes', 'regressor', 'trials', 'behaviour', *options.sees), lines
    )


def costs_table(rows: list[dict[str, str]], options: argparse.Namespace) -> str:
    """Return the number of channels and the median times, over all tasks, as Markdown."""
    lines = []
    for regressor, sees in itertools.product(options.regressors, options.sees):
        own = [r for r in rows if (r['regressor'], r['sees']) == (regressor, sees)]
        if own:
            lines.append((
                regressor, sees, f'{np.mean([len(r["channels"].split()) for r in own]):.1f}',
                f'{np.median([float(r["seconds"]) for r in own]):.1f}',
                f'{np.median([float(r["ms_per_decision"]) for r in own]):.2f}',
            ))  # fmt: skip
    return markdown_table(('regressor', 'sees', 'channels', 's to learn', 'ms a decision'), lines)


def run(options: argparse.Namespace) -> None:
    """Run the cases that the file lacks, then print the table."""
    if find_spec('sklearn') is None:
        raise CommandError('scikit-learn is not here: python3 -m pip install scikit-learn')
    tasks = [task for task in options.tasks if not what_is_missing(task)]
    for task in set(options.tasks) - set(tasks):
        print(f'{task}: {what_is_missing(task)}')
    options.out.parent.mkdir(parents=True, exist_ok=True)
    rows = read(options.out)
    done = {tuple(row[key] for key in COLUMNS[:5]) for row in rows}
    # Trial by trial, so that what is interrupted has all cases, only fewer trials.
    order = itertools.product(range(options.trials), options.episodes, tasks, options.sees)
    cases = [Case(task, episodes, sees, trial) for trial, episodes, task, sees in order]
    todo = [
        (case, missing)
        for case in cases
        if (missing := [r for r in options.regressors if (*map(str, case), r) not in done])
    ]
    with (
        options.out.open('a', newline='') as file,
        results_of(run_case, todo, options.jobs) as results,
    ):
        for result in tqdm(results, total=len(todo), file=sys.stdout, disable=None):
            csv.writer(file, lineterminator='\n').writerows(result)
            file.flush()
    asked_for = {tuple(map(str, case)) for case in cases}
    rows = [r for r in read(options.out) if tuple(r[key] for key in COLUMNS[:4]) in asked_for]
    print(f'\nreturn over {FRESH_EPISODES} fresh episodes; seeds from {FIRST_SEED}\n')
    print(learned_table(rows, options, tasks))
    print(costs_table(rows, options), end='')


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Return the options; a bad one ends the program with a sentence."""
    parser = study_parser('learning', __doc__, trials=20, episodes='50,100,300', least_episodes=4)
    for option, choices in (
        ('tasks', LEARNING_TASKS), ('sees', SEES), ('regressors', REGRESSORS),
    ):  # fmt: skip
        add_names(parser, f'--{option}', choices, choices)
    parser.add_argument(
        '--out', type=file_to_write, default=Path('learning/trials.csv'),
        help='the finished trials; what it holds is not run again (default %(default)s)',
    )  # fmt: skip
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Learn and print; return the exit code."""
    options = parse(arguments)
    return exit_code('learning', lambda: run(options), f'{options.out} keeps what is done')


if __name__ == '__main__':
    sys.exit(main())
