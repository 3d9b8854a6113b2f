# SPDX-License-Identifier: Apache-2.0

"""Counts and lists of names for messages."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from functools import lru_cache


def counted(count: int | str, noun: str) -> str:
    """Return a count with its noun: '1 episode', '2 episodes', '0 episodes', '? episodes'."""
    return f'{count} {noun}' if str(count) == '1' else f'{count} {noun}s'


def listed(names: Sequence[str]) -> str:
    """Return names as a short text, even if they are many or long."""
    return first([short(name) for name in names])


def short(name: str) -> str:
    """Return a name, truncated if it is long."""
    return name if len(name) <= 32 else f'{name[:30]}..'


def first(texts: Sequence[str]) -> str:
    """Return the first eight texts and the number of the others."""
    more = [f'{len(texts) - 8} more'] if len(texts) > 8 else []
    return ', '.join([*texts[:8], *more])


def did_you_mean(name: str, known: Sequence[str]) -> str:
    """Return the known name most like a misspelt one, to be appended; empty if none is."""
    return _meant(name[:100], tuple(one[:100] for one in known))


@lru_cache(maxsize=1000)  # Each of many messages may lack the same name.
def _meant(name: str, known: tuple[str, ...]) -> str:
    found = get_close_matches(name, known, 1)
    return f' (did you mean {found[0]!r}?)' if found else ''
