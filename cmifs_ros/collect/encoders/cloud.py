# SPDX-License-Identifier: Apache-2.0

"""A point cloud by the nearest point in each direction."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .encoder import Encoder
from .pixels import bytes_of
from .sectors import NUM_SECTORS, nearest, sectors_of

#: Metres by default.
MAX_RANGE = 20.0
#: Types of a coordinate by the number in sensor_msgs/PointField.
_KINDS = {7: 'f4', 8: 'f8'}


@dataclass(frozen=True)
class Cloud(Encoder):
    """The nearest horizontal range in each of some equal sectors, by bands of height.

    Points that are not finite, and those at the origin, which drivers use for lost ones, are no
    readings. Without any, a range is `max_range`.

    Attributes
    ----------
    num_sectors : int
    max_range : float
        In metres, like the cloud.
    heights : tuple of float
        The limits of the bands of z, ascending; empty: all heights are one.

    """

    num_sectors: int = NUM_SECTORS
    max_range: float = MAX_RANGE
    heights: tuple[float, ...] = ()

    needed = (('fields', 'point_step', 'row_step', 'height', 'width', 'is_bigendian', 'data'),)
    expected = 'a sensor_msgs/PointCloud2'

    @property
    def _limits(self) -> tuple[float, ...]:
        return self.heights or (-math.inf, math.inf)

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Suffixes of its channels' names: `[sector]`, or `[band,sector]` with several bands."""
        bands = range(len(self._limits) - 1)
        prefixes = [f'{band},' for band in bands] if len(bands) > 1 else ['']
        return tuple(f'[{p}{sector}]' for p in prefixes for sector in range(self.num_sectors))

    def encode(self, message) -> list[float]:
        """Return the range of each band and sector."""
        points = points_of(message)
        x, y, z = (points[name].astype(float) for name in 'xyz')
        is_read = (
            np.isfinite(x) & np.isfinite(y) & np.isfinite(z) & ((x != 0) | (y != 0) | (z != 0))
        )
        bands = np.searchsorted(self._limits, z, side='right') - 1
        num_bands = len(self._limits) - 1
        is_read &= (bands >= 0) & (bands < num_bands)
        x, y, bands = x[is_read], y[is_read], bands[is_read]
        places = bands * self.num_sectors + sectors_of(np.arctan2(y, x), self.num_sectors)
        size = num_bands * self.num_sectors
        return nearest(np.hypot(x, y), places, size, self.max_range).tolist()


def points_of(message) -> np.ndarray:
    """Return the points of a sensor_msgs/PointCloud2 with their fields x, y and z, shape (n,).

    Raises
    ------
    ValueError
        If it has no such fields, or the data are shorter than the cloud.

    """
    fields: Mapping = {field.name: field for field in message.fields}
    kinds = [_KINDS.get(fields[name].datatype) if name in fields else None for name in 'xyz']
    if None in kinds:
        raise ValueError(
            f'a cloud with the fields {", ".join(map(str, fields))[:100] or "none"}; expected '
            'x, y and z of the type FLOAT32 or FLOAT64'
        )
    order = '>' if message.is_bigendian else '<'
    step, row = int(message.point_step), int(message.row_step)
    height, width = int(message.height), int(message.width)
    data = bytes_of(message.data)
    if row < width * step or len(data) < height * row:
        raise ValueError(
            f'a cloud of {height} rows of {width} points with {len(data)} bytes in rows of {row} '
            f'and points of {step}; expected as many bytes as points'
        )
    kind = np.dtype({
        'names': list('xyz'),
        'formats': [f'{order}{kind}' for kind in kinds],
        'offsets': [int(fields[name].offset) for name in 'xyz'],
        'itemsize': step,
    })  # fmt: skip
    return np.ndarray((height, width), kind, data, strides=(row, step)).ravel()
