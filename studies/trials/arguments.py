# SPDX-License-Identifier: Apache-2.0

"""The options that studies share, each written once."""

from __future__ import annotations

import argparse
from collections.abc import Collection

from cmifs_ros.tools.arguments import file_to_write, names_among, number_from, numbers_from


def study_parser(
    program: str,
    text: str,
    *,
    trials: int = 50,
    first_seed: int | None = None,
    episodes: str | None = None,
    least_episodes: int = 2,
    has_jobs: bool = True,
) -> argparse.ArgumentParser:
    """Return a parser of what a study of trials is asked.

    Parameters
    ----------
    program, text : str
        Its name; what it does, as its module's docstring.
    trials : int
        How many there are by default.
    first_seed : int, optional
        That of trial 0 by default; without it the study has seeds of its own.
    episodes : str, optional
        Numbers of episodes by default, with commas between; without it they are not asked for.
    least_episodes : int
        The least of them that the study can do with.
    has_jobs : bool
        Whether trials run side by side.

    """
    parser = argparse.ArgumentParser(
        program, description=' '.join(text.split()), allow_abbrev=False
    )
    parser.add_argument('--trials', type=number_from(1), default=trials, help='default %(default)s')
    if first_seed is not None:
        parser.add_argument(
            '--first-seed',
            type=number_from(0),
            default=first_seed,
            metavar='SEED',
            help='trial i has the seed SEED + i (default %(default)s)',
        )
    if episodes is not None:
        parser.add_argument(
            '--episodes',
            type=numbers_from(least_episodes),
            default=episodes,
            metavar='M,M,...',
            help='default %(default)s',
        )
    if has_jobs:
        parser.add_argument('--jobs', type=number_from(1), help='processes (default: one a core)')
    return parser


def add_names(
    parser: argparse.ArgumentParser, option: str, choices: Collection[str], default: Collection[str]
) -> None:
    """Add an option that takes names, such as those of methods."""
    parser.add_argument(
        option,
        type=names_among(list(choices)),
        default=','.join(default),
        metavar='NAME,...',
        help=f'some of {", ".join(choices)} (default %(default)s)',
    )


def add_log(parser: argparse.ArgumentParser) -> None:
    """Add the file that keeps the trials."""
    parser.add_argument(
        '--log',
        type=file_to_write,
        metavar='FILE',
        help='CSV file of the trials; those that it holds are not run again',
    )
