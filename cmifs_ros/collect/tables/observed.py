# SPDX-License-Identifier: Apache-2.0

"""Observe the columns of a table of messages for a first robot file."""

from __future__ import annotations

import numpy as np

from cmifs_ros.collect.robot_file.observed_fields import MAX_LOOKS, ObservedTopic, TypeField

from .table import NANOSECONDS, SECONDS, Table

_ROOT = 'table'
#: Columns with the time of a row, at the root.
_TIMES = (SECONDS, NANOSECONDS, 'header')
#: A table has no types of messages; these are known by their fields.
_QUATERNION = {'w', 'x', 'y', 'z'}
_SCAN = {'ranges', 'angle_min', 'angle_increment'}
#: Rows searched for the first value of a column.
_MAX_EMPTY = 10_000


def observed(topic: str, table: Table, seconds: float) -> ObservedTopic:
    """Return the fields of a table and their values in random rows, the same each time.

    Its rows came in so many seconds.
    """
    count = len(table.times)

    def fields_of(kind: str) -> list[TypeField]:
        columns = table.columns_in(kind.removeprefix(_ROOT).removeprefix('.'))
        return [
            TypeField(name, _what(f'{kind}.{name}', found, count))
            for name, found in columns.items()
            if kind != _ROOT or name not in _TIMES
        ]

    kind = _what(_ROOT, table.columns_in(''), count)
    heard = ObservedTopic(topic, kind, fields_of, count, seconds)
    heard.has_entries = True  # Any cell may be empty.
    rows = np.random.default_rng(0).permutation(count)[:MAX_LOOKS]
    heard.num_unseen = count - len(rows)
    for row in np.sort(rows).tolist():
        heard.look(table.row(row))
    return heard


def _what(kind: str, found, count: int) -> str:
    """Return what a column is, or several below a name; see `TypeField`."""
    if isinstance(found, dict):
        if found.keys() == _QUATERNION:
            return 'geometry_msgs/msg/Quaternion'
        return 'sensor_msgs/msg/LaserScan' if found.keys() >= _SCAN else kind
    values = (found[row] for row in range(min(count, _MAX_EMPTY)))
    value = next((value for value in values if value is not None), None)
    if isinstance(value, str):
        return 'text'
    if hasattr(value, '__len__'):
        return 'numbers' if len(value) and np.asarray(value[0]).dtype.kind in 'biuf' else ''
    return '' if value is None else 'number'
