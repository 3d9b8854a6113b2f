"""Words of messages: counts and lists."""

from __future__ import annotations

from collections.abc import Sequence


def counted(count: int | str, noun: str) -> str:
    """Return a count with its noun: '1 episode', '2 episodes', '0 episodes', '? episodes'."""
    return f'{count} {noun}' if str(count) == '1' else f'{count} {noun}s'


def listed(names: Sequence[str]) -> str:
    """Return names as a text that stays short, however many and long they are."""
    return first([short(name) for name in names])


def short(name: str) -> str:
    """Return a name, or its beginning if it is long."""
    return name if len(name) <= 32 else f'{name[:30]}..'


def first(texts: Sequence[str]) -> str:
    """Return the first of some texts, and how many are left."""
    more = [f'{len(texts) - 8} more'] if len(texts) > 8 else []
    return ', '.join([*texts[:8], *more])
