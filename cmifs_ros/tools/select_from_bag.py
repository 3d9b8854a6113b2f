# SPDX-License-Identifier: Apache-2.0

"""Select from recordings: bags, tables (Parquet, CSV), HDF5, and robot learning data sets."""

from __future__ import annotations

import argparse
import os
import sys
from collections import Counter
from functools import partial
from pathlib import Path

from cmifs_ros.collect.discount import Discount, in_words
from cmifs_ros.collect.episodes.end_counts import EndCounts
from cmifs_ros.collect.episodes.episode_check import problems_of_ends, problems_of_episodes
from cmifs_ros.collect.episodes.reward_check import problem_of_target
from cmifs_ros.collect.outline import Outline, trace_of
from cmifs_ros.collect.pooling import Pool, pooled
from cmifs_ros.collect.recorded_episodes import RecordingError
from cmifs_ros.collect.recording import episodes_of_recording, recordings_in
from cmifs_ros.collect.robot_file import RobotFile, RobotFileError, load_robot_file
from cmifs_ros.collect.robot_file.model import SOURCES
from cmifs_ros.collect.sensor_groups import groups_by_name
from cmifs_ros.collect.tables.roles import Roles
from cmifs_ros.core import ConditionalMISelector
from cmifs_ros.core.data_checks import problems_of_pooling
from cmifs_ros.core.selecting import select
from cmifs_ros.core.targets import ACTION, DECISION, RETURN
from cmifs_ros.core.words import counted, first, listed

from .bags import bag_opener
from .program import CommandError, exit_code
from .recordings import Reader, Recordings, recordings_at
from .select_options import select_parser
from .selection_files import Data, write_files


def main(arguments: list[str] | None = None, program: str = 'select_from_bag') -> int:
    """Run the command; return its exit code."""
    options = select_parser(program, __doc__).parse_args(arguments)
    return exit_code(program, lambda: _run(options), 'nothing is written')


def _run(options: argparse.Namespace) -> None:
    try:
        robot = load_robot_file(options.robot) if options.robot else None
        if options.topics and robot is None:
            raise CommandError('--topics needs --robot, which gives the topics of the channels')
        if robot is not None:
            _check_sensors(robot, options.num_features)
        roles = _roles(options)
        paths = [one for path in options.recordings for one in recordings_in(path, robot, roles)]
        read = partial(episodes_of_recording, robot=robot, open_bag=bag_opener(), roles=roles)
        with recordings_at(options.scheduler, options.jobs) as recordings:
            outlines = _read(recordings, paths, read, options.keep_going)
            _select(recordings, outlines, robot, options)
    except (RecordingError, RobotFileError, OSError) as error:
        raise CommandError(str(error)) from error


def _check_sensors(robot: RobotFile, num_features: int | None) -> None:
    """Refuse more features than there are sensors; tell which channels the reward is made of."""
    count = len(robot.channel_names) - sum(len(members) - 1 for members in robot.groups.values())
    if num_features is not None and num_features > count:
        raise CommandError(
            f'--num-features is {num_features}; expected at most {count}, the number of sensors in '
            'the robot file'
        )
    if robot.reward_channels:
        print(
            f'note: the reward is computed from {listed(robot.reward_channels)}, which may be '
            'selected for that alone; what the robot does not sense belongs under values'
        )


def _roles(options: argparse.Namespace) -> Roles | None:
    """Return the roles of columns, if any is given."""
    if options.source_column and options.source:
        raise CommandError('--source and --source-column both name the source; expected one')
    try:
        roles = Roles(
            options.episode, options.done, options.reward, options.action, options.ignore,
            options.source_column, options.gaps,
        )  # fmt: skip
    except ValueError as error:
        raise CommandError(str(error)) from None
    return roles if roles.columns else None


