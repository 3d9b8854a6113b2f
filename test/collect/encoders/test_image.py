# SPDX-License-Identifier: Apache-2.0

"""Images of every encoding give the coefficients of a slow, direct transform."""

import io
import math
from array import array
from types import SimpleNamespace as Message

import numpy as np
import pytest

from cmifs_ros.collect.encoders import Image

SIZE = 32


def image_of(encoding, pixels, *, order='<', padding=0, data=bytes):
    """Return a sensor_msgs/Image of an array, shape (height, width) or (height, width, n)."""
    pixels = pixels.astype(pixels.dtype.newbyteorder(order))
    rows = [row.tobytes() + b'\xff' * padding for row in pixels]
    return Message(
        height=len(pixels), width=pixels.shape[1], encoding=encoding, is_bigendian=order == '>',
        step=len(rows[0]), data=data(b''.join(rows)),
    )  # fmt: skip


def direct(grid):
    """Return the coefficients of a square of averages, by the formula, term by term."""
    found = {}
    for v in range(5):
        for h in range(5 - v):
            scale = (math.sqrt(2) if v else 1) * (math.sqrt(2) if h else 1) / SIZE**2
            found[f'[{v},{h}]'] = scale * sum(
                grid[i][j]
                * math.cos(math.pi * (2 * i + 1) * v / (2 * SIZE))
                * math.cos(math.pi * (2 * j + 1) * h / (2 * SIZE))
                for i in range(SIZE)
                for j in range(SIZE)
            )
    return found


def assert_encoded(message, grid, rel=1e-9):
    encoder = Image()
    assert encoder.fits(vars(message).__contains__)
    found = dict(zip(encoder.suffixes, encoder.encode(message), strict=True))
    assert found == pytest.approx(direct(grid), rel=rel, abs=1e-9)


def averaged(grey):
    """Return the averages of areas of whole pixels."""
    height, width = len(grey) // SIZE, len(grey[0]) // SIZE
    return grey.reshape(SIZE, height, SIZE, width).mean(axis=(1, 3))


RNG = np.random.default_rng(0)
COLOURS = RNG.integers(0, 256, (64, 96, 4), dtype=np.uint8)
RED, GREEN, BLUE = COLOURS[..., :3].transpose(2, 0, 1).astype(float)
GREY = 0.299 * RED + 0.587 * GREEN + 0.114 * BLUE


@pytest.mark.parametrize(
    ('encoding', 'pixels', 'grey'),
    [
        ('mono8', COLOURS[..., 0], RED),
        ('8UC1', COLOURS[..., 0], RED),
        ('rgb8', COLOURS[..., :3], GREY),
        ('bgr8', COLOURS[..., 2::-1], GREY),
        ('8UC3', COLOURS[..., 2::-1], GREY),
        ('rgba8', COLOURS, GREY),
        ('bgra8', COLOURS[..., [2, 1, 0, 3]], GREY),
        ('mono16', COLOURS[..., 0].astype(np.uint16) * 200, RED * 200),
        ('yuv422_yuy2', COLOURS[..., :2], RED),
        ('yuv422', COLOURS[..., 1::-1], RED),
        ('16UC1', COLOURS[..., 0].astype(np.uint16) + 1, RED + 1),
        ('32FC1', COLOURS[..., 0].astype(np.float32) + 0.5, RED + 0.5),
    ],
)
@pytest.mark.parametrize('order', ['<', '>'])
def test_each_encoding_gives_its_grey_values(encoding, pixels, grey, order):
    grid = averaged(grey)
    assert_encoded(image_of(encoding, pixels, order=order, padding=8), grid)


def test_data_may_be_what_rclpy_rosbags_and_tables_have():
    pixels = COLOURS[..., 0]
    found = [
        Image().encode(image_of('mono8', pixels, data=data))
        for data in (bytes, list, lambda d: array('B', d), lambda d: np.frombuffer(d, np.uint8))
    ]
    assert found[0] == found[1] == found[2] == found[3]


