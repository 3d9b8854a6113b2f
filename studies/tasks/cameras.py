# SPDX-License-Identifier: Apache-2.0

"""What the recordings of robots with a camera have in common."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

#: What the camera shows: what the joint states hide; what they say as well; another robot.
KINDS = HIDDEN, GIVEN, ANOTHER = ('hidden', 'given', 'another')


def image_of(pixels: np.ndarray) -> SimpleNamespace:
    """Return a sensor_msgs/Image of grey values (height, width) or colours (height, width, 3)."""
    height, width, *colours = pixels.shape
    return SimpleNamespace(
        height=height, width=width, encoding='rgb8' if colours else 'mono8', is_bigendian=0,
        step=pixels.nbytes // height, data=pixels.tobytes(),
    )  # fmt: skip
