# SPDX-License-Identifier: Apache-2.0

"""The options that studies share."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection

from cmifs_ros.tools.arguments import file_to_write, number_from


def numbers_from(least: int) -> Callable[[str], list[int]]:
    """Return a parser of whole numbers separated by commas; sorted, without repetitions."""

    def numbers(text: str) -> list[int]:
        try:
            found = sorted({int(part) for part in text.split(',')})
        except ValueError:
            found = []
        if not found or found[0] < least:
            raise argparse.ArgumentTypeError(
                f'got {text!r}; expected whole numbers from {least} as in 20,40,100'
            )
        return found

    return numbers


def names_among(choices: Collection[str]) -> Callable[[str], list[str]]:
    """Return a parser of names separated by commas; in the order of the choices."""

    def names(text: str) -> list[str]:
        found = text.split(',')
        if not set(found) <= set(choices):
            raise argparse.ArgumentTypeError(
                f'got {text!r}; expected some of {", ".join(choices)}, separated by commas'
            )
        return [name for name in choices if name in found]

    return names


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
    """Return a parser for a study of trials.

    Parameters
    ----------
    program, text : str
        Its name and description, such as the docstring of the module.
    trials : int
        Default number of trials.
    first_seed : int, optional
        Default seed of trial 0; None: the study has its own seeds.
    episodes : str, optional
        Default numbers of episodes, separated by commas; None: no such option.
    least_episodes : int
        Least number of episodes for the study.
    has_jobs : bool
        Whether trials run in parallel.

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
        parser.add_argument(
            '--jobs', type=number_from(1), help='number of processes (default: one per core)'
        )
    return parser


def add_names(
    parser: argparse.ArgumentParser, option: str, choices: Collection[str], default: Collection[str]
) -> None:
    """Add an option for names, such as those of methods."""
    parser.add_argument(
        option,
        type=names_among(list(choices)),
        default=','.join(default),
        metavar='NAME,...',
        help=f'some of {", ".join(choices)} (default %(default)s)',
    )


def add_log(parser: argparse.ArgumentParser) -> None:
    """Add the option for the file of trials."""
    parser.add_argument(
        '--log',
        type=file_to_write,
        metavar='FILE',
        help='CSV file of the trials; trials in it are not run again',
    )
