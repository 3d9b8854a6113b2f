# SPDX-License-Identifier: Apache-2.0

"""Order messages by event time: by their stamps, whatever the order of arrival.

Live, a message waits until every topic has passed its time, or need not be waited for longer: the
wait for a topic is 1.5 times the greatest lateness of its recent messages. In a recording the
messages are sorted. The class also detects that the clock was set, because simulated time starts
over or a robot's clock is corrected: /clock tells, or the topics that step back. As long as that is
in doubt, nothing is due.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterable
from typing import Any

from .moments import CLOCK_SET, SECOND, Message, Moment
from .steps_back import Run, StepsBack, Suspect
from .topic_times import MARGIN, PATIENCE, TopicTimes, active, leaders, newest_times

#: A message this far from the others is wrong; if its topic and others continue so, the clock was
#: set.
JUMP = 60 * SECOND
MAX_WAITING = 100_000
#: Receive times exceed stamps when the subscriber lags; this much is subtracted.
BEHIND = 2 * SECOND


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
        self._is_recorded = max_lateness is None
        max_wait = None if max_lateness is None else int(max_lateness * SECOND)
        self._topics = {topic: TopicTimes(max_wait) for topic in topics}
        self._rank = {topic: rank for rank, topic in enumerate(self._topics)}
        self._steps_back = StepsBack(self._topics)
        self.late: Counter[str] = Counter()
        self.wrong: Counter[str] = Counter()
        self.last_wrong: dict[str, str] = {}
        self._sequence = 0
        self._received: int | None = None
        self._elapsed = 0  # By receive times, which may be set back, too.
        self._clock: int | None = None
        self._end_before: int | None = None  # The newest time before the clock was set.
        self._begin(None)

    def _begin(self, time: int | None) -> None:
        """Start over, at a time if it is known."""
        self._begun_at = time
        self._waiting: list[Message] = []
        self._raised = 0  # The sequence number of the message with the newest time.
        self._passed: int | None = None  # Everything before this time has been processed.
        for topic in self._topics.values():
            topic.begin()
        self._steps_back.end()
        self._far: dict[str, Run] = {}

    @property
    def unclear(self) -> Counter[str]:
        """How often a topic stepped back with most others: they were late, or time was set back."""
        return self._steps_back.unclear

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
        times, steps_back = self._topics[topic], self._steps_back
        newest = max(newest_times(self._topics).values(), default=self._begun_at)
        if self._is_left_over(message, newest):
            self.late[topic] += 1
            return []
        times.heard_at = self._elapsed
        # A receive time says nothing about the clock of other topics' stamps.
        leads = is_stamped or not any(self._topics[t].is_stamped for t in leaders(self._topics))
        if newest is not None and abs(time - newest) > JUMP:
            return self._add_far(message, newest, leads)
        self._far.pop(topic, None)
        if leads:
            steps_back.look_at(message, self._raised)
        lateness = max(0, self._reference(default=time) - time)
        if topic in steps_back.runs:
            counted = None if self._accept(message) else self.late
            steps_back.runs[topic].add(Suspect(message, lateness, counted), times.usual_step_back)
        else:
            times.learn(lateness, 0 if times.newest is None else times.newest - time)
            self._accept(message)
        if steps_back.are_late(message):
            steps_back.take_for_late(self._elapsed)
        elif steps_back.is_time_set_back(self._elapsed) and not self._follows_clock():
            return self._change_clock(None)
        return self._due()

    def _add_far(self, message: Message, newest: int, leads: bool) -> list[Moment]:
        """Count a message of another time as wrong, unless most topics have gone there."""
        topic, is_stamped = message.topic, message.is_stamped
        remedy = 'set the clock of the node that stamps it'
        if not is_stamped and self._clock is None:
            remedy = 'if their time is simulated, set use_sim_time, or record /clock'
        elif not is_stamped:
            remedy = 'their stamps are not in the time of /clock'
        self.note_wrong(topic, _far(message.stamp, newest, not is_stamped, remedy))
        run = self._far.get(topic)
        if run is None or abs(message.stamp - run.last) > JUMP:
            run = self._far[topic] = Run(is_stamped, self._topics[topic].newest)
        run.add(Suspect(message, 0, self.wrong), JUMP)
        joined = [
            t
            for t, other in self._far.items()
            if other.is_stamped == run.is_stamped and abs(other.last - run.last) <= JUMP
        ]
        others = active(self._topics, self._elapsed).difference(joined)
        if run.is_stamped:
            others = {t for t in others if self._topics[t].is_stamped}
        is_double = max(len(self._far[t].suspects) for t in joined) > 1
        if leads and is_double and len(joined) > len(others):
            return self._change_clock(message.stamp)
        return []

    def wait_for(self, topic: str) -> float:
        """Return the current wait for a topic, in seconds."""
        return self._topics[topic].wait / SECOND

    def set_clock(self, now: int) -> list[Moment]:
        """Set the time of /clock in nanoseconds; start over if it was set back."""
        follows = self._follows_clock()
        before, self._clock = self._clock, now
        if not follows:
            return []
        if now < before:
            return self._change_clock(now)
        if self._steps_back.runs and now > self._steps_back.front + MARGIN:
            self._steps_back.take_for_late(self._elapsed)
            return self._due()
        return []

    def flush(self) -> list[Moment]:
        """Return all waiting messages, because nothing more is due."""
        moments = []
        is_set_back = self._steps_back.is_time_set_back(self._elapsed, is_over=True)
        if is_set_back and not self._follows_clock():
            moments = self._change_clock(None)
        self._steps_back.take_for_late(self._elapsed)
        return moments + self._until(max(newest_times(self._topics).values(), default=-1) + 1)

    def pass_by(self, time: int) -> None:
        """Count messages up to this time as late from now on."""
        self._passed = max(self._passed or 0, time + 1)

    def _follows_clock(self) -> bool:
        """Return whether the stamps are those of /clock, which then tells when it is set."""
        newest = newest_times(self._topics).values()
        return bool(newest) and self._clock is not None and abs(max(newest) - self._clock) <= JUMP

    def _accept(self, message: Message) -> bool:
        """Queue a message; return False, and count it, if it is too late."""
        if message.stamp > max(leaders(self._topics).values(), default=message.stamp - 1):
            self._raised = message.sequence
        self._topics[message.topic].note(message.stamp, message.is_stamped)
        if self._passed is not None and message.stamp < self._passed:
            self.late[message.topic] += 1
            return False
        heapq.heappush(self._waiting, message)
        return True

    def _reference(self, default: int | None = None) -> int | None:
        """Return the newest time that is known to have been reached."""
        return max(
            (
                t.newest - (0 if t.is_stamped else BEHIND)
                for t in self._topics.values()
                if t.newest is not None
            ),
            default=default,
        )

    def _due(self) -> list[Moment]:
        """Return the moments that need not wait any longer; none while in doubt."""
        if len(self._waiting) > MAX_WAITING:
            self._steps_back.take_for_late(self._elapsed)
        if self._steps_back.runs:
            return []
        reference = self._reference()
        if self._is_recorded:
            limit = reference - JUMP
        else:
            limit = min(
                max(0 if t.is_disordered else t.newest or 0, reference - t.wait)
                for t in self._topics.values()
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
        runs, front_sequence = self._steps_back.runs, self._steps_back.front_sequence
        time = max(run.last for run in runs.values()) if now is None else now
        newest = newest_times(self._topics)
        newest |= {t: run.left for t, run in runs.items() if run.left is not None}
        end = max(newest.values(), default=self._begun_at)

        def is_after(message: Message) -> bool:
            distance = abs(message.stamp - time)
            return distance <= JUMP and distance < abs(message.stamp - end)

        far = [r for r in self._far.values() if is_after(r.suspects[-1].message)]
        suspects = [
            suspect
            for run in (*far, *runs.values())
            for suspect in run.suspects
            if is_after(suspect.message) or (now is None and run not in far)
        ]
        # Time was set more than once before that could be told.
        lost = {
            s.message.sequence
            for run in (runs.values() if now is None else ())
            for s in run.earlier
            if s.counted is None
        }
        self.late.update(m.topic for m in self._waiting if m.sequence in lost)
        self._waiting = [m for m in self._waiting if m.sequence not in lost]
        # A topic that has sent little does not step back, but it comes after the newest, too.
        first = min((s.message.sequence for s in suspects), default=self._sequence + 1)
        if now is None:
            first = front_sequence
        after = {m.sequence: m for m in self._waiting if m.sequence >= first and is_after(m)}
        for message, _, counted in suspects:
            after[message.sequence] = message
            if counted is not None:
                counted[message.topic] -= 1
        self._waiting = [m for m in self._waiting if m.sequence not in after]
        heapq.heapify(self._waiting)
        moments = self._until(end + 1)
        self._begin(time)
        self._end_before = end
        for _, message in sorted(after.items()):
            self._accept(message)
        return [*moments, CLOCK_SET, *(self._due() if after else [])]

    def _is_left_over(self, message: Message, newest: int | None) -> bool:
        """Return whether a message was in transit while the clock was set."""
        is_first = self._topics[message.topic].newest is None
        if self._end_before is None or not is_first or not message.is_stamped:
            return False
        age = self._end_before - message.stamp
        ahead = message.stamp - max(newest, self._begun_at)
        is_soon = newest - self._begun_at <= PATIENCE
        return is_soon and -SECOND <= age <= JUMP and ahead > MARGIN and abs(age) < ahead


def _far(stamp: int, newest: int, is_received: bool, remedy: str) -> str:
    what = 'it has no stamp, and its receive time' if is_received else 'its stamp'
    far = f'{stamp / SECOND:.3f} s, is far from the other topics, at {newest / SECOND:.3f} s'
    return f'{what}, {far}: {remedy}'
