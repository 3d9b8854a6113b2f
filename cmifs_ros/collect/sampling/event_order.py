# SPDX-License-Identifier: Apache-2.0

"""Order messages by event time: by their stamps, whatever the order of arrival.

Live, a message waits until every topic has passed its time, or need not be waited for longer: the
wait for a topic is 1.5 times the greatest lateness of its recent messages. In a recording the
messages are sorted. The class also detects that the clock was set, because simulated time starts
over or a robot's clock is corrected.
"""

from __future__ import annotations

import heapq
from collections import Counter, deque
from collections.abc import Iterable
from typing import Any, NamedTuple

SECOND = 1_000_000_000
#: A message this far from the others is wrong; if its topic and others continue so, the clock was
#: set.
JUMP = 60 * SECOND
#: A greater step back of a topic may mean another clock, one of a clock a reset.
STEP_BACK = SECOND
CLOCK_STEP_BACK = SECOND // 10
#: How long a topic with another time waits for others to join it, or to continue without it.
PATIENCE = 5 * SECOND
MAX_WAITING = 100_000
MAX_SUSPECTS = 5000
#: Receive times exceed stamps when the subscriber lags; this much is subtracted.
BEHIND = 2 * SECOND
#: The wait for a topic is 1.5 times the lateness of its last messages, plus this margin.
RECENT = 100
MARGIN = SECOND // 10
#: Until a topic has sent this many messages, the wait is at least this long.
FEW = 5
FIRST_LATENESS = SECOND // 2


class Message(NamedTuple):
    """A waiting message; equal stamps are ordered by the topic's rank, then by arrival.

    `is_stamped` is False if its time is the receive time.
    """

    stamp: int
    rank: int
    sequence: int
    topic: str
    is_stamped: bool
    content: Any


class Moment(NamedTuple):
    """All messages with one time, in nanoseconds."""

    time: int
    messages: list[Message]


#: Marks the moment at which the clock was set.
CLOCK_SET = Moment(-1, [])


class _Suspect(NamedTuple):
    """A message with a suspicious time; `counted` is the counter that has it, if any."""

    message: Message
    lateness: int
    counted: Counter | None


class _Suspects:
    """A topic's newest messages, if all have another time but are in order."""

    def __init__(self, first: Message, is_far: bool, newest: dict[str, int]):
        self.is_far, self.is_stamped = is_far, first.is_stamped
        self.messages: deque[_Suspect] = deque(maxlen=MAX_SUSPECTS)
        self.since, self.newest_then = first.stamp, dict(newest)

    @property
    def stamp(self) -> int:
        """The stamp of the newest one."""
        return self.messages[-1].message.stamp


