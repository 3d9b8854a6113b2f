# SPDX-License-Identifier: Apache-2.0

"""From an image message to a small grey or depth image, by area averaging.

Sums are of whole numbers or in a fixed order, so that live and recorded messages give the same.
"""

from __future__ import annotations

import io
from typing import NamedTuple

import numpy as np


class Layout(NamedTuple):
    """How an encoding stores a pixel.

    Attributes
    ----------
    kind : str
        NumPy's name of the type of each number.
    weights : tuple of float
        What each of a pixel's numbers contributes to its grey value.
    is_depth : bool
        Numbers that are 0, NaN or infinite mean that the depth is unknown.

    """

    kind: str
    weights: tuple[float, ...] = (1.0,)
    is_depth: bool = False


#: Luma of red, green and blue by ITU-R BT.601, as most image libraries compute it.
_RGB = (0.299, 0.587, 0.114)
_BGR = _RGB[::-1]
_LAYOUTS = {
    'mono8': Layout('u1'),
    'mono16': Layout('u2'),
    'rgb8': Layout('u1', _RGB),
    'bgr8': Layout('u1', _BGR),
    'rgba8': Layout('u1', (*_RGB, 0.0)),
    'bgra8': Layout('u1', (*_BGR, 0.0)),
    'rgb16': Layout('u2', _RGB),
    'bgr16': Layout('u2', _BGR),
    '8UC1': Layout('u1'),
    '8UC3': Layout('u1', _BGR),
    '16UC1': Layout('u2', is_depth=True),
    '32FC1': Layout('f4', is_depth=True),
    # Of these the luma alone is read.
    'yuv422': Layout('u1', (0.0, 1.0)),
    'uyvy': Layout('u1', (0.0, 1.0)),
    'yuv422_yuy2': Layout('u1', (1.0, 0.0)),
    'yuyv': Layout('u1', (1.0, 0.0)),
}
#: Compressed images are decoded to at least this many times the size needed.
_DECODED_SHARE = 4


def bytes_of(data) -> np.ndarray:
    """Return the bytes of a message's field: array.array, ndarray, bytes, or a list of numbers."""
    return np.asarray(data, np.uint8) if isinstance(data, list) else np.frombuffer(data, np.uint8)


class Pixels(NamedTuple):
    """The pixels of an image: numbers, shape (height, width * numbers of a pixel)."""

    numbers: np.ndarray
    layout: Layout

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        height, length = self.numbers.shape
        return height, length // len(self.layout.weights)

    def averages(self, shape: tuple[int, int]) -> np.ndarray:
        """Return the averages of areas, as many as a shape has.

        These are grey values, or depths in the unit of the message, NaN where no depth is known.
        """
        numbers, layout = self
        known = np.ones(numbers.shape, bool)
        if layout.is_depth:
            known = np.isfinite(numbers) & (numbers > 0)
            numbers = np.where(known, numbers, 0)
        counts = _sums(known, len(layout.weights), shape)[..., 0]
        with np.errstate(invalid='ignore'):
            return _sums(numbers, len(layout.weights), shape) @ np.array(layout.weights) / counts


def pixels_of(message, size: int) -> Pixels:
    """Return the pixels of a sensor_msgs/Image or CompressedImage, JPEG or PNG.

    The latter needs Pillow.

    Parameters
    ----------
    message : object
    size : int
        Number of areas in a row or column over which they will be averaged at most: a compressed
        image that is much larger may be decoded smaller.

    Raises
    ------
    ValueError
        If the encoding is unknown, the data are shorter than the image, or cannot be decoded.

    """
    return _raw(message) if hasattr(message, 'step') else _decompressed(message, size)


def _raw(message) -> Pixels:
    layout = _LAYOUTS.get(message.encoding)
    if layout is None:
        raise ValueError(
            f'the encoding {str(message.encoding)[:40]!r}; expected one of {", ".join(_LAYOUTS)}'
        )
    kind = np.dtype(layout.kind).newbyteorder('>' if message.is_bigendian else '<')
    height, width, step = int(message.height), int(message.width), int(message.step)
    length = width * len(layout.weights) * kind.itemsize
    data = bytes_of(message.data)
    if min(height, width) < 1 or step < length or len(data) < height * step:
        raise ValueError(
            f'an image of {width} x {height} pixels in {message.encoding} with {len(data)} bytes '
            f'in rows of {step}; expected {height} rows of at least {length} bytes'
        )
    rows = data[: height * step].reshape(height, step)[:, :length]
    return Pixels(np.ascontiguousarray(rows).view(kind), layout)


def _decompressed(message, size: int) -> Pixels:
    try:
        from PIL import Image
    except ImportError:
        raise ValueError(
            'compressed images need Pillow: pip install pillow, or python3-pil of the system'
        ) from None
    try:
        file = io.BytesIO(bytes_of(message.data).tobytes())
        with Image.open(file, formats=('JPEG', 'PNG')) as image:
            # A JPEG is decoded smaller and without colours, which saves most of the time.
            image.draft('L', (_DECODED_SHARE * size,) * 2)
            is_depth = image.mode.startswith('I')  # A PNG of 16 bits, as depth cameras have it.
            pixels = np.asarray(image if is_depth else image.convert('L'))
    except Exception as error:  # Broken files make the decoders raise almost anything.
        raise ValueError(
            f'an image in the format {str(message.format)[:40]!r} that cannot be decoded '
            f'({" ".join(str(error).split())[:100]}); expected JPEG or PNG'
        ) from None
    layout = Layout('u2', is_depth=True) if is_depth else Layout('u1')
    return Pixels(pixels.astype(layout.kind), layout)


def _sums(numbers: np.ndarray, depth: int, shape: tuple[int, int]) -> np.ndarray:
    """Return the sums over areas, shape (*shape, depth).

    The areas have whole pixels; if the image is smaller than the shape, pixels are repeated.
    """
    total = np.uint64 if numbers.dtype.kind in 'bu' else np.float64
    height, width = len(numbers), numbers.shape[1] // depth
    rows = [numbers[area].sum(axis=0, dtype=total) for area in _areas(height, shape[0])]
    of_rows = np.stack(rows).reshape(shape[0], width, depth)
    return np.stack([of_rows[:, area].sum(axis=1) for area in _areas(width, shape[1])], axis=1)


def _areas(length: int, count: int) -> list[slice]:
    begins = [i * length // count for i in range(count)]
    ends = [(i + 1) * length // count for i in range(count)]
    return [slice(begin, max(end, begin + 1)) for begin, end in zip(begins, ends, strict=True)]
