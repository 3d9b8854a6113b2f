# SPDX-License-Identifier: Apache-2.0

"""Order messages by event time: by their stamps, whatever the order of arrival.

Live, a message waits until every topic has passed its time, or need not be waited for longer: the
wait for a topic is 1.5 times the greatest lateness of its recent messages. In a recording the
messages are sorted. The class also detects that the clock was set, because simulated time starts
over or a robot's clock is corrected.

A message that steps back in its topic is late, or time was set back. /clock tells which. Without it
the other topics do: if one goes on, the message is late; if all that are due step back, too, time
was set back. Meanwhile nothing is due.
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
#: A topic that is not received for so long has no say in whether the clock was set. What arrives
#: later was not in transit then.
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
    """A message that may be of another time; `counted` is the counter that has it, if any."""

    message: Message
    lateness: int
    counted: Counter | None


class _Run:
    """A topic's messages since it stepped back or far away; the newest of them are in order.

    `left` is the topic's newest stamp before, None if this is its first message.
    """

    def __init__(self, is_stamped: bool, left: int | None):
        self.is_stamped, self.left = is_stamped, left
        self.earlier: deque[_Suspect] = deque(maxlen=MAX_SUSPECTS)  # Before it stepped back again.
        self.suspects: deque[_Suspect] = deque(maxlen=MAX_SUSPECTS)

    def add(self, suspect: _Suspect, tolerance: int) -> None:
        if self.suspects and suspect.message.stamp < self.last - tolerance:
            self.earlier.extend(self.suspects)
            self.suspects.clear()
        self.suspects.append(suspect)

    def is_left_by(self, stamp: int, gap: int) -> bool:
        """Return whether the topic goes on where it was, given its least usual gap."""
        return self.left is not None and stamp - self.last > max(gap, abs(stamp - self.left))

    @property
    def last(self) -> int:
        return self.suspects[-1].message.stamp

    @property
    def span(self) -> int:
        return max(0, self.last - self.suspects[0].message.stamp)


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
    unclear : collections.Counter
        By topic, how often it stepped back with most topics while another went on: it was late, or
        time was set back.
    last_wrong : dict of str to str
        By topic, the problem of the newest unusable message.

    """

    def __init__(self, topics: Iterable[str], max_lateness: float | None = 5.0):
        self._rank = {topic: rank for rank, topic in enumerate(topics)}
        self._max_lateness = None if max_lateness is None else int(max_lateness * SECOND)
        self.late: Counter[str] = Counter()
        self.wrong: Counter[str] = Counter()
        self.unclear: Counter[str] = Counter()
        self.last_wrong: dict[str, str] = {}
        self._sequence = 0
        self._lateness: dict[str, deque[int]] = {t: deque(maxlen=RECENT) for t in self._rank}
        self._steps_back: dict[str, deque[int]] = {t: deque(maxlen=RECENT) for t in self._rank}
        self._gaps: dict[str, deque[int]] = {t: deque(maxlen=RECENT) for t in self._rank}
        self._waits: dict[str, int] = {}
        self._is_disordered: set[str] = set()
        self._unstamped: set[str] = set()
        self._received: int | None = None
        self._elapsed = 0  # By receive times, which may be set back, too.
        self._heard: dict[str, int] = {}
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
        self._second: dict[str, int] = {}  # By topic, the newest stamp but one.
        self._raised = 0  # The message with the newest stamp.
        self._passed: int | None = None  # Everything before this time has been processed.
        self._end_doubt()
        self._far: dict[str, _Run] = {}

    def _end_doubt(self) -> None:
        self._runs: dict[str, _Run] = {}  # Of topics that stepped back.
        # The newest stamp when the first of them did, and the sequence number of its message.
        self._front, self._front_sequence = 0, 0
        self._on: set[str] = set()  # Topics that have gone on since then.
        self._behind: set[str] = set()  # Topics that sent older messages since, as they often do.

    def note_wrong(self, topic: str, what: str) -> None:
        """Count an unusable message."""
        self.wrong[topic] += 1
        self.last_wrong[topic] = what[:300]

    def add(self, topic: str, stamp: int | None, received: int, content: Any) -> list[Moment]:
        """Add a message; return the moments that are complete now, in order.

        Parameters
        ----------
        topic : str
        stamp : int or None
            Header stamp in nanoseconds, if there is one.
        received : int
            Receive time in nanoseconds, which takes the place of a missing stamp.
        content : object
            Returned with the moment.

        """
        self._sequence += 1
        self._elapsed += max(0, received - (self._received or received))
        self._received = received
        is_stamped = stamp is not None
        time = stamp if is_stamped else received
        message = Message(time, self._rank[topic], self._sequence, topic, is_stamped, content)
        newest = max(self._newest.values(), default=self._begun_at)
        if self._is_left_over(message, newest):
            self.late[topic] += 1
            return []
        self._heard[topic] = self._elapsed
        # A receive time says nothing about the clock of other topics' stamps.
        leads = is_stamped or not self._newest.keys() - self._unstamped
        if newest is not None and abs(time - newest) > JUMP:
            return self._add_far(message, newest, leads)
        self._far.pop(topic, None)
        if leads:
            self._look_back(message)
        lateness = max(0, self._reference() - time) if self._newest else 0
        if topic in self._runs:
            counted = None if self._accept(message) else self.late
            self._runs[topic].add(_Suspect(message, lateness, counted), self._usual_back(topic))
        else:
            self._learn(topic, lateness, self._newest.get(topic, time) - time)
            self._accept(message)
        if self._runs:
            if topic in self._on and time > self._front + self._waits[topic]:
                self._dispel()
            elif self._is_set_back() and not self._follows_clock():
                return self._change_clock(None)
        return self._due()

    def _look_back(self, message: Message) -> None:
        """Note whether a topic steps back, or goes on."""
        topic, stamp = message.topic, message.stamp
        newest, run = self._newest.get(topic, stamp), self._runs.get(topic)
        if run is not None and run.is_left_by(stamp, min(self._gaps[topic], default=0)):
            self._learn_run(topic, self._runs.pop(topic))
            if not self._runs:
                self._end_doubt()
        if topic in self._runs:
            return
        # Behind two of its own, and further than usual.
        steps_back = stamp <= self._second.get(topic, stamp - 1) and (
            newest - stamp > self._usual_back(topic)
        )
        if steps_back:
            if not self._runs:
                self._front = max(self._newest[t] for t in self._leaders())
                self._front_sequence = self._raised
            self._runs[topic] = _Run(message.is_stamped, self._newest.get(topic))
            self._on.discard(topic)
            self._behind.discard(topic)
        elif self._runs:
            (self._on if stamp > self._front else self._behind).add(topic)

    def _add_far(self, message: Message, newest: int, leads: bool) -> list[Moment]:
        """Count a message of another time as wrong, unless most topics have gone there."""
        topic = message.topic
        self.note_wrong(topic, _far(message.stamp, newest, not message.is_stamped))
        run = self._far.get(topic)
        if run is None or abs(message.stamp - run.last) > JUMP:
            run = self._far[topic] = _Run(message.is_stamped, self._newest.get(topic))
        run.add(_Suspect(message, 0, self.wrong), JUMP)
        joined = [
            t
            for t, other in self._far.items()
            if other.is_stamped == run.is_stamped and abs(other.last - run.last) <= JUMP
        ]
        others = self._active().difference(joined, self._unstamped if run.is_stamped else ())
        is_double = max(len(self._far[t].suspects) for t in joined) > 1
        if leads and is_double and len(joined) > len(others):
            return self._change_clock(message.stamp)
        return []

    def wait_for(self, topic: str) -> float:
        """Return the current wait for a topic, in seconds."""
        return self._waits[topic] / SECOND

    def set_clock(self, now: int) -> list[Moment]:
        """Set the time of /clock in nanoseconds; start over if it was set back."""
        follows = self._follows_clock()
        before, self._clock = self._clock, now
        if not follows:
            return []
        if now < before:
            return self._change_clock(now)
        if self._runs and now > self._front + MARGIN:
            self._dispel()
            return self._due()
        return []

    def flush(self) -> list[Moment]:
        """Return all waiting messages, because nothing more is due."""
        moments = []
        if self._is_set_back(is_over=True) and not self._follows_clock():
            moments = self._change_clock(None)
        self._dispel()
        return moments + (self._until(max(self._newest.values()) + 1) if self._newest else [])

    def pass_by(self, time: int) -> None:
        """Count messages up to this time as late from now on."""
        self._passed = max(self._passed or 0, time + 1)

    def _follows_clock(self) -> bool:
        """Return whether the stamps are those of /clock, which then tells when it is set."""
        if self._clock is None or not self._newest:
            return False
        return abs(max(self._newest.values()) - self._clock) <= JUMP

    def _leaders(self) -> set[str]:
        """Return the topics that tell the time: those with stamps, if any."""
        return set(self._newest.keys() - self._unstamped or self._newest)

    def _active(self) -> set[str]:
        return {t for t in self._leaders() if self._elapsed - self._heard[t] <= PATIENCE}

    def _is_set_back(self, *, is_over: bool = False) -> bool:
        """Return whether the topics that step back show that time was set back.

        None may go on, and none be due: silent for longer than usual. Those that are silent, but
        not due, are fewer; or time has gone again where it was. `is_over`: nothing more comes.
        """
        active = self._active()
        if not self._runs or self._on & active:
            return False
        others = {t for t in active if self._gaps[t]} - self._runs.keys()
        span = max(run.span for run in self._runs.values())
        if not span:
            return is_over and len(self._runs) > 1 and not others
        others -= self._behind
        if any(max(self._gaps[t]) <= span for t in others):
            return False
        is_again = max(run.last for run in self._runs.values()) > self._front
        return is_over or is_again or len(self._runs) > len(others)

    def _dispel(self) -> None:
        """Take what stepped back for late; count it if most topics did."""
        others = {t for t in self._active() if self._gaps[t]} - self._runs.keys() - self._behind
        for topic, run in self._runs.items():
            self._learn_run(topic, run)
            if run.span and len(self._runs) + len(self._behind) > len(others):
                self.unclear[topic] += 1
        self._end_doubt()

    def _learn_run(self, topic: str, run: _Run) -> None:
        for message, lateness, _ in (*run.earlier, *run.suspects):
            self._learn(topic, lateness, 0 if run.left is None else run.left - message.stamp)

    def _learn(self, topic: str, lateness: int, step_back: int) -> None:
        """Note the lateness of a message, and how far its topic steps back."""
        if step_back > 0:
            self._is_disordered.add(topic)
        self._lateness[topic].append(lateness)
        self._steps_back[topic].append(step_back)
        self._set_wait(topic)

    def _usual_back(self, topic: str) -> int:
        return max(0, max(self._steps_back[topic], default=0)) * 3 // 2

    def _set_wait(self, topic: str) -> None:
        seen = self._lateness[topic]
        wait = max(seen, default=0) * 3 // 2 + MARGIN
        if len(seen) < FEW:
            wait = max(wait, FIRST_LATENESS)
        self._waits[topic] = wait if self._max_lateness is None else min(wait, self._max_lateness)

    def _accept(self, message: Message) -> bool:
        """Queue a message; return False, and count it, if it is too late."""
        topic, stamp = message.topic, message.stamp
        newest = self._newest.get(topic)
        if stamp > max((self._newest[t] for t in self._leaders()), default=stamp - 1):
            self._raised = message.sequence
        if newest is None:
            self._newest[topic] = stamp
        elif stamp > newest:
            self._gaps[topic].append(stamp - newest)
            self._newest[topic], self._second[topic] = stamp, newest
        else:
            self._second[topic] = max(stamp, self._second.get(topic, stamp))
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
        """Return the moments that need not wait any longer; none while in doubt."""
        if len(self._waiting) > MAX_WAITING:
            self._dispel()
        if self._runs:
            return []
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

    def _change_clock(self, now: int | None) -> list[Moment]:
        """Finish the time before the clock was set; keep messages from the new time.

        If that is None, it is the time of the topics that stepped back.
        """
        time = max(run.last for run in self._runs.values()) if now is None else now
        end = max(
            self._runs[t].left if t in self._runs and self._runs[t].left is not None else newest
            for t, newest in self._newest.items()
        )

        def is_after(message: Message) -> bool:
            distance = abs(message.stamp - time)
            return distance <= JUMP and distance < abs(message.stamp - end)

        runs = [*self._runs.values()]
        far = [r for r in self._far.values() if is_after(r.suspects[-1].message)]
        suspects = [
            suspect
            for run in (*far, *runs)
            for suspect in run.suspects
            if is_after(suspect.message) or (now is None and run in runs)
        ]
        # A topic that has sent little does not step back, but it comes after the newest, too.
        first = min((s.message.sequence for s in suspects), default=self._sequence + 1)
        if now is None:
            first = self._front_sequence
        after = {m.sequence: m for m in self._waiting if m.sequence >= first and is_after(m)}
        for message, _, counted in suspects:
            after[message.sequence] = message
            if counted is not None:
                counted[message.topic] -= 1
        # Time was set more than once before that could be told.
        lost = {
            s.message.sequence
            for run in (runs if now is None else [])
            for s in run.earlier
            if s.counted is None
        }
        self.late.update(m.topic for m in self._waiting if m.sequence in lost)
        self._waiting = [m for m in self._waiting if m.sequence not in lost | after.keys()]
        heapq.heapify(self._waiting)
        self._end_doubt()
        moments = self._until(end + 1)
        self._begin(time)
        self._end_before = end
        for _, message in sorted(after.items()):
            self._accept(message)
        return [*moments, CLOCK_SET, *(self._due() if self._newest else [])]

    def _is_left_over(self, message: Message, newest: int | None) -> bool:
        """Return whether a message was in transit while the clock was set."""
        if self._end_before is None or message.topic in self._newest or not message.is_stamped:
            return False
        age = self._end_before - message.stamp
        ahead = message.stamp - max(newest, self._begun_at)
        is_soon = newest - self._begun_at <= PATIENCE
        return is_soon and -SECOND <= age <= JUMP and ahead > MARGIN and abs(age) < ahead


def _far(stamp: int, newest: int, is_received: bool) -> str:
    what = f'{stamp / SECOND:.3f} s is far from the other topics, at {newest / SECOND:.3f} s'
    if is_received:
        return (
            f'it has no stamp, and its receive time, {what}: if their time is simulated, '
            'set use_sim_time, or record /clock'
        )
    return f'its stamp, {what}: set the clock of the node that stamps it'
