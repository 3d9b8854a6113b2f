"""Checked values of command lines: functions for the `type` of argparse."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection


def number_from(least: int) -> Callable[[str], int]:
    """Return a reader of one whole number of at least so much."""

    def number(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f'it is {text!r}; expected a number from {least}')
        return int(text)

    return number


def numbers_from(least: int) -> Callable[[str], list[int]]:
    """Return a reader of whole numbers with commas between; they come sorted, each once."""

    def numbers(text: str) -> list[int]:
        try:
            found = sorted({int(part) for part in text.split(',')})
        except ValueError:
            found = []
        if not found or found[0] < least:
            raise argparse.ArgumentTypeError(
                f'it is {text!r}; expected numbers from {least} as in 20,40,100'
            )
        return found

    return numbers


def names_among(choices: Collection[str]) -> Callable[[str], list[str]]:
    """Return a reader of names with commas between; they come in the order of the choices."""

    def names(text: str) -> list[str]:
        found = text.split(',')
        if not set(found) <= set(choices):
            raise argparse.ArgumentTypeError(
                f'it is {text!r}; expected some of {", ".join(choices)}, separated by commas'
            )
        return [name for name in choices if name in found]

    return names
