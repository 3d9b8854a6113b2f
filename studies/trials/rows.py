# SPDX-License-Identifier: Apache-2.0

"""The rows of a study as a CSV file that survives interruption."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path


class RowLog:
    """Read the rows that a file holds, and add to it.

    A last line without its end, as a process that was killed leaves it, is dropped.

    Parameters
    ----------
    path : pathlib.Path
        Made if it does not exist.
    columns : sequence of str

    Attributes
    ----------
    rows : list of dict
        Text by column.

    Raises
    ------
    ValueError
        If the file has other columns.

    """

    def __init__(self, path: Path, columns: Sequence[str]):
        self._path, self._columns = path, tuple(columns)
        self.rows: list[dict[str, str]] = []
        path.parent.mkdir(parents=True, exist_ok=True)
        content = path.read_text() if path.exists() else ''
        complete = content[: content.rfind('\n') + 1]
        if not complete:
            path.write_text(','.join(columns) + '\n')
            return
        head, *rows = csv.reader(complete.splitlines())
        if tuple(head) != self._columns:
            raise ValueError(f'{path} begins with {head}; expected {self._columns}: move it away')
        path.write_text(complete)
        self.rows = [dict(zip(columns, row, strict=True)) for row in rows]

    def add(self, rows: Iterable[Sequence]) -> None:
        """Write rows that belong together."""
        texts = [[str(value) for value in row] for row in rows]
        self.rows += [dict(zip(self._columns, row, strict=True)) for row in texts]
        with self._path.open('a', newline='') as file:
            csv.writer(file, lineterminator='\n').writerows(texts)
