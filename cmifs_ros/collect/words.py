"""Words of messages: counts and lists."""

from __future__ import annotations

from collections.abc import Sequence


def counted(count: int | str, noun: str) -> str:
    """Return a count with its noun: '1 episode', '2 episodes', '0 episodes', '? episodes'."""
    return f'{count} {noun}' if str(count) == '1' else f'{count} {noun}s'


def listed(names: Sequence[str]) -> str:
    """Return names as a text that stays short, however many and long they are."""
    shown = [name if len(name) <= 32 else f'{name[:30]}..' for name in names[:8]]
    more = [f'{len(names) - 8} more'] if len(names) > 8 else []
    return ', '.join(shown + more)
