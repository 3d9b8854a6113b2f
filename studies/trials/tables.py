# SPDX-License-Identifier: Apache-2.0

"""Markdown tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def markdown_table(head: Sequence, rows: Iterable[Sequence]) -> str:
    """Return a table from a head and rows of cells."""
    lines = [head, ['---' for _ in head], *rows]
    return ''.join(f'| {" | ".join(map(str, line))} |\n' for line in lines)
