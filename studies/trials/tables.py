# SPDX-License-Identifier: Apache-2.0

"""Tables as Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def markdown_table(head: Sequence, rows: Iterable[Sequence]) -> str:
    """Return a table of a head and rows of cells, each with a line end."""
    lines = [head, ['---' for _ in head], *rows]
    return ''.join(f'| {" | ".join(map(str, line))} |\n' for line in lines)