def _read(
    recordings: Recordings, paths: list[Path], read: Reader, keep_going: bool
) -> list[tuple[str, Outline]]:
    outlines = []
    for path, one in zip(paths, recordings.read(paths, read), strict=True):
        if isinstance(one, RecordingError):
            if not keep_going:
                raise one
            print(f'warning: left out: {one}')
            continue
        outlines.append((str(path), one))
        facts = one.recording
        said = [counted(facts.num_read, facts.unit), counted(len(one), 'complete episode')]
        if facts.num_between:
            said.append(f'{counted(facts.num_between, "step")} between episodes')
        print(f'{path}: {", ".join(said)}')
        for cause, count in facts.dropped.items():
            print(f'  dropped {count}: {cause}')
        if facts.unreadable:
            unreadable = [f'{name} ({why})' for name, why in facts.unreadable.items()]
            print(f'  cannot be decoded: {first(unreadable)}')
    if not outlines:
        raise RecordingError(f'none of {counted(len(paths), "recording")} can be read')
    return outlines


def _select(
    recordings: Recordings,
    outlines: list[tuple[str, Outline]],
    robot: RobotFile | None,
    options: argparse.Namespace,
) -> None:
    facts = [one.recording for _, one in outlines]
    by = options.source or (robot.source if robot else SOURCES[0])
    pool = pooled(outlines, lambda number: recordings.ask(trace_of, [number])[0], by)
    problems = problems_of_episodes(
        pool.lengths.tolist(),
        sum(one.num_cut for one in facts),
        sum(one.num_open_steps for one in facts),
    )
    looks: dict = {}
    for one in facts:
        for condition, counts in one.ends.items():
            looks[condition] = looks.get(condition, Counter()) + counts
    problems = problems_of_ends(looks) + problems
    if len(pool.lengths) < 2:
        raise RecordingError('; '.join([*pool.notes, *problems]))
    for problem in (*pool.notes, *problems):
        print(f'warning: {problem}')
    target = options.target or (robot and robot.target) or RETURN
    lacking = [
        f'{path} has {one.recording.no_rewards}' for path, one in outlines
        if one.recording.no_rewards
    ]  # fmt: skip
    if lacking and target != ACTION:
        raise CommandError(
            f'{lacking[0]}, which target {target!r} needs: --target action selects what the '
            'recorded action depends on'
        )
    settings = {'num_features': options.num_features, 'n_jobs': os.cpu_count()}
    settings |= {name: getattr(options, name) for name in ('margin', 'significance')}
    settings['target'] = target
    settings['groups'] = groups_by_name(pool.channel_names)
    if target == RETURN:
        settings['gamma'] = _gamma(pool, robot, options)
    elif options.gamma or options.half_life or (robot and robot.discount):
        print(
            f'note: the discount is not used: with the target {target}, what counts is the '
            f'{"reward" if target == DECISION else "action"} of a step, not the return'
        )
    try:
        episodes = recordings.thinned(pool, ConditionalMISelector(**settings))
        problem = problem_of_target(episodes, target)
        if problem:
            raise CommandError(problem)
        recording_of_each = [number for number, _ in pool.origins]
        for problem in problems_of_pooling(episodes, recording_of_each, pool.channel_names):
            print(f'warning: {problem}')
        among = f'{counted(len(pool.channel_names), "channel")} from '
        print(f'selecting among {among}{counted(len(episodes), "episode")} ...', flush=True)
        selection = select(
            episodes, pool.channel_names, 'conditional_mi', settings,
            action_names=pool.action_names, ordered=options.order == 'time',
            num_halves=options.stability,
            losses=sum((one.end_counts for one in facts), EndCounts()).problem(),
        )  # fmt: skip
    except ValueError as error:  # from the settings or the episodes
        raise CommandError(str(error)) from error
    write_files(selection, Data(recordings, facts, pool, episodes), robot, options)


def _gamma(pool: Pool, robot: RobotFile | None, options: argparse.Namespace) -> float:
    """Return the discount factor per step, and print what it means."""
    discount = (robot and robot.discount) or Discount(ConditionalMISelector().gamma)
    if options.gamma or options.half_life:
        discount = Discount(options.gamma, options.half_life)
    step = 1 / robot.rate if robot and robot.rate else pool.step_seconds
    try:
        gamma = discount.per_step(step)
    except ValueError as error:
        raise CommandError(str(error)) from None
    print(f'discount: {in_words(gamma, step)}')
    return gamma


if __name__ == '__main__':
    sys.exit(main())
