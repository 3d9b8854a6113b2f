# SPDX-License-Identifier: Apache-2.0

"""The columns of an Arrow table as arrays."""

from __future__ import annotations

import numpy as np

from cmifs_ros.collect.recorded_episodes import RecordingError

from .arrow import pyarrow


class Columns:
    """The columns of a table.

    Parameters
    ----------
    path : object
        For messages.
    table : pyarrow.Table

    Attributes
    ----------
    names : list of str
    unreadable : dict of str to str
        Requested columns without numbers, and why.

    """

    def __init__(self, path, table):
        self.path, self._table, self.names = path, table, table.column_names
        self.unreadable: dict[str, str] = {}

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._table)

    def numbers(self, name: str) -> np.ndarray | None:
        """Return a column, shape (rows,) or (rows, n), with NaN where it is empty, or None."""
        if name not in self.names:
            return None
        pa = pyarrow()
        column, types = self._table[name], pa.types
        kind = column.type
        is_list = types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind)
        of = kind.value_type if is_list else kind
        if not (types.is_integer(of) or types.is_floating(of) or types.is_boolean(of)):
            self.unreadable[name] = f'it holds {of}, not numbers'
            return None
        values = column.combine_chunks()
        if isinstance(values, pa.ChunkedArray):  # It has no chunks.
            values = pa.array([], kind)
        shape = (len(values), self._size(name, values)) if is_list else (len(values),)
        if shape[0] and 0 in shape:
            self.unreadable[name] = 'its lists are empty'
            return None
        values = values.flatten() if is_list else values
        values = values.cast(pa.float64() if values.null_count else of)
        return values.to_numpy(zero_copy_only=False).reshape(shape)

    def _size(self, name: str, lists) -> int:
        """Return the number of values in each row of a column."""
        from pyarrow import compute

        sizes = compute.list_value_length(lists).fill_null(-1).to_numpy()
        like = int(np.argmax(sizes >= 0)) if len(sizes) else 0
        wrong = np.flatnonzero(sizes != sizes[like : like + 1])
        if len(wrong):
            row, size = wrong[0], sizes[wrong[0]]
            raise RecordingError(
                f'{self.path}: row {row} of {name} has {"nothing" if size < 0 else size}; '
                f'expected {sizes[like]} numbers, as row {like} has'
            )
        return max(0, int(sizes[like])) if len(sizes) else 0

    def complete(self, name: str) -> np.ndarray | None:
        """Return a column as `numbers` does; raise RecordingError if a row has none."""
        numbers = self.numbers(name)
        unknown = [] if numbers is None else np.flatnonzero(np.isnan(numbers))
        if len(unknown):
            raise RecordingError(f'{self.path}: row {unknown[0]} has no {name}')
        return numbers

    def by_value(self, name: str) -> dict[str, np.ndarray]:
        """Return the rows with each value of a column, in the order of their first rows."""
        from pyarrow import compute

        column = self._table[name]
        if column.null_count:
            row = compute.index(compute.is_null(column), True).as_py()
            raise RecordingError(f'{self.path}: row {row} has no {name}')
        found = column.combine_chunks().dictionary_encode()
        which = found.indices.to_numpy()
        rows = np.split(np.argsort(which, kind='stable'), np.cumsum(np.bincount(which))[:-1])
        return dict(zip(map(str, found.dictionary.to_pylist()), rows, strict=True))


def until(ends: np.ndarray) -> list[np.ndarray]:
    """Return the rows up to each true one, shape (rows,); those after the last are left out."""
    after = np.flatnonzero(ends) + 1
    return np.split(np.arange(len(ends)), after)[: len(after)]
