"""The options that the studies of accuracy share."""

from __future__ import annotations

import argparse

from cmifs_ros.tools.arguments import file_to_write, number_from


def add_trial_arguments(parser: argparse.ArgumentParser) -> None:
    """Add how many trials there are, their seeds, and the processes that run them."""
    parser.add_argument('--trials', type=number_from(1), default=50, help='default 50')
    parser.add_argument(
        '--first-seed',
        type=number_from(0),
        default=1000,
        help='trial i has the seed FIRST_SEED + i (default 1000)',
    )
    parser.add_argument('--jobs', type=number_from(1), help='processes (default: one a core)')


def add_log_argument(parser: argparse.ArgumentParser) -> None:
    """Add the file that keeps the trials."""
    parser.add_argument(
        '--log',
        type=file_to_write,
        metavar='FILE',
        help='CSV file of the trials; those that it holds are not run again',
    )
