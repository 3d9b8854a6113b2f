# SPDX-License-Identifier: Apache-2.0

"""What opens bags here, and shows how far they have been read."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.util import find_spec

from cmifs_ros.collect.sampling.bag_reader import OpenBag, has_rosbags, open_bag


def bag_opener() -> OpenBag:
    """Return what opens bags: rosbags, or rosbag2_py where only that is installed."""
    if not has_rosbags() and find_spec('rosbag2_py') is not None:
        from cmifs_ros.ros import rosbag2

        return rosbag2.open_bag
    return open_bag


def with_progress(messages: Iterable, total: int) -> Iterable:
    """Pass messages on, with a progress bar in a terminal."""
    from tqdm import tqdm

    return tqdm(messages, total=total, unit=' messages', disable=None, leave=False)
