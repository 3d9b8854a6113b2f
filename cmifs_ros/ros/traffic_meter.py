# SPDX-License-Identifier: Apache-2.0

"""How much comes on each topic, by the counts of a sampler."""

from __future__ import annotations

import time
from collections.abc import Mapping

from rclpy.serialization import serialize_message

from cmifs_ros.collect.traffic import Rate

#: Seconds between two messages of a topic whose size is taken: it takes a copy of the message.
_SIZE_PERIOD = 5.0


class TrafficMeter:
    """Tell the mean rates of topics since the first message of any.

    Parameters
    ----------
    counts : mapping of str to int
        Messages by topic, which others count.

    """

    def __init__(self, counts: Mapping[str, int]):
        self._counts = counts
        self._first = self._last = 0.0
        self._due: dict[str, float] = {}
        self._sizes: dict[str, tuple[int, int]] = {}  # By topic, how many were taken, and their sum.

    def heard(self, topic: str, message) -> None:
        """Note a message of a topic."""
        self._last = time.monotonic()
        self._first = self._first or self._last
        if self._last >= self._due.get(topic, 0.0):
            self._due[topic] = self._last + _SIZE_PERIOD
            count, total = self._sizes.get(topic, (0, 0))
            self._sizes[topic] = count + 1, total + len(serialize_message(message))

    def rates(self) -> dict[str, Rate]:
        """Return the rate of each topic that spoke; nothing before there is a second message."""
        seconds = self._last - self._first
        if not seconds:
            return {}
        return {
            topic: Rate(self._counts[topic] / seconds, self._counts[topic] * total / count / seconds)
            for topic, (count, total) in self._sizes.items()
        }
