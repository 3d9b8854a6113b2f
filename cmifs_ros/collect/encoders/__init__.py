# SPDX-License-Identifier: Apache-2.0

"""From messages of many numbers to a few channels, fixed by the robot file alone, without state."""

from .cloud import Cloud
from .encoder import Encoder
from .image import Image
from .installed import installed, installed_names
from .scan import Scan
from .thumbnail import thumbnail
from .yaw import Yaw

__all__ = [
    'Cloud', 'Encoder', 'Image', 'Scan', 'Yaw', 'installed', 'installed_names', 'thumbnail',
]  # fmt: skip