def test_areas_have_whole_pixels_and_small_images_repeat_theirs():
    wide = RNG.integers(0, 256, (50, 45), dtype=np.uint8)
    assert_encoded(
        image_of('mono8', wide),
        [[wide[i * 50 // SIZE : (i + 1) * 50 // SIZE, j * 45 // SIZE : (j + 1) * 45 // SIZE].mean()
          for j in range(SIZE)] for i in range(SIZE)],
    )  # fmt: skip
    small = RNG.integers(0, 256, (8, 4), dtype=np.uint8)
    assert_encoded(image_of('mono8', small), small.repeat(4, axis=0).repeat(8, axis=1))


def test_unknown_depth_counts_as_the_mean_of_the_known():
    depth = RNG.uniform(1, 5, (SIZE, SIZE)).astype(np.float32)
    with_gaps = depth.copy()
    with_gaps[0, :4] = math.nan, math.inf, 0.0, -math.inf
    known = np.ones((SIZE, SIZE), bool)
    known[0, :4] = False
    grid = np.where(known, depth, depth[known].astype(float).mean())
    assert_encoded(image_of('32FC1', with_gaps), grid, rel=1e-6)
    assert np.isnan(Image().encode(image_of('32FC1', np.zeros_like(depth)))).all()
    # Black is a grey value like any other.
    assert Image().encode(image_of('mono8', np.zeros((9, 9), np.uint8)))[0] == 0.0


def test_the_first_frequency_is_vertical():
    rows = np.repeat(np.linspace(0, 200, SIZE).astype(np.uint8)[:, None], SIZE, axis=1)
    encoder = Image()
    found = dict(zip(encoder.suffixes, encoder.encode(image_of('mono8', rows)), strict=True))
    assert found['[0,0]'] == pytest.approx(rows.mean())
    assert found['[1,0]'] < -50
    assert found['[0,1]'] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ('change', 'said'),
    [
        ({'encoding': 'bayer_rggb8'}, r"the encoding 'bayer_rggb8'; expected one of mono8, "),
        ({'width': 97}, r'an image of 97 x 64 pixels in mono8 .* rows of at least 97 bytes'),
        ({'data': b'12'}, r'with 2 bytes in rows of 96; expected 64 rows'),
        ({'height': 0}, r'an image of 96 x 0 pixels'),
    ],
)
def test_an_image_that_cannot_be_read_says_why(change, said):
    message = image_of('mono8', COLOURS[..., 0])
    vars(message).update(change)
    with pytest.raises(ValueError, match=said):
        Image().encode(message)


def compressed(pixels, kind):
    images = pytest.importorskip('PIL.Image', reason='Pillow is not here')
    file = io.BytesIO()
    images.fromarray(pixels).save(file, kind)
    return Message(format=kind.lower(), data=array('B', file.getvalue()))


def test_compressed_images_are_read_by_pillow():
    smooth = np.add.outer(np.arange(128), np.arange(128)).astype(np.uint8)
    assert_encoded(compressed(smooth, 'PNG'), averaged(smooth.astype(float)))
    depth = smooth.astype(np.uint16) * 100 + 1
    assert_encoded(compressed(depth, 'PNG'), averaged(depth.astype(float)))
    jpeg = Image().encode(compressed(np.stack([smooth] * 3, axis=-1), 'JPEG'))
    found = dict(zip(Image().suffixes, jpeg, strict=True))
    assert found == pytest.approx(direct(averaged(smooth.astype(float))), abs=0.5)


def test_an_unknown_compression_is_named():
    pytest.importorskip('PIL.Image', reason='Pillow is not here')
    message = Message(format='16UC1; compressedDepth', data=array('B', b'0' * 20))
    with pytest.raises(ValueError, match=r"format '16UC1; compressedDepth' .* expected JPEG or"):
        Image().encode(message)
