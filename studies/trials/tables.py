# SPDX-License-Identifier: Apache-2.0

"""Markdown tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def markdown_table(head: Sequence, rows: Iterable[Sequence]) -> str:
    """Return a table from a head and rows of cells."""
    lines = [head, ['---' for _ in head], *rows]
    return ''.join(f'{table_row(line)}\n' for line in lines)


def table_row(cells: Sequence) -> str:
    """Return a row of a table."""
    return f'| {" | ".join(map(str, cells))} |'
