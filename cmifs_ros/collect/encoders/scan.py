# SPDX-License-Identifier: Apache-2.0

"""A laser scan by angle, whatever the number of its rays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .encoder import Encoder
from .sectors import NUM_SECTORS, nearest, sectors_of


@dataclass(frozen=True)
class Scan(Encoder):
    """The nearest range in each of some equal sectors; `range_max` where nothing is seen.

    NaN and ranges below `range_min` are no readings, except -inf, which means closer than
    `range_min` (REP 117).

    Attributes
    ----------
    num_sectors : int

    """

    num_sectors: int = NUM_SECTORS

    needed = (('ranges', 'angle_min', 'angle_increment', 'range_min', 'range_max'),)
    expected = 'a sensor_msgs/LaserScan'
    is_large = False

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Suffixes of its channels' names."""
        return tuple(f'[{sector}]' for sector in range(self.num_sectors))

    def encode(self, message) -> list[float]:
        """Return the range of each sector."""
        ranges = np.array(message.ranges, float)
        angles = message.angle_min + message.angle_increment * np.arange(len(ranges))
        if not np.isfinite(angles).all():
            raise ValueError(
                f'a scan from {message.angle_min} in steps of {message.angle_increment}; '
                'expected finite angles in radians'
            )
        ranges[ranges == -np.inf] = message.range_min
        is_read = ranges >= message.range_min  # Not NaN.
        sectors = sectors_of(angles[is_read], self.num_sectors)
        return nearest(ranges[is_read], sectors, self.num_sectors, message.range_max).tolist()
