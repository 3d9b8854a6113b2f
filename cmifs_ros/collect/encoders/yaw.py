# SPDX-License-Identifier: Apache-2.0

"""The yaw of a quaternion."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .encoder import Encoder


@dataclass(frozen=True)
class Yaw(Encoder):
    """Sine and cosine of a quaternion's yaw."""

    needed = (('w', 'x', 'y', 'z'),)
    expected = 'a quaternion of w, x, y, z'
    is_large = False

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Suffixes of its channels' names."""
        return '.sin', '.cos'

    def encode(self, message) -> list[float]:
        """Return sine and cosine; NaN for the quaternion 0."""
        q = message
        sine = 2 * (q.w * q.z + q.x * q.y)
        cosine = 1 - 2 * (q.y * q.y + q.z * q.z)
        length = math.hypot(sine, cosine) or math.nan
        return [sine / length, cosine / length]
