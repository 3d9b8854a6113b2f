# SPDX-License-Identifier: Apache-2.0

"""A table whose rows are messages: columns are fields, and each row has a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from types import SimpleNamespace

import numpy as np

from cmifs_ros.collect.recorded_episodes import RecordingError

#: Columns with the time of a row: in seconds or as dates; in nanoseconds; as in ROS.
SECONDS, NANOSECONDS = 'timestamp', 'timestamp_ns'
STAMP = ('header.stamp.sec', 'header.stamp.nanosec')
#: Rows of a column decoded at a time, and their size in bytes.
_MAX_ROWS, _MAX_BYTES = 1000, 2**23
#: The latest time in seconds; in nanoseconds it still fits into 64 bits.
_LATEST = 9 * 10**9


class Column:
    """A column with a block of rows in memory.

    Parameters
    ----------
    read : callable
        Returns the values of a range of rows.
    num_bytes : int
        Size of all rows.
    num_rows : int

    """

    def __init__(self, read: Callable[[int, int], Sequence], num_bytes: int, num_rows: int):
        self._read = read
        self._rows = max(1, min(_MAX_ROWS, _MAX_BYTES * num_rows // max(1, num_bytes)))
        self._begin, self._block = 0, read(0, 0)

    def __getitem__(self, row: int):
        if not 0 <= row - self._begin < len(self._block):
            self._begin = row - row % self._rows
            self._block = self._read(self._begin, self._begin + self._rows)
        return self._block[row - self._begin]


class Table:
    """A table.

    Parameters
    ----------
    name : str
        For messages.
    columns : mapping of str to Column
        By name; dots separate nested fields, as in `pose.position.x`.
    times : numpy.ndarray of int, shape (rows,)
        In nanoseconds; see `times_of`.
    num_bytes : int

    Raises
    ------
    RecordingError
        If the name of a column is also a prefix of another one.

    """

    def __init__(self, name: str, columns: Mapping[str, Column], times: np.ndarray, num_bytes: int):
        self.times, self.num_bytes = times, num_bytes
        self._fields: dict = {}
        for column in sorted(columns):
            *above, last = column.split('.')
            fields = self._fields
            for part in above:
                fields = fields.setdefault(part, {})
                if not isinstance(fields, dict):
                    raise RecordingError(
                        f'{name} has a column {column!r} and another one that begins with it; '
                        'expected other names'
                    )
            fields[last] = columns[column]

    def columns_in(self, name: str) -> dict:
        """Return the columns below a name by the next part of theirs, or mappings of them."""
        found = self._fields
        for part in name.split('.') if name else ():
            found = found[part]
        return found

    def row(self, number: int) -> object:
        """Return a row as a message."""
        return _Message(self._fields, number)

    def messages(self) -> Iterator[tuple[int, object]]:
        """Yield time and message of each row, in the order of time."""
        for row in np.argsort(self.times, kind='stable').tolist():
            yield int(self.times[row]), self.row(row)


class _Message:
    """A row with the columns as attributes, decoded on access."""

    def __init__(self, fields: dict, row: int):
        self._fields, self._row = fields, row

    def __getattr__(self, name: str):
        if name not in self._fields:
            raise AttributeError(name)
        found = self._fields[name]
        return _Message(found, self._row) if isinstance(found, dict) else _plain(found[self._row])

    def __dir__(self):
        return list(self._fields)


def _plain(value):
    """Return a value of a column; structures get attributes like messages."""
    if isinstance(value, np.generic):  # With 32 bits, a stamp would overflow.
        return value.item()
    if isinstance(value, dict):
        return SimpleNamespace(**{key: _plain(part) for key, part in value.items()})
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return [_plain(part) for part in value]
    return value


def times_of(name: str, columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the times of rows in nanoseconds.

    Parameters
    ----------
    name : str
        Name of the table, for messages.
    columns : mapping of str to numpy.ndarray
        The existing ones among `SECONDS`, `NANOSECONDS` and `STAMP`.

    Raises
    ------
    RecordingError
        If there are none, or a time is missing or too great.

    """
    if NANOSECONDS in columns:
        times = _checked(name, NANOSECONDS, columns[NANOSECONDS], _LATEST * 10**9)
    elif SECONDS in columns:
        times = columns[SECONDS]
        if times.dtype.kind == 'M':
            nanoseconds = times.astype('datetime64[ns]').astype(np.int64)
            times = _checked(name, SECONDS, nanoseconds, _LATEST * 10**9)
        else:
            times = _checked(name, SECONDS, times, _LATEST)
            is_whole = times.dtype.kind in 'iu'
            times = times.astype(np.int64) * 10**9 if is_whole else times.astype(float) * 1e9
    elif all(part in columns for part in STAMP):
        seconds, rest = (
            _checked(name, part, columns[part], _LATEST).astype(np.int64) for part in STAMP
        )
        times = seconds * 10**9 + rest
    else:
        raise RecordingError(
            f'{name} has no column {SECONDS} (seconds or dates), {NANOSECONDS} or {STAMP[0]}, '
            'for the time of a row: in a robot file, rows are messages. If they are steps, give '
            'select_from_bag the roles of the columns instead: --episode, --reward, --action'
        )
    return np.round(times).astype(np.int64)


def _checked(name: str, column: str, times: np.ndarray, latest: int) -> np.ndarray:
    """Return the times in a column if all are numbers from 0 to the latest."""
    if len(times) == 0:  # pyarrow knows no type for them.
        return times.astype(float)
    if times.dtype.kind not in 'iuf':
        raise RecordingError(f'{name}: the times are {times.dtype}; expected numbers or dates')
    missing = np.flatnonzero(~(times >= 0))
    if len(missing):
        raise RecordingError(f'{name} has no time in row {missing[0]}; expected a time in each row')
    late = np.flatnonzero(times > latest)
    if len(late):
        raise RecordingError(
            f'{name}: {column} is {times[late[0]]} in row {late[0]}; expected at most '
            f'{latest:.0e}: {SECONDS} is in seconds, {NANOSECONDS} in nanoseconds'
        )
    return times