class EventOrder:
    """Order messages by their stamps.

    Parameters
    ----------
    topics : iterable of str
        All topics, in the order of messages with equal stamps.
    max_lateness : float or None
        Longest wait for a topic, in seconds of event time. None: the messages are recorded, and
        are sorted as far as a minute back.

    Attributes
    ----------
    late, wrong : collections.Counter
        Messages by topic: later than the wait; unusable.
    last_wrong : dict of str to str
        By topic, the problem of the newest unusable message.

    """

    def __init__(self, topics: Iterable[str], max_lateness: float | None = 5.0):
        self._rank = {topic: rank for rank, topic in enumerate(topics)}
        self._max_lateness = None if max_lateness is None else int(max_lateness * SECOND)
        self.late: Counter[str] = Counter()
        self.wrong: Counter[str] = Counter()
        self.last_wrong: dict[str, str] = {}
        self._sequence = 0
        self._lateness: dict[str, deque[int]] = {t: deque(maxlen=RECENT) for t in self._rank}
        self._waits: dict[str, int] = {}
        self._is_disordered: set[str] = set()
        self._unstamped: set[str] = set()
        self._clock: int | None = None
        self._end_before: int | None = None  # The newest stamp before the clock was set.
        for topic in self._rank:
            self._set_wait(topic)
        self._begin(None)

    def _begin(self, time: int | None) -> None:
        """Start over, at a time if it is known."""
        self._begun_at = time
        self._waiting: list[Message] = []
        self._newest: dict[str, int] = {}
        self._repeated: set[str] = set()  # Topics with more than one message.
        self._passed: int | None = None  # Everything before this time has been processed.
        self._suspects: dict[str, _Suspects] = {}

    def note_wrong(self, topic: str, what: str) -> None:
        """Count an unusable message."""
        self.wrong[topic] += 1
        self.last_wrong[topic] = what[:300]

    def add(self, topic: str, stamp: int, is_stamped: bool, content: Any) -> list[Moment]:
        """Add a message; return the moments that are complete now, in order.

        Parameters
        ----------
        topic : str
        stamp : int
            Header stamp in nanoseconds, or the receive time if there is none.
        is_stamped : bool
        content : object
            Returned with the moment.

        """
        self._sequence += 1
        message = Message(stamp, self._rank[topic], self._sequence, topic, is_stamped, content)
        newest = max(self._newest.values(), default=self._begun_at)
        if self._is_left_over(message, newest):
            self.late[topic] += 1
            return []
        is_far = newest is not None and abs(stamp - newest) > JUMP
        is_back = stamp < self._newest.get(topic, stamp) - STEP_BACK
        lateness = max(0, self._reference() - stamp) if self._newest else 0
        if not (is_far or is_back):
            cleared = self._suspects.pop(topic, None)
            if cleared is not None and not cleared.is_far:
                for suspect in cleared.messages:
                    self._learn(topic, suspect.lateness, is_ordered=False)
            self._learn(topic, lateness, stamp >= self._newest.get(topic, stamp))
            self._accept(message)
            return self._due()
        if is_far:
            self.note_wrong(topic, _far(stamp, newest, not is_stamped))
            counted = self.wrong
        else:
            counted = None if self._accept(message) else self.late
        suspects = self._suspects.get(topic)
        if suspects is None or not -STEP_BACK <= stamp - suspects.stamp <= JUMP:
            suspects = self._suspects[topic] = _Suspects(message, is_far, self._newest)
        suspects.messages.append(_Suspect(message, lateness, counted))
        # A receive time says nothing about the clock of other topics' stamps.
        is_led = not is_stamped and self._newest.keys() - self._unstamped
        if not is_led and self._is_clock_set(suspects):
            return self._change_clock(stamp)
        return [] if is_far else self._due()

    def wait_for(self, topic: str) -> float:
        """Return the current wait for a topic, in seconds."""
        return self._waits[topic] / SECOND

    def set_clock(self, now: int) -> list[Moment]:
        """Set the time of /clock in nanoseconds; start over if it was set back."""
        before, self._clock = self._clock, now
        if before is None or now > before - CLOCK_STEP_BACK or not self._newest:
            return []
        newest = max(self._newest.values())
        # The stamps may follow another clock, or have shown the reset already.
        if abs(newest - before) > JUMP or newest <= now + STEP_BACK:
            return []
        return self._change_clock(now)

    def flush(self) -> list[Moment]:
        """Return all waiting messages, because nothing more is due."""
        return self._until(max(self._newest.values()) + 1) if self._newest else []

    def pass_by(self, time: int) -> None:
        """Count messages up to this time as late from now on."""
        self._passed = max(self._passed or 0, time + 1)

    def _learn(self, topic: str, lateness: int, is_ordered: bool) -> None:
        """Note the lateness of a message, and whether its topic is in order."""
        if not is_ordered:
            self._is_disordered.add(topic)
        self._lateness[topic].append(lateness)
        self._set_wait(topic)

    def _set_wait(self, topic: str) -> None:
        seen = self._lateness[topic]
        wait = max(seen, default=0) * 3 // 2 + MARGIN
        if len(seen) < FEW:
            wait = max(wait, FIRST_LATENESS)
        self._waits[topic] = wait if self._max_lateness is None else min(wait, self._max_lateness)

    def _accept(self, message: Message) -> bool:
        """Queue a message; return False, and count it, if it is too late."""
        topic, stamp = message.topic, message.stamp
        if topic in self._newest:
            self._repeated.add(topic)
        self._newest[topic] = max(stamp, self._newest.get(topic, stamp))
        (self._unstamped.discard if message.is_stamped else self._unstamped.add)(topic)
        if self._passed is not None and stamp < self._passed:
            self.late[topic] += 1
            return False
        heapq.heappush(self._waiting, message)
        return True

    def _reference(self) -> int:
        """Return the newest time that is known to have been reached."""
        return max(
            time - (BEHIND if topic in self._unstamped else 0)
            for topic, time in self._newest.items()
        )

    def _due(self) -> list[Moment]:
        """Return the moments that need not wait any longer."""
        reference = self._reference()
        if self._max_lateness is None:
            limit = reference - JUMP
        else:
            limit = min(
                max(
                    0 if topic in self._is_disordered else self._newest.get(topic, 0),
                    reference - wait,
                )
                for topic, wait in self._waits.items()
            )
        if len(self._waiting) > MAX_WAITING:
            limit = max(limit, self._waiting[0].stamp + 1)
        return self._until(limit)

    def _until(self, limit: int) -> list[Moment]:
        moments: list[Moment] = []
        while self._waiting and self._waiting[0].stamp < limit:
            message = heapq.heappop(self._waiting)
            if not moments or moments[-1].time != message.stamp:
                moments.append(Moment(message.stamp, []))
            moments[-1].messages.append(message)
        if self._passed is None or limit > self._passed:
            self._passed = limit
        return moments

    def _is_clock_set(self, suspects: _Suspects) -> bool:
        """Return whether the clock was set to the time of these suspects.

        A far time needs more topics than may continue with the old time. A time some seconds back
        needs that no topic continues with the old time; topics of a single message do not count.
        """
        joined = {
            topic: other
            for topic, other in self._suspects.items()
            if other.is_stamped == suspects.is_stamped and abs(other.stamp - suspects.stamp) <= JUMP
        }
        if max(len(other.messages) for other in joined.values()) == 1:
            return False
        others = self._newest.keys() - self._unstamped - joined.keys()
        go_on = {t for t in others if self._newest[t] != suspects.newest_then.get(t)}
        if suspects.stamp - suspects.since >= PATIENCE:
            suspects.since, suspects.newest_then = suspects.stamp, dict(self._newest)
            others = go_on
        if suspects.is_far:
            return len(joined) > len(others)
        return not go_on and len(joined) > len(others & self._repeated)

    def _change_clock(self, time: int) -> list[Moment]:
        """Finish the time before the clock was set; keep messages from the new time."""
        end = max(self._newest.values())

        def is_after(message: Message) -> bool:
            distance = abs(message.stamp - time)
            return distance <= JUMP and distance < abs(message.stamp - end)

        joined = [s for s in self._suspects.values() if is_after(s.messages[-1].message)]
        first = min((s.messages[0].message.sequence for s in joined), default=self._sequence + 1)
        after = [m for m in self._waiting if m.sequence >= first and is_after(m)]
        for message, _, counted in (suspect for s in joined for suspect in s.messages):
            if counted is not None and is_after(message):
                counted[message.topic] -= 1
                after.append(message)
        moved = {message.sequence for message in after}
        self._waiting = [m for m in self._waiting if m.sequence not in moved]
        heapq.heapify(self._waiting)
        moments = self._until(end + 1)
        self._begin(time)
        self._end_before = end
        for message in sorted(after, key=lambda message: message.sequence):
            self._accept(message)
        return [*moments, CLOCK_SET, *(self._due() if self._newest else [])]

    def _is_left_over(self, message: Message, newest: int | None) -> bool:
        """Return whether a message was in transit while the clock was set."""
        if self._end_before is None or message.topic in self._newest or not message.is_stamped:
            return False
        age = self._end_before - message.stamp
        is_soon = newest - self._begun_at <= PATIENCE
        return is_soon and -STEP_BACK <= age <= JUMP and abs(age) < abs(message.stamp - newest)


def _far(stamp: int, newest: int, is_received: bool) -> str:
    what = f'{stamp / SECOND:.3f} s is far from the other topics, at {newest / SECOND:.3f} s'
    if is_received:
        return (
            f'it has no stamp, and its receive time, {what}: if their time is simulated, '
            'set use_sim_time, or record /clock'
        )
    return f'its stamp, {what}: set the clock of the node that stamps it'
