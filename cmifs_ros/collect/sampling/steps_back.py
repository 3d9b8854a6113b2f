# SPDX-License-Identifier: Apache-2.0

"""Tell messages that are late from time that was set back.

Either way topics step back. If another topic goes on, they are late; if all that are due step back,
too, time was set back.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping
from typing import NamedTuple

from .moments import Message
from .topic_times import TopicTimes, active, leaders

MAX_SUSPECTS = 5000


class Suspect(NamedTuple):
    """A message that may be of another time; `counted` is the counter that has it, if any."""

    message: Message
    lateness: int
    counted: Counter | None


class Run:
    """A topic's messages since it stepped back or far away; the newest of them are in order.

    `left` is the topic's newest time before, None if this is its first message.
    """

    def __init__(self, is_stamped: bool, left: int | None):
        self.is_stamped, self.left = is_stamped, left
        self.earlier: deque[Suspect] = deque(maxlen=MAX_SUSPECTS)  # Before it stepped back again.
        self.suspects: deque[Suspect] = deque(maxlen=MAX_SUSPECTS)

    def add(self, suspect: Suspect, tolerance: int) -> None:
        """Add a message; it may be older than the last by the tolerance."""
        if self.suspects and suspect.message.stamp < self.last - tolerance:
            self.earlier.extend(self.suspects)
            self.suspects.clear()
        self.suspects.append(suspect)

    def is_left_by(self, time: int, gap: int) -> bool:
        """Return whether the topic goes on where it was, given its least usual gap."""
        return self.left is not None and time - self.last > max(gap, abs(time - self.left))

    @property
    def last(self) -> int:
        """The time of the last message."""
        return self.suspects[-1].message.stamp

    @property
    def span(self) -> int:
        """The time from the first message to the last."""
        return max(0, self.last - self.suspects[0].message.stamp)


class StepsBack:
    """The topics that have stepped back, until it is known why.

    Parameters
    ----------
    topics : mapping of str to TopicTimes
        All topics.

    Attributes
    ----------
    runs : dict of str to Run
        The messages since then, by topic.
    front, front_sequence : int
        The newest time when the first topic stepped back, and the sequence number of its message.
    unclear : collections.Counter
        By topic, how often it stepped back with most topics while another went on.

    """

    def __init__(self, topics: Mapping[str, TopicTimes]):
        self._topics = topics
        self.unclear: Counter[str] = Counter()
        self.end()

    def end(self) -> None:
        """End the doubt."""
        self.runs: dict[str, Run] = {}
        self.front, self.front_sequence = 0, 0
        self._on: set[str] = set()  # Topics that have gone on since then.
        self._behind: set[str] = set()  # Topics that sent older messages since, as they often do.

    def look_at(self, message: Message, newest_sequence: int) -> None:
        """Note whether a topic steps back or goes on; the message with the newest time is given."""
        name, time = message.topic, message.stamp
        topic, run = self._topics[name], self.runs.get(name)
        if run is not None and run.is_left_by(time, min(topic.gaps, default=0)):
            self._learn_run(name, self.runs.pop(name))
            if not self.runs:
                self.end()
        if name in self.runs:
            return
        # Behind two of its own, and further than usual.
        if (
            topic.second_newest is not None
            and time <= topic.second_newest
            and topic.newest - time > topic.usual_step_back
        ):
            if not self.runs:
                self.front = max(leaders(self._topics).values())
                self.front_sequence = newest_sequence
            self.runs[name] = Run(message.is_stamped, topic.newest)
            self._on.discard(name)
            self._behind.discard(name)
        elif self.runs:
            (self._on if time > self.front else self._behind).add(name)

    def are_late(self, message: Message) -> bool:
        """Return whether a message shows that its topic goes on, and the others are late."""
        wait = self._topics[message.topic].wait
        return message.topic in self._on and message.stamp > self.front + wait

    def is_time_set_back(self, now: int, *, is_over: bool = False) -> bool:
        """Return whether the topics that step back show that time was set back.

        None may go on, and none be due: silent for longer than usual. Those that are silent, but
        not due, are fewer; or time has gone again where it was. `is_over`: nothing more comes.
        """
        if not self.runs or self._on & active(self._topics, now):
            return False
        others = self._others(now)
        span = max(run.span for run in self.runs.values())
        if not span:
            return is_over and len(self.runs) > 1 and not others
        others -= self._behind
        if any(max(self._topics[name].gaps) <= span for name in others):
            return False
        is_again = max(run.last for run in self.runs.values()) > self.front
        return is_over or is_again or len(self.runs) > len(others)

    def take_for_late(self, now: int) -> None:
        """Take what stepped back for late; count it if most topics did."""
        others = self._others(now) - self._behind
        for name, run in self.runs.items():
            self._learn_run(name, run)
            if run.span and len(self.runs) + len(self._behind) > len(others):
                self.unclear[name] += 1
        self.end()

    def _others(self, now: int) -> set[str]:
        """Return the active topics that have not stepped back, and whose usual gap is known."""
        return {t for t in active(self._topics, now) if self._topics[t].gaps} - self.runs.keys()

    def _learn_run(self, name: str, run: Run) -> None:
        for message, lateness, _ in (*run.earlier, *run.suspects):
            step_back = 0 if run.left is None else run.left - message.stamp
            self._topics[name].learn(lateness, step_back)
