# SPDX-License-Identifier: Apache-2.0

"""The pictures of a camera at some steps, from a bag that is read again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cmifs_ros.collect.encoders import thumbnail

from .bag_reader import OpenBag, Undecoded, messages_of
from .message_reader import event_time

#: Types of messages that are pictures.
IMAGES = ('sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage')


def frames_of_bag(
    path: str | Path,
    open_bag: OpenBag,
    topic: str,
    stamps: Sequence[np.ndarray],
    steps: Sequence[tuple[int, int]],
) -> list[np.ndarray | None]:
    """Return a small picture for each step: the newest at its time; None if there is none.

    Parameters
    ----------
    path : path
    open_bag : callable
    topic : str
        Of one of the types in `IMAGES`.
    stamps : sequence of numpy.ndarray of int, shape (T,)
        Times of the steps of each episode, in nanoseconds.
    steps : sequence of (int, int)
        Episode and step of each picture.

    Raises
    ------
    BagError
        If the bag cannot be read.

    """
    wanted = np.array([stamps[episode][step] for episode, step in steps])
    times, messages = np.full(len(steps), -1), [None] * len(steps)
    with open_bag(path) as reader:
        for _, message, recorded in messages_of(reader, path, {topic}):
            if isinstance(message, Undecoded):
                continue
            time = event_time(message) or recorded
            for i in np.flatnonzero((times < time) & (time <= wanted)):
                times[i], messages[i] = time, message
        return [None if message is None else _picture(message) for message in messages]


def _picture(message) -> np.ndarray | None:
    try:
        return thumbnail(message)
    except ValueError:  # The sampler has counted it as wrong.
        return None
