# SPDX-License-Identifier: Apache-2.0

"""ULog, the log of PX4: its topics are tables of messages. Needs pyulog: pip install pyulog."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from cmifs_ros.collect.recorded_episodes import RecordingError

from .table import Column, Table

SUFFIXES = ('.ulg', '.ulog')
_ENTRY = re.compile(r'(.*)\[(\d+)\]')
#: PX4 writes quaternions as arrays of this name, in this order.
_QUATERNION, _PARTS = 'q', 'wxyz'


def tables_in(path: Path) -> dict[str, Callable[[], Table]]:
    """Return the topics of a log; a second instance of `/imu` is called `/imu_1`.

    Raises
    ------
    RecordingError
        If the file cannot be read.

    """
    try:
        from pyulog import ULog
    except ImportError as error:
        raise RecordingError('ULog needs pyulog: pip install pyulog') from error
    try:
        topics = ULog(str(path)).data_list
    except Exception as error:  # Invalid files make it raise almost anything.
        raise RecordingError(f'{path} cannot be read as ULog: {error}') from error
    names = [f'/{one.name}_{one.multi_id}' if one.multi_id else f'/{one.name}' for one in topics]
    return {
        name: partial(_table, f'{path}: {name}', one.data)
        for name, one in zip(names, topics, strict=True)
    }


def _table(name: str, data: Mapping[str, np.ndarray]) -> Table:
    """Return the fields of a topic, with microseconds in `timestamp`, as a table."""
    arrays: dict[str, list[np.ndarray]] = {}
    for field, values in data.items():
        entry = _ENTRY.fullmatch(field)
        # The entries of an array of messages are called `esc_0`, `esc_1`.
        stem = re.sub(r'\[(\d+)\]', r'_\1', entry[1] if entry else field)
        arrays.setdefault(stem, []).append(values)
    columns: dict[str, np.ndarray] = {}
    for stem, found in arrays.items():
        if stem.rpartition('.')[2] == _QUATERNION and len(found) == len(_PARTS):
            columns |= {f'{stem}.{part}': v for part, v in zip(_PARTS, found, strict=True)}
        else:
            columns[stem] = found[0] if len(found) == 1 else np.column_stack(found)
    times = columns.pop('timestamp').astype(np.int64) * 1000
    num_bytes = sum(values.nbytes for values in data.values())
    return Table(name, {key: _column(values) for key, values in columns.items()}, times, num_bytes)


def _column(values: np.ndarray) -> Column:
    return Column(lambda begin, end: values[begin:end], values.nbytes, len(values))
