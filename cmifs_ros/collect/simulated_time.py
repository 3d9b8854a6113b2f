# SPDX-License-Identifier: Apache-2.0

"""The time of /clock, which a simulation publishes."""

from __future__ import annotations

CLOCK, CLOCK_TYPE = '/clock', 'rosgraph_msgs/msg/Clock'


class SimulatedTime:
    """Follow /clock.

    Attributes
    ----------
    now : int
        Nanoseconds of the newest message; 0 before the first.
    seconds : float
        How long the clock ran. A step back, when a simulation is reset, counts as 0.

    """

    def __init__(self):
        self.now, self.seconds = 0, 0.0
        self._is_known = False

    def take(self, message) -> None:
        """Take a message of /clock."""
        before, self.now = self.now, message.clock.sec * 10**9 + message.clock.nanosec
        if self._is_known:
            self.seconds += max(self.now - before, 0) / 1e9
        self._is_known = True
