# SPDX-License-Identifier: Apache-2.0

"""Summaries of the messages between two steps: mean, rms, min, max, std, count."""

from __future__ import annotations

import math
from collections.abc import Sequence

from cmifs_ros.collect.robot_file.model import Source


class Summary:
    """Summarise a source's messages since the last step, without keeping them.

    Values that are not finite are left out.
    """

    def __init__(self, source: Source):
        self._what, self._size = source.over, len(source.path.suffixes)
        self._begin()

    def _begin(self) -> None:
        self._numbers = [_Numbers() for _ in range(self._size)]

    @property
    def is_known(self) -> bool:
        """Whether it is defined: a count always is, others need a message."""
        return self._what == ('count',) or all(numbers.count for numbers in self._numbers)

    def add(self, values: Sequence[float]) -> None:
        """Add the values of a message."""
        for numbers, value in zip(self._numbers, values, strict=True):
            numbers.add(value)

    def take(self) -> list[float]:
        """Return the summary, and start over."""
        values = [float(getattr(n, what)) for what in self._what for n in self._numbers]
        self._begin()
        return values

    def take_of(self, newest: Sequence[float]) -> list[float]:
        """Return the summary if no message came and the newest one is still valid; start over."""
        self._begin()
        self.add(newest)
        for numbers in self._numbers:
            numbers.count = 0
        return self.take()


class _Numbers:
    """Moments of a stream of numbers, by Welford's recurrence; `count` of those that are finite."""

    def __init__(self):
        self.count = 0
        self.mean = 0.0
        self.min, self.max = math.inf, -math.inf
        self._spread = 0.0  # The sum of squared distances from the mean.

    def add(self, value: float) -> None:
        if not math.isfinite(value):
            return
        self.count += 1
        distance = value - self.mean
        self.mean += distance / self.count
        self._spread += distance * (value - self.mean)
        self.min, self.max = min(self.min, value), max(self.max, value)

    @property
    def std(self) -> float:
        return math.sqrt(self._spread / self.count) if self._spread else 0.0

    @property
    def rms(self) -> float:
        return math.hypot(self.mean, self.std)
