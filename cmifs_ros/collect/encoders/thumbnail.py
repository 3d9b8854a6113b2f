# SPDX-License-Identifier: Apache-2.0

"""A small grey picture of an image message, to look at."""

from __future__ import annotations

import numpy as np

from .pixels import pixels_of

#: Greatest height and width.
_SIZE = 128


def thumbnail(message) -> np.ndarray:
    """Return a small picture, shape (height, width), of grey values of type uint8.

    Depths go from black, for unknown and near, to white for the farthest. So do grey values of 16
    bits.

    Raises
    ------
    ValueError
        As of `pixels_of`.

    """
    pixels = pixels_of(message, _SIZE)
    height, width = pixels.shape
    scale = min(1.0, _SIZE / max(height, width))
    grey = pixels.averages((max(1, round(scale * height)), max(1, round(scale * width))))
    if pixels.numbers.dtype != np.uint8:
        known = grey[np.isfinite(grey)]
        low, high = (known.min(), known.max()) if known.size else (0.0, 0.0)
        grey = 255 * (np.nan_to_num(grey, nan=low) - low) / ((high - low) or 1.0)
    return grey.round().astype(np.uint8)
