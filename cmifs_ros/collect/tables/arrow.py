# SPDX-License-Identifier: Apache-2.0

"""Parquet, CSV and data frames, read by pyarrow, which is optional: pip install pyarrow."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from cmifs_ros.collect.recorded_episodes import RecordingError

from .table import NANOSECONDS, SECONDS, STAMP, Column, Table, times_of

#: The files of tables.
SUFFIXES = ('.parquet', '.csv')
#: The names that pandas gives to an index without a name, in Parquet and in CSV.
_INDEX = re.compile(r'__index_level_\d+__|')


def pyarrow():
    """Return the module; raise RecordingError with the remedy if it is missing."""
    try:
        import pyarrow as found
    except ImportError as error:
        raise RecordingError('tables need pyarrow: pip install pyarrow') from error
    return found


def is_wanted(kind) -> bool:
    """Return whether an Arrow type holds numbers or words; images do not."""
    types = pyarrow().types
    if types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind):
        return is_wanted(kind.value_type)
    if types.is_struct(kind):
        return all(is_wanted(part.type) for part in kind)
    return not (types.is_binary(kind) or types.is_large_binary(kind) or types.is_null(kind))


def read(path: Path):
    """Return a file's Arrow table without images; raise RecordingError if it is not a table."""
    pa = pyarrow()
    from pyarrow import csv, parquet

    try:
        if path.suffix == '.csv':
            return _without_index(csv.read_csv(path))
        file = parquet.ParquetFile(path)
        wanted = [part.name for part in file.schema_arrow if is_wanted(part.type)]
        return _without_index(file.read(wanted))
    except (pa.ArrowException, OSError) as error:
        what = ' '.join(str(error).split())[:300]
        raise RecordingError(f'{path} cannot be read as {path.suffix[1:]}: {what}') from error


def joined(path, tables: Iterable):
    """Return the tables of a data set as one Arrow table; raise RecordingError if they differ."""
    pa = pyarrow()
    try:
        return pa.concat_tables(tables, promote_options='permissive')
    except pa.ArrowException as error:
        what = ' '.join(str(error).split())[:300]
        raise RecordingError(f'the tables of {path} cannot be joined: {what}') from error


def table_of(frame):
    """Return a data frame as an Arrow table; raise RecordingError if it is not one."""
    try:
        return _without_index(pyarrow().table(frame))
    except (TypeError, ValueError) as error:
        raise RecordingError(
            f'{type(frame).__name__} is not a data frame: {" ".join(str(error).split())[:300]}'
        ) from error


def _without_index(table):
    """Return an Arrow table without the numbers of rows that pandas writes as a column."""
    return table.drop_columns([name for name in table.column_names if _INDEX.fullmatch(name)])


def files_in(path: Path) -> list[Path]:
    """Return the table files at a path, which is one or a folder of them."""
    return sorted(file for file in (path, *path.rglob('*')) if file.suffix in SUFFIXES)


def messages_of(name: str, table) -> Table:
    """Return an Arrow table as a table of messages."""
    while any(pyarrow().types.is_struct(part.type) for part in table.schema):
        table = table.flatten()
    columns = {column: _column(table[column]) for column in table.column_names}
    told = [part for part in (SECONDS, NANOSECONDS, *STAMP) if part in columns]
    times = times_of(name, {part: table[part].to_numpy() for part in told})
    return Table(name, columns, times, table.nbytes)


def _column(values) -> Column:
    return Column(
        lambda begin, end: values.slice(begin, end - begin).to_pylist(), values.nbytes, len(values)
    )
