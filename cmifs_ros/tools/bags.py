# SPDX-License-Identifier: Apache-2.0

"""What opens bags here."""

from __future__ import annotations

from importlib.util import find_spec

from cmifs_ros.collect.sampling.bag_reader import OpenBag, has_rosbags, open_bag


def bag_opener() -> OpenBag:
    """Return what opens bags: rosbags, or rosbag2_py where only that is installed."""
    if not has_rosbags() and find_spec('rosbag2_py') is not None:
        from cmifs_ros.ros import rosbag2

        return rosbag2.open_bag
    return open_bag
