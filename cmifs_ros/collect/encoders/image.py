# SPDX-License-Identifier: Apache-2.0

"""A camera image as the coarse part of its discrete cosine transform.

Ahmed, Natarajan & Rao, Discrete cosine transform, IEEE Transactions on Computers, 1974: of images
in which neighbouring pixels are alike, it is close to the principal components, but fixed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from .encoder import Encoder
from .pixels import pixels_of

#: Rows and columns of areas over which an image is averaged.
_SIZE = 32
#: Greatest sum of the vertical and the horizontal frequency of a coefficient.
_MAX_FREQUENCY = 4
_FREQUENCIES = [(v, n - v) for n in range(_MAX_FREQUENCY + 1) for v in range(n + 1)]


@dataclass(frozen=True)
class Image(Encoder):
    """The lowest coefficients `[v,h]` of an image's transform, in grey values or units of depth.

    `[0,0]` is the mean of the image; v counts the half waves from top to bottom, h those from left
    to right. Areas without known depth count as the mean of the others.
    """

    needed = (
        ('height', 'width', 'encoding', 'is_bigendian', 'step', 'data'),
        ('format', 'data'),
    )
    expected = 'a sensor_msgs/Image or CompressedImage'

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Suffixes of its channels' names."""
        return tuple(f'[{v},{h}]' for v, h in _FREQUENCIES)

    def encode(self, message) -> list[float]:
        """Return the coefficients; NaN without any known depth."""
        grid = pixels_of(message, _SIZE).averages((_SIZE, _SIZE))
        unknown = np.isnan(grid)
        if unknown.any() and not unknown.all():
            grid[unknown] = grid[~unknown].mean()
        waves = _waves()
        coefficients = waves @ grid @ waves.T
        return [float(coefficients[frequency]) for frequency in _FREQUENCIES]


@lru_cache(maxsize=1)
def _waves() -> np.ndarray:
    """Return the cosines, shape (_MAX_FREQUENCY + 1, _SIZE), scaled so that the first is a mean."""
    angles = np.pi / _SIZE * (np.arange(_SIZE) + 0.5)
    waves = np.cos(np.arange(_MAX_FREQUENCY + 1)[:, None] * angles) / _SIZE
    waves[1:] *= np.sqrt(2)
    return waves
