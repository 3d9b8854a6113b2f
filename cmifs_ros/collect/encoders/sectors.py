# SPDX-License-Identifier: Apache-2.0

"""The nearest of some ranges in each sector of the circle around a sensor."""

from __future__ import annotations

import numpy as np

#: Sectors by default, 30 degrees each.
NUM_SECTORS = 12


def sectors_of(angles: np.ndarray, num_sectors: int) -> np.ndarray:
    """Return the sector of each angle in radians.

    Sector 0 is centred straight ahead (x), the others follow counterclockwise.
    """
    return np.rint(angles * (num_sectors / (2 * np.pi))).astype(np.int64) % num_sectors


def nearest(ranges: np.ndarray, places: np.ndarray, num_places: int, farthest: float) -> np.ndarray:
    """Return the least range in each place, at most `farthest`; that where there is none.

    Parameters
    ----------
    ranges : numpy.ndarray of float, shape (n,)
    places : numpy.ndarray of int, shape (n,)
        The place of each range, such as its sector.
    num_places : int
    farthest : float

    Returns
    -------
    numpy.ndarray, shape (num_places,)

    """
    found = np.full(num_places, farthest)
    np.minimum.at(found, places, ranges)
    return found
