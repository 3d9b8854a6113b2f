# SPDX-License-Identifier: Apache-2.0

"""The rows of a study as a CSV file that survives interruption."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

from cmifs_ros.tools.program import CommandError


class RowLog:
    """Read the rows in a file, and append to it.

    An incomplete last line, left by a killed process, is dropped.

    Parameters
    ----------
    path : pathlib.Path, optional
        Created if it does not exist; None: nothing is saved.
    columns : sequence of str

    Attributes
    ----------
    rows : list of dict
        Text by column.

    Raises
    ------
    CommandError
        If the file cannot be used or has other columns.

    """

    def __init__(self, path: Path | None, columns: Sequence[str]):
        self._path, self._columns = path, tuple(columns)
        self.rows: list[dict[str, str]] = []
        if path is None:
            return
        try:
            self._read(path)
        except (OSError, ValueError) as error:
            raise CommandError(str(error)) from error

    def add(self, rows: Iterable[Sequence]) -> None:
        """Write rows that belong together."""
        texts = [[str(value) for value in row] for row in rows]
        self.rows += [dict(zip(self._columns, row, strict=True)) for row in texts]
        if self._path is not None:
            self._write(self._path, texts)

    def _read(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        content = path.read_bytes() if path.exists() else b''
        complete = content[: content.rfind(b'\n') + 1]
        if not complete:
            path.write_bytes(b'')
            self._write(path, [self._columns])
            return
        head, *rows = csv.reader(complete.decode(errors='replace').splitlines())
        if tuple(head) != self._columns:
            raise ValueError(f'{path} begins with {head}; expected the columns {self._columns}')
        for line, row in enumerate(rows, start=2):
            if len(row) != len(head):
                raise ValueError(f'{path}, line {line} is {row}; expected {len(head)} values')
            self.rows.append(dict(zip(head, row, strict=True)))
        if complete != content:
            path.write_bytes(complete)

    def _write(self, path: Path, rows: Iterable[Sequence]) -> None:
        with path.open('a', newline='') as file:
            csv.writer(file, lineterminator='\n').writerows(rows)
