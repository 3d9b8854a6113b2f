# SPDX-License-Identifier: Apache-2.0

"""Images in a column of Parquet files, one by one: structures of the bytes of a JPEG or PNG."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from cmifs_ros.collect.encoders import Encoder, thumbnail
from cmifs_ros.collect.recorded_episodes import RecordingError

from .arrow import pyarrow

#: Rows in memory.
_NUM_ROWS = 32


def encoded(
    files: Sequence[Path],
    column: str,
    encoder: Encoder,
    watch: Callable[[Iterable, int], Iterable],
) -> np.ndarray:
    """Return the encoded image of each row of some files, shape (N, n).

    An image is encoded as it is read; few are in memory.

    Raises
    ------
    RecordingError
        If a row has no image, or one that cannot be decoded.

    """
    from pyarrow import parquet

    num_rows = sum(parquet.read_metadata(file).num_rows for file in files)
    values = np.empty((num_rows, len(encoder.suffixes)))
    cells = (cell for file in files for cell in cells_of(file, column))
    for row, cell in enumerate(watch(cells, num_rows)):
        try:
            values[row] = encoder.encode(_message(cell))
        except ValueError as error:
            raise RecordingError(f'row {row} has {error}') from error
    return values


def picture(files: Sequence[Path], column: str, rows: np.ndarray, step: int) -> np.ndarray:
    """Return a small picture at a step of an episode, given its rows in some files together."""
    from pyarrow import parquet

    row = int(rows[step])
    for file in files:
        num_rows = parquet.read_metadata(file).num_rows
        if row < num_rows:
            return thumbnail(_message(next(cells_of(file, column, row))))
        row -= num_rows
    raise RecordingError(f'{files[-1]} has become shorter')


def cells_of(file: Path, column: str, begin: int = 0) -> Iterator[object]:
    """Yield the cells of a column from a row on."""
    pa = pyarrow()
    from pyarrow import parquet

    try:
        table = parquet.ParquetFile(file, pre_buffer=False)  # A group of rows is not read ahead.
        if column not in table.schema_arrow.names:
            raise RecordingError(f'{file} has no column {column}')
        for batch in table.iter_batches(_NUM_ROWS, columns=[column]):
            if begin < len(batch):
                yield from batch.column(0).slice(begin).to_pylist()
            begin = max(0, begin - len(batch))
    except (pa.ArrowException, OSError) as error:
        what = ' '.join(str(error).split())[:200]
        raise RecordingError(f'{file} cannot be read: {what}') from error


def _message(cell) -> SimpleNamespace:
    """Return a cell as a sensor_msgs/CompressedImage; raise ValueError if it has no image."""
    data = cell.get('bytes') if isinstance(cell, dict) else cell
    if not isinstance(data, bytes):
        raise ValueError('no image; expected the bytes of a JPEG or PNG')
    return SimpleNamespace(format='JPEG or PNG', data=data)
