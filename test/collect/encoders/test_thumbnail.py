# SPDX-License-Identifier: Apache-2.0

"""Small pictures of images of any size, encoding and depth."""

from types import SimpleNamespace as Message

import numpy as np
import pytest

from cmifs_ros.collect.encoders import thumbnail


def image(pixels, encoding):
    return Message(
        height=len(pixels), width=len(pixels[0]), encoding=encoding, is_bigendian=0,
        step=pixels[0].nbytes, data=pixels.tobytes(),
    )  # fmt: skip


def test_a_large_image_is_averaged_and_keeps_its_shape():
    pixels = np.zeros((480, 640, 3), np.uint8)
    pixels[:, 320:, 1] = 100  # luma of green: 0.587
    found = thumbnail(image(pixels, 'rgb8'))
    assert (found.shape, found.dtype) == ((96, 128), np.uint8)
    assert (found[:, :64] == 0).all()
    assert (found[:, 64:] == 59).all()


def test_a_small_one_stays_as_it_is():
    pixels = np.arange(12, dtype=np.uint8).reshape(3, 4)
    np.testing.assert_array_equal(thumbnail(image(pixels, 'mono8')), pixels)


@pytest.mark.parametrize('nothing', [np.nan, 0.0, np.inf])
def test_of_depth_the_farthest_is_white_and_the_unknown_is_black(nothing):
    depth = np.array([[1.0, 2.0, 5.0, nothing]], np.float32)
    assert thumbnail(image(depth, '32FC1')).tolist() == [[0, 64, 255, 0]]
    assert thumbnail(image(np.full((2, 2), nothing, np.float32), '32FC1')).max() == 0


def test_numbers_of_16_bits_are_spread():
    grey = np.array([[1000, 2000, 1500]], np.uint16)
    assert thumbnail(image(grey, 'mono16')).tolist() == [[0, 255, 128]]
