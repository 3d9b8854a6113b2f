"""Select from recorded bags: `ros2 run cmifs_ros select_from_bag BAG... --robot FILE`."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections import Counter
from pathlib import Path

from cmifs_ros.collect.bag import BagEpisodes, BagError, episodes_of_bag
from cmifs_ros.collect.episodes import file as episode_file
from cmifs_ros.collect.episodes.episode_check import problems_of_episodes
from cmifs_ros.collect.episodes.reward_check import problem_of_rewards
from cmifs_ros.collect.robot_file.reader import RobotFile, RobotFileError, load_robot_file
from cmifs_ros.collect.selection_fields import fields_of
from cmifs_ros.core.words import counted

from .arguments import file_to_write, folder_to_write, number_from
from .program import CommandError, exit_code


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return its exit code."""
    parser = argparse.ArgumentParser('select_from_bag', description=__doc__)
    parser.add_argument('bags', nargs='+', metavar='BAG', help='files or folders; they are pooled')
    parser.add_argument(
        '--robot', metavar='FILE', help='the robot file; without, bags hold state and reward'
    )
    parser.add_argument(
        '--out', type=folder_to_write, default=Path(), metavar='FOLDER',
        help='for selection.json and selection.png (default: here)',
    )  # fmt: skip
    parser.add_argument(
        '--episodes-file', type=file_to_write, metavar='FILE',
        help='write what a selector takes up (episodes_path)',
    )  # fmt: skip
    parser.add_argument(
        '--report', type=folder_to_write, metavar='FOLDER', help='write a page, index.html'
    )
    parser.add_argument(
        '--num-features', type=number_from(1), metavar='N',
        help='sensors to select (default: as many as there is evidence for)',
    )  # fmt: skip
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        '--jobs', type=number_from(1), default=1, metavar='N', help='bags read at the same time'
    )
    where.add_argument(
        '--scheduler', metavar='ADDRESS',
        help='read and select on the cluster of this Dask scheduler, which finds the bags by the '
        'same paths',
    )  # fmt: skip
    parser.add_argument(
        '--stability', type=number_from(1), default=0, metavar='N',
        help='select from N random halves of the episodes too, and say how often each sensor is',
    )  # fmt: skip
    options = parser.parse_args(arguments)
    return exit_code('select_from_bag', lambda: _run(options), 'nothing is written')


def _run(options: argparse.Namespace) -> None:
    from .cluster import backend

    try:
        robot = load_robot_file(options.robot) if options.robot else None
        with backend(options.scheduler):
            bags = _read(options.bags, robot, options)
            _select(bags, robot, options)
    except (BagError, RobotFileError, OSError) as error:
        raise CommandError(str(error)) from error


def _read(paths: list[str], robot: RobotFile | None, options) -> list[BagEpisodes]:
    from tqdm import tqdm

    if not options.scheduler and (options.jobs == 1 or len(paths) == 1):

        def watch(messages, total):
            return tqdm(messages, total=total, unit=' messages', disable=None, leave=False)

        found = (episodes_of_bag(path, robot, watch) for path in paths)
    else:
        from joblib import Parallel, delayed

        read = Parallel(options.jobs, return_as='generator')(
            delayed(episodes_of_bag)(Path(path).absolute(), robot) for path in paths
        )
        found = tqdm(read, total=len(paths), unit=' bags', disable=None, leave=False)
    bags = []
    for path, bag in zip(paths, found, strict=True):
        bags.append(bag)
        said = [counted(bag.num_messages, 'message')]
        said += [counted(len(bag.episodes), 'whole episode')]
        said += [f'{counted(bag.num_between, "step")} between episodes'] if bag.num_between else []
        print(f'{path}: {", ".join(said)}')
        for cause, count in bag.dropped.items():
            print(f'  dropped {count}: {cause}')
        with_episodes = [b for b in bags if b.episodes]
        if bag.episodes and bag.channel_names != with_episodes[0].channel_names:
            raise BagError(f'{path} has other channels than the bags before it; expected the same')
    return bags


def _select(bags: list[BagEpisodes], robot: RobotFile | None, options) -> None:
    from joblib import Parallel, delayed

    from cmifs_ros.core.selection import select

    from .html_report import write_report
    from .ranking import draw_ranking, ranking_text

    episodes = [episode for bag in bags for episode in bag.episodes]
    problems = problems_of_episodes(
        [len(episode) for episode in episodes],
        sum(bag.num_cut for bag in bags),
        sum(bag.num_open_steps for bag in bags),
    )
    if len(episodes) < 2:
        raise BagError('; '.join(problems))
    for problem in problems:
        print(f'warning: {problem}')
    names = next(bag.channel_names for bag in bags if bag.episodes)
    problem = problem_of_rewards(episodes)
    if problem:
        raise CommandError(problem)
    settings = {'num_features': options.num_features, 'n_jobs': os.cpu_count()}
    if robot and robot.groups:
        settings['groups'] = robot.groups
    among = f'{counted(len(names), "channel")} from {counted(len(episodes), "episode")}'
    print(f'selecting among {among} ...', flush=True)
    try:
        # A single job: without a cluster, joblib does it in this process.
        job = delayed(select)(
            episodes, names, 'conditional_mi', settings, num_halves=options.stability
        )
        (selection,) = Parallel(1)([job])
    except ValueError as error:  # of the settings or the episodes
        raise CommandError(str(error)) from error
    print(f'\n{ranking_text(selection)}\n')
    print(f'selected: {", ".join(selection.names) or "nothing"} ({selection.seconds:.1f} s)')
    options.out.mkdir(parents=True, exist_ok=True)
    written = [options.out / 'selection.json', options.out / 'selection.png']
    written[0].write_text(json.dumps(fields_of(selection), indent=1) + '\n')
    draw_ranking(selection).savefig(written[1], dpi=150)
    if options.episodes_file:
        # A selector that starts with a selection of nothing would publish nothing.
        kept = selection if selection.indices else None
        saved = episode_file.Saved(names, episodes, kept, time.time())
        options.episodes_file.parent.mkdir(parents=True, exist_ok=True)
        episode_file.write(options.episodes_file, saved)
        written.append(options.episodes_file)
    if options.report:
        dropped = sum((Counter(bag.dropped) for bag in bags), Counter())
        written.append(write_report(options.report, selection, episodes, names, dropped))
    print(f'written: {", ".join(map(str, written))}')


if __name__ == '__main__':
    sys.exit(main())
