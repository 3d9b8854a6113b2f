# SPDX-License-Identifier: Apache-2.0

"""What a recorded controller loses with each sensor frozen.

Each target selects sensors from episodes of a controller. Then the controller acts in new episodes,
once for each channel, which stays at its median; nothing else differs. Freezing what is dispensable
should not change the return; freezing what is confirmed for the action should.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from functools import partial
from pathlib import Path

import numpy as np
from tqdm import tqdm

from cmifs_ros.core import ConditionalMISelector
from cmifs_ros.core.statuses import STATUSES
from cmifs_ros.core.targets import TARGETS
from cmifs_ros.sim import sample_action
from cmifs_ros.tools.arguments import file_to_write
from cmifs_ros.tools.program import exit_code
from studies.tasks.control import CONTROL_WORLDS, skilled
from studies.trials.arguments import add_names, study_parser
from studies.trials.parallel import results_of
from studies.trials.rows import RowLog
from studies.trials.tables import markdown_table

from .worlds import LEARNING_TASKS, episodes_of, record

#: Who was recorded: in worlds of control, one who is skilled.
CONTROLLERS = {
    name: partial(skilled, CONTROL_WORLDS[name]) if name in CONTROL_WORLDS else sample_action
    for name in (
        *(n for n in CONTROL_WORLDS if n in LEARNING_TASKS),
        'without_gravel',
        'with_gravel',
    )
}
RECORDED_EPISODES, FRESH_EPISODES = 100, 300
COLUMNS = ('task', 'seed', 'channel', *TARGETS, 'intact', 'frozen', 'error')


def run_case(task: str, seed: int) -> list[tuple]:
    """Select and act; return a row of `COLUMNS` for each channel.

    The last three are the mean return of fresh episodes, that with the channel frozen, and the
    standard error of their difference, which is that of pairs of episodes.
    """
    act = CONTROLLERS[task]
    recordings = record(task, RECORDED_EPISODES, seed, act)
    episodes, names = episodes_of(task, recordings), LEARNING_TASKS[task].channel_names
    statuses = []
    for target in TARGETS:
        selector = ConditionalMISelector(target=target, random_state=seed)
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', UserWarning)  # What data cannot show.
            selector.fit(episodes, names)
        order = np.argsort(selector.ranking_)
        statuses.append([selector.statuses_[place] for place in order])
    medians = np.median(np.concatenate([episode.states for episode in episodes]), axis=0)

    def returns(frozen):
        fresh = record(task, FRESH_EPISODES, seed + 1_000_000, act, frozen)
        return np.array([recording.rewards.sum() for recording in fresh])

    whole, rows = returns({}), []
    for channel, name in enumerate(names):
        change = returns({channel: medians[channel]}) - whole
        error = change.std(ddof=1) / np.sqrt(len(change))
        shown = (f'{x:.4f}' for x in (whole.mean(), whole.mean() + change.mean(), error))
        rows.append((task, seed, name, *(of_target[channel] for of_target in statuses), *shown))
    return rows


def table(rows: list[dict[str, str]], tasks: list[str]) -> str:
    """Return by task, target and status what freezing a channel does, as Markdown.

    A return is unchanged if it differs by no more than twice the error of the difference.
    """
    lines = []
    for task in tasks:
        of_task = [r for r in rows if r['task'] == task]
        whole = np.mean([float(r['intact']) for r in of_task])
        for target in TARGETS:
            cells = []
            for status in STATUSES:
                own = [r for r in of_task if r[target] == status]
                unchanged = [
                    abs(float(r['frozen']) - float(r['intact'])) <= 2 * float(r['error'])
                    for r in own
                ]
                frozen = np.mean([float(r['frozen']) for r in own]) if own else np.nan
                cells += [f'{sum(unchanged)} of {len(own)}', f'{frozen:.1f}'] if own else ['', '']
            lines.append((task, target, f'{whole:.1f}', *cells))
    head = ('task', 'target', 'return')
    head += tuple(f'{s}: {what}' for s in STATUSES for what in ('unchanged', 'return'))
    return markdown_table(head, lines)


def run(options: argparse.Namespace) -> None:
    """Run the trials that the file lacks, then print the table."""
    log = RowLog(options.out, COLUMNS)
    seeds = range(options.first_seed, options.first_seed + options.trials)
    wanted = [(task, seed) for seed in seeds for task in options.tasks]
    done = {(r['task'], int(r['seed'])) for r in log.rows}
    todo = [case for case in wanted if case not in done]
    with results_of(run_case, todo, options.jobs) as results:
        for rows in tqdm(results, total=len(todo), file=sys.stdout, disable=None):
            log.add(rows)
    print(
        f'\n{options.trials} trials, seeds {seeds[0]} to {seeds[-1]}; {RECORDED_EPISODES} episodes '
        f'recorded, {FRESH_EPISODES} fresh ones\n'
    )
    rows = [r for r in log.rows if (r['task'], int(r['seed'])) in wanted]
    print(table(rows, options.tasks), end='')


def main(arguments: list[str] | None = None) -> int:
    """Select, act and print; return the exit code."""
    parser = study_parser('ablation', __doc__, trials=20, first_seed=1000)
    add_names(parser, '--tasks', CONTROLLERS, CONTROLLERS)
    parser.add_argument(
        '--out', type=file_to_write, default=Path('learning/ablation.csv'),
        help='the finished trials; what it holds is not run again (default %(default)s)',
    )  # fmt: skip
    options = parser.parse_args(arguments)
    return exit_code('ablation', lambda: run(options), f'{options.out} keeps what is done')


if __name__ == '__main__':
    sys.exit(main())
