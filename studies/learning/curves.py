# SPDX-License-Identifier: Apache-2.0

"""Whether learning gets easier: fitted Q iteration on the channels that each method selects.

From the same episodes a policy is learned on all channels, on those selected by the targets
`return` and `decision`, on those of recursive extra trees, and on those that a controller needs; it
acts in new episodes, and the table shows its mean return. If nothing is selected, all channels are
used. An interrupted run continues where it stopped.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import warnings
from collections import Counter
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from cmifs_ros.core import ConditionalMISelector, Episode
from cmifs_ros.core.targets import DECISION, RETURN
from cmifs_ros.tools.arguments import file_to_write
from cmifs_ros.tools.program import CommandError, exit_code
from studies.methods.recursive_forests import recursive_selection
from studies.tasks.registry import what_is_missing
from studies.trials.arguments import add_names, study_parser
from studies.trials.parallel import results_of
from studies.trials.rows import RowLog
from studies.trials.statistics import mean_and_error
from studies.trials.tables import markdown_table

from .fitted_q import REGRESSORS, FittedQ
from .worlds import LEARNING_TASKS, episodes_of, record, returns_of, transitions_of

ALL, RECURSIVE, NEEDED = 'all', 'recursive', 'needed'
SELECTED_BY = (ALL, RETURN, DECISION, RECURSIVE, NEEDED)
FRESH_EPISODES = 100
#: `channels` are those selected, of which there may be none.
COLUMNS = ('task', 'episodes', 'selected_by', 'seed', 'regressor', 'channels', 'behaviour',
           'return')  # fmt: skip


class Case(NamedTuple):
    """One choice of channels in one trial; all regressors learn on it."""

    task: str
    episodes: int
    selected_by: str
    seed: int


def choose(case: Case, episodes: list[Episode]) -> list[int]:
    """Return the channels that are selected."""
    task = LEARNING_TASKS[case.task]
    if case.selected_by == ALL:
        return list(range(len(task.channel_names)))
    if case.selected_by == NEEDED:
        return list(task.needed)
    if case.selected_by == RECURSIVE:
        return recursive_selection(episodes, case.seed)
    selector = ConditionalMISelector(target=case.selected_by, random_state=case.seed)
    return selector.fit(episodes).get_support(indices=True).tolist()


def run_case(case: Case, regressors: list[str]) -> list[tuple]:
    """Choose, learn and act; return a row of `COLUMNS` for each regressor."""
    warnings.filterwarnings('ignore', message='lbfgs failed to converge')  # Few are meant.
    warnings.filterwarnings('ignore', category=UserWarning)  # What data cannot show.
    task = LEARNING_TASKS[case.task]
    recordings = record(case.task, case.episodes, case.seed)
    channels = choose(case, episodes_of(case.task, recordings))
    behaviour = np.mean([recording.rewards.sum() for recording in recordings])
    rows = []
    for regressor in regressors:
        policy = FittedQ(
            transitions_of(case.task, recordings),
            channels or range(len(task.channel_names)),
            len(task.actions),
            regressor,
            seed=case.seed,
        )
        # Fresh episodes are the same ones for all that are compared, and not those learned from.
        returns = returns_of(case.task, policy.act, FRESH_EPISODES, case.seed + 1_000_000)
        shown = ' '.join(map(str, channels))
        rows.append((*case, regressor, shown, f'{behaviour:.4f}', f'{returns.mean():.4f}'))
    return rows


def learned_table(rows: list[dict[str, str]], options: argparse.Namespace, tasks: list[str]) -> str:
    """Return the mean return that is learned on each choice of channels, as Markdown."""
    lines = []
    for task, episodes, regressor in itertools.product(tasks, options.episodes, options.regressors):
        own = _of(rows, task=task, episodes=episodes, regressor=regressor)
        if not own:
            continue
        returns = [
            [float(r['return']) for r in _of(own, selected_by=by)] for by in options.selected_by
        ]
        cells = ['{:.1f} ± {:.1f}'.format(*mean_and_error(of_one)) for of_one in returns]
        behaviour = np.mean([float(r['behaviour']) for r in own])
        lines.append((task, episodes, regressor, len(returns[0]), f'{behaviour:.1f}', *cells))
    head = ('task', 'episodes', 'regressor', 'trials', 'behaviour', *options.selected_by)
    return markdown_table(head, lines)


def selected_table(
    rows: list[dict[str, str]], options: argparse.Namespace, tasks: list[str]
) -> str:
    """Return which channels were selected, most frequent first, as Markdown."""
    lines = []
    for task, episodes in itertools.product(tasks, options.episodes):
        names = LEARNING_TASKS[task].channel_names
        own = _of(rows, task=task, episodes=episodes, regressor=options.regressors[0])
        cells = []
        for by in (RETURN, DECISION, RECURSIVE):
            selected = _of(own, selected_by=by)
            counts = Counter(names[int(c)] for r in selected for c in r['channels'].split())
            cells.append(', '.join(f'{n} {k / len(selected):.0%}' for n, k in counts.most_common()))
        needed = ', '.join(names[c] for c in LEARNING_TASKS[task].needed)
        lines.append((task, episodes, needed, *cells))
    return markdown_table(('task', 'episodes', NEEDED, RETURN, DECISION, RECURSIVE), lines)


def _of(rows: list[dict[str, str]], **wanted) -> list[dict[str, str]]:
    """Return the rows with these values."""
    return [r for r in rows if all(r[column] == str(value) for column, value in wanted.items())]


def run(options: argparse.Namespace) -> None:
    """Run the cases that the file lacks, then print the tables."""
    if find_spec('sklearn') is None:
        raise CommandError('scikit-learn is not here: python3 -m pip install scikit-learn')
    tasks = [task for task in options.tasks if not what_is_missing(task)]
    for task in set(options.tasks) - set(tasks):
        print(f'{task}: {what_is_missing(task)}')
    log = RowLog(options.out, COLUMNS)
    done = {tuple(row[key] for key in COLUMNS[:5]) for row in log.rows}
    # Trial by trial, so that what is interrupted has all cases, only fewer trials.
    seeds = range(options.first_seed, options.first_seed + options.trials)
    order = itertools.product(seeds, options.episodes, tasks, options.selected_by)
    cases = [Case(task, episodes, by, seed) for seed, episodes, task, by in order]
    todo = [
        (case, missing)
        for case in cases
        if (missing := [r for r in options.regressors if (*map(str, case), r) not in done])
    ]
    with results_of(run_case, todo, options.jobs) as results:
        for rows in tqdm(results, total=len(todo), file=sys.stdout, disable=None):
            log.add(rows)
    asked_for = {tuple(map(str, case)) for case in cases}
    rows = [r for r in log.rows if tuple(r[key] for key in COLUMNS[:4]) in asked_for]
    print(
        f'\n{options.trials} trials, seeds {seeds[0]} to {seeds[-1]}; mean return of '
        f'{FRESH_EPISODES} fresh episodes, and its standard error over trials\n'
    )
    print(learned_table(rows, options, tasks))
    print('how often each channel is selected\n')
    print(selected_table(rows, options, tasks), end='')


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Return the options; an invalid one ends the program with a message."""
    parser = study_parser(
        'learning', __doc__, trials=20, first_seed=1000, episodes='100,300', least_episodes=4
    )
    for option, choices in (
        ('tasks', LEARNING_TASKS), ('selected-by', SELECTED_BY), ('regressors', REGRESSORS),
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
