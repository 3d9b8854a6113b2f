# SPDX-License-Identifier: Apache-2.0

"""Validated command-line values: functions for the `type` of argparse."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from pathlib import Path


def number_from(least: int) -> Callable[[str], int]:
    """Return a parser of a whole number of at least `least`."""

    def number(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f'got {text!r}; expected a whole number from {least}')
        return int(text)

    return number


def between(low: float, high: float) -> Callable[[str], float]:
    """Return a parser of a number above one bound and up to another."""

    def number(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = low
        if not low < value <= high:
            raise argparse.ArgumentTypeError(
                f'got {text!r}; expected a number above {low:g}, up to {high:g}'
            )
        return value

    return number


def column_names(text: str) -> tuple[str, ...]:
    """Parse names separated by commas."""
    return tuple(text.split(','))


def home_path(text: str) -> Path:
    """Parse a path; `~`, which the shell expands only at the beginning, is the home folder."""
    return Path(os.path.expanduser(text))


def file_to_write(text: str) -> Path:
    """Parse the name of a file to write or replace; neither it nor its folder need exist."""
    path = home_path(text)
    if path.is_dir():
        raise argparse.ArgumentTypeError(
            f'{text} is a folder; expected the name of a file, as in {path / "NAME"}'
        )
    folder_to_write(str(path.parent))
    return path


def new_file(text: str) -> Path:
    """Parse the name of a file that must not exist, because it could not be made again."""
    path = file_to_write(text)
    if os.path.lexists(path):
        raise argparse.ArgumentTypeError(f'{text} exists; expected the name of a new file')
    return path


def folder_to_write(text: str) -> Path:
    """Parse the name of a folder to write to, which need not exist."""
    whole = home_path(text).absolute()
    there = next(path for path in (whole, *whole.parents) if os.path.lexists(path))
    if not os.path.isdir(there):
        raise argparse.ArgumentTypeError(
            f'{there} is not a folder; expected a folder, existing or not'
        )
    if not os.access(there, os.W_OK | os.X_OK):
        raise argparse.ArgumentTypeError(
            f'cannot write to {there}; expected a folder with write permission'
        )
    return home_path(text)
