# SPDX-License-Identifier: Apache-2.0

"""The times of a topic's messages: how late, how far back and how far apart they usually are."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from .moments import SECOND

#: A topic that is not received for so long has no say in whether the clock was set. What arrives
#: later was not in transit then.
PATIENCE = 5 * SECOND
#: The wait for a topic is 1.5 times the lateness of its last messages, plus this margin.
RECENT = 100
MARGIN = SECOND // 10
#: Until a topic has sent this many messages, the wait is at least this long.
FEW = 5
FIRST_LATENESS = SECOND // 2


class TopicTimes:
    """The times of one topic's messages, in nanoseconds.

    Parameters
    ----------
    max_wait : int or None
        Longest wait for the topic; None: no limit.

    Attributes
    ----------
    newest, second_newest : int or None
        The newest time and the newest but one since the clock was set.
    is_stamped : bool
        False if the last message had no stamp, so that its time was the receive time.
    heard_at : int
        When a message was last received.
    gaps : collections.deque of int
        Between the newest times.
    wait : int
        How long to wait for the topic.
    is_disordered : bool
        Whether a message was ever older than one before it.

    """

    def __init__(self, max_wait: int | None):
        self._max_wait = max_wait
        self.newest: int | None = None
        self.second_newest: int | None = None
        self.is_stamped = True
        self.heard_at = 0
        self.gaps: deque[int] = deque(maxlen=RECENT)
        self.is_disordered = False
        self._lateness: deque[int] = deque(maxlen=RECENT)
        self._steps_back: deque[int] = deque(maxlen=RECENT)
        self._set_wait()

    def begin(self) -> None:
        """Forget the newest times, because the clock was set."""
        self.newest = self.second_newest = None

    def note(self, time: int, is_stamped: bool) -> None:
        """Note the time of a message."""
        if self.newest is None:
            self.newest = time
        elif time > self.newest:
            self.gaps.append(time - self.newest)
            self.newest, self.second_newest = time, self.newest
        elif self.second_newest is None or time > self.second_newest:
            self.second_newest = time
        self.is_stamped = is_stamped

    def learn(self, lateness: int, step_back: int) -> None:
        """Learn from how late a message is, and how far its topic steps back."""
        if step_back > 0:
            self.is_disordered = True
        self._lateness.append(lateness)
        self._steps_back.append(step_back)
        self._set_wait()

    @property
    def usual_step_back(self) -> int:
        """How far the topic may step back without anything being unusual."""
        return max(0, max(self._steps_back, default=0)) * 3 // 2

    def _set_wait(self) -> None:
        wait = max(self._lateness, default=0) * 3 // 2 + MARGIN
        if len(self._lateness) < FEW:
            wait = max(wait, FIRST_LATENESS)
        self.wait = wait if self._max_wait is None else min(wait, self._max_wait)


def newest_times(topics: Mapping[str, TopicTimes]) -> dict[str, int]:
    """Return the newest time of each topic that has one."""
    return {name: t.newest for name, t in topics.items() if t.newest is not None}


def leaders(topics: Mapping[str, TopicTimes]) -> dict[str, int]:
    """Return the newest time of each topic that tells the time: those with stamps, if any."""
    newest = newest_times(topics)
    return {name: time for name, time in newest.items() if topics[name].is_stamped} or newest


def active(topics: Mapping[str, TopicTimes], now: int) -> set[str]:
    """Return those of the leaders that are not silent."""
    return {name for name in leaders(topics) if now - topics[name].heard_at <= PATIENCE}
