# SPDX-License-Identifier: Apache-2.0

"""The options of `select_from_bag`."""

from __future__ import annotations

import argparse
from pathlib import Path

from cmifs_ros.collect.robot_file.model import SOURCES
from cmifs_ros.core import ConditionalMISelector
from cmifs_ros.core.targets import TARGETS

from .arguments import (
    between,
    column_names,
    file_to_write,
    folder_to_write,
    home_path,
    new_file,
    number_from,
)


def select_parser(program: str, description: str) -> argparse.ArgumentParser:
    """Return the parser of the command."""
    parser = argparse.ArgumentParser(program, description=description)
    parser.add_argument(
        'recordings', nargs='+', type=home_path, metavar='RECORDING',
        help='recordings, or folders of them; they are pooled',
    )  # fmt: skip
    parser.add_argument(
        '--robot', metavar='FILE',
        help='the robot file; without it, bags must hold state and reward, and the rows of tables '
        'are steps, with the names of LeRobot, Minari, robomimic or D4RL',
    )  # fmt: skip
    parser.add_argument(
        '--out', type=folder_to_write, default=Path(), metavar='FOLDER',
        help='folder for selection.json and selection.png (default: the current one)',
    )  # fmt: skip
    parser.add_argument(
        '--episodes-file', type=new_file, metavar='FILE',
        help='write the episodes and the selection for a selector node (its episodes_path)',
    )  # fmt: skip
    parser.add_argument(
        '--report',
        type=folder_to_write,
        metavar='FOLDER',
        help='write the report FOLDER/index.html',
    )
    parser.add_argument(
        '--num-features', type=number_from(1), metavar='N',
        help='sensors to select (default: the confirmed ones)',
    )  # fmt: skip
    parser.add_argument(
        '--topics', type=file_to_write, metavar='FILE',
        help='write the topics worth recording, as arguments of `ros2 bag record`',
    )  # fmt: skip
    parser.add_argument(
        '--source', choices=SOURCES,
        help='what distinguishes robots or recordings: the bag or its folder (default: that of '
        'the robot file, or none)',
    )  # fmt: skip
    parser.add_argument(
        '--target', choices=TARGETS,
        help='what to select for: what the return depends on, what a controller needs for its '
        'decisions, or what the recorded action depends on (default: that of the robot file, or '
        'return)',
    )  # fmt: skip
    parser.add_argument(
        '--significance', type=between(0, 1), default=ConditionalMISelector().significance,
        metavar='P', help='greatest p-value that confirms a sensor (default %(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--margin', type=between(0, 1), default=ConditionalMISelector().margin, metavar='SHARE',
        help="share of the target's variance; a sensor that adds less is dispensable (default: "
        '%(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--order', choices=('time', 'none'), default='time',
        help='order of the episodes: time, so that slow drift is no evidence, or none, for example '
        'if files are sorted by their outcome (default: %(default)s)',
    )  # fmt: skip
    columns = parser.add_argument_group(
        'columns of .parquet and .csv whose rows are steps, if they have names of your own; all '
        'other columns are sensors'
    )
    columns.add_argument(
        '--episode', metavar='COLUMN', help='the number or name of the episode of a row',
    )  # fmt: skip
    columns.add_argument(
        '--done', type=column_names, default=(), metavar='COLUMN,...',
        help='instead: true at the last step of an episode (without either, each file is one, and '
        'their folder is the recording)',
    )  # fmt: skip
    columns.add_argument('--reward', metavar='COLUMN', help='the reward of a step')
    columns.add_argument(
        '--action', type=column_names, default=(), metavar='COLUMN,...', help='the actions',
    )  # fmt: skip
    columns.add_argument(
        '--ignore', type=column_names, default=(), metavar='COLUMN,...', help='to be left out',
    )  # fmt: skip
    columns.add_argument(
        '--gaps', type=column_names, default=(), metavar='COLUMN,...',
        help='sensors that may have no value, such as the pose of a tag that is not always seen: '
        'the last value holds, and a channel says whether there is one',
    )  # fmt: skip
    columns.add_argument(
        '--source-column', metavar='COLUMN',
        help='the robot or recording of an episode, in place of --source',
    )  # fmt: skip
    discount = parser.add_mutually_exclusive_group()
    discount.add_argument(
        '--gamma', type=between(0, 1), metavar='G',
        help='discount factor per step: a reward k steps later is weighted by G ** k',
    )  # fmt: skip
    discount.add_argument(
        '--half-life', type=between(0, 1e9), metavar='S',
        help='seconds after which a reward counts half (default: the discount of the robot file, '
        'or gamma 0.95)',
    )  # fmt: skip
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        '--jobs',
        type=number_from(1),
        default=1,
        metavar='N',
        help='number of recordings read in parallel',
    )
    where.add_argument(
        '--scheduler', metavar='ADDRESS',
        help='read on the cluster of this Dask scheduler, with the recordings under the same '
        'paths; they stay in its memory',
    )  # fmt: skip
    parser.add_argument(
        '--keep-going', action='store_true',
        help='leave out recordings that cannot be read, each with a warning',
    )  # fmt: skip
    parser.add_argument(
        '--stability', type=number_from(1), default=0, metavar='N',
        help='also select from N random halves of the episodes, and report how often each sensor '
        'is selected',
    )  # fmt: skip
    return parser
