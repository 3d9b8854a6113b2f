"""From a robot's messages to steps: states and rewards in event time.

The same class for live messages and for those of a bag. Messages wait until every topic has
passed their time or `lateness` is over, and those of one topic are taken in the order of their
stamps alone, so that nothing depends on which topic's message arrives first.
"""

from __future__ import annotations

import heapq
import math
from array import array
from collections import Counter, deque
from collections.abc import Mapping
from typing import NamedTuple

from cmifs_ros.collect.episodes.pairing import RewardSample
from cmifs_ros.collect.robot_file.expression import Expression
from cmifs_ros.collect.robot_file.field_path import FieldPath, MissingFieldError
from cmifs_ros.collect.robot_file.model import (
    OWN_VALUES,
    STATUS,
    RobotFile,
    Source,
    UnlistedKindError,
)
from cmifs_ros.core.words import counted, listed

SECOND = 1_000_000_000
#: A message this far from the others is wrong; if its topic and others go on so, the clock was set.
JUMP = 60 * SECOND
#: For so long a topic that has another time waits for others to join it, or to go on without it.
PATIENCE = 5 * SECOND
MAX_WAITING = 100_000
MAX_SUSPECTS = 1000
#: A time of receipt runs ahead of the stamps if who receives is behind: it counts so much less.
BEHIND = 2 * SECOND
_UNREADABLE = (
    MissingFieldError, TypeError, ValueError, AttributeError, LookupError, ArithmeticError,
)  # fmt: skip
_OWN = dict.fromkeys(OWN_VALUES, 0.0)
_ENDS = ('terminated', 'truncated')
_EXECUTING = (1, 2, 3)
#: Why a step lacks a value.
_NEVER, _OLD = 'no message', 'silent'
_NAN, _INFINITE, _NO_VALUE = 'it is NaN', 'it is infinite', 'it has no value'
_UNLISTED = 'it is of a kind that its one_hot does not list'
_ENDED = {4: 'succeeded', 5: 'canceled', 6: 'aborted'}


class Step(NamedTuple):
    """One step: nanoseconds, values in the order of `RobotFile.channel_names`, and its reward."""

    stamp: int
    state: array
    sample: RewardSample


def event_time(message) -> int | None:
    """Return its header's stamp in nanoseconds; None if there is none, or it is 0."""
    stamp = getattr(getattr(message, 'header', None), 'stamp', None)
    return None if stamp is None else (stamp.sec * SECOND + stamp.nanosec or None)


class _Suspects:
    """A topic's newest messages, if all are far from the others', but not from one another."""

    def __init__(self, is_stamped: bool, stamp: int, newest: Mapping[str, int]):
        self.is_stamped = is_stamped
        self.messages: deque[tuple[int, dict]] = deque(maxlen=MAX_SUSPECTS)
        self.since, self.newest_then = stamp, dict(newest)

    @property
    def stamp(self) -> int:
        """The newest one's."""
        return self.messages[-1][0]


class Sampler:
    """Make steps of messages.

    Parameters
    ----------
    robot : RobotFile
    lateness : float, optional
        For how long, in seconds of event time, a message waits for those of silent topics; two
        seconds longer by the time of what has no stamp.

    Attributes
    ----------
    received, late, wrong : collections.Counter
        Messages by topic: taken; older than one of the topic before, or too late for the others;
        without the field or with a far stamp.
    missing : collections.Counter
        Steps that lack a channel or value, by its name and why; see `lacking`.
    num_moments : int
        Moments at which the file wants a step, whether or not all was there.
    num_steps : int
        Steps made.
    num_between : int
        Moments at which no episode could begin, as what had ended the one before still held.
    last_wrong : dict of str to str
        By topic, what was wrong with the newest such message.

    """

    def __init__(self, robot: RobotFile, lateness: float = 0.5):
        self._robot = robot
        self._lateness = int(lateness * SECOND)
        self._by_topic: dict[str, list[Source]] = {topic: [] for topic in robot.topics}
        for source in robot.sources:
            self._by_topic[source.path.topic].append(source)
        self._period = int(SECOND / robot.rate) if robot.rate else None
        self.received: Counter[str] = Counter()
        self.late: Counter[str] = Counter()
        self.wrong: Counter[str] = Counter()
        self.missing: Counter[tuple[str, str]] = Counter()
        self.last_wrong: dict[str, str] = {}
        self.num_moments = 0
        self.num_steps = 0
        self.num_between = 0
        self._sequence = 0
        self._episode = 0
        self._unstamped: set[str] = set()
        self._rank = {topic: rank for rank, topic in enumerate(robot.topics)}
        self._set_clock()

    def _set_clock(self) -> None:
        """Begin anew: nothing is known of a clock that was set."""
        self._waiting: list = []
        self._newest: dict[str, int] = {}
        self._spoken: dict[str, tuple[int, int]] = {}  # By topic, its first stamp; how many came.
        self._passed: int | None = None  # All before this time has been worked through.
        self._suspects: dict[str, _Suspects] = {}
        self._held: dict[str, tuple[int, list[float]]] = {}
        self._next_tick: int | None = None
        self._goal: bytes | None = None
        names = {name for source in self._robot.sources for name in (source.name, *source.names)}
        self._before = dict.fromkeys(names | OWN_VALUES, math.nan)  # The values one moment ago.
        self._holds = dict.fromkeys(_ENDS, False)  # Whether an end was so when last known.
        self._has_been_zero: set[str] = set()
        self._begin_episode()

    def _begin_episode(self) -> None:
        self._left: tuple[int, array | None] | None = None
        self._step = 0
        self._sum = 0.0
        self._has_reward = False
        self._events = dict.fromkeys((*_ENDS, *_ENDED.values()), False)

    def add(self, topic: str, message, received: int) -> list[Step]:
        """Take a message; return the steps that are complete now.

        Parameters
        ----------
        topic : str
            One of the robot file's.
        message : object
            With the message's attributes; not kept after its values were read.
        received : int
            When it was received or recorded, in nanoseconds: its time if it has no stamp.

        """
        self.received[topic] += 1
        steps = []
        try:
            own = event_time(message)
        except _UNREADABLE as error:
            self.note_wrong(topic, f'its stamp: {error}')
            return []
        stamp = received if own is None else own
        content = self._read(topic, message)
        newest = max(self._newest.values(), default=None)
        if newest is None or abs(stamp - newest) <= JUMP:
            self._suspects.pop(topic, None)
        else:
            suspects = self._suspects.get(topic)
            if suspects is None or abs(stamp - suspects.stamp) > JUMP:
                suspects = self._suspects[topic] = _Suspects(own is not None, stamp, self._newest)
            suspects.messages.append((stamp, content))
            # When a message was received tells nothing of a clock by which others are stamped.
            is_led = own is None and self._newest.keys() - self._unstamped
            if is_led or not self._is_clock_set(suspects):
                self.note_wrong(topic, _far(stamp, newest, own is None))
                return []
            suspects.messages.pop()
            steps = self._change_clock(stamp)
        if stamp < max(self._passed or 0, self._newest.get(topic, 0)):
            self.late[topic] += 1
            return steps
        self._wait(topic, stamp, content)
        (self._unstamped.add if own is None else self._unstamped.discard)(topic)
        limit = max(
            time - self._lateness - (BEHIND if topic in self._unstamped else 0)
            for topic, time in self._newest.items()
        )
        if len(self._newest) == len(self._by_topic):
            limit = max(limit, min(self._newest.values()))
        if len(self._waiting) > MAX_WAITING:
            limit = max(limit, self._waiting[0][0] + 1)
        return steps + self._work(limit)

    def _wait(self, topic: str, stamp: int, content: dict) -> None:
        self._sequence += 1
        heapq.heappush(self._waiting, (stamp, self._rank[topic], self._sequence, topic, content))
        self._newest[topic] = stamp
        first, count = self._spoken.get(topic, (stamp, 0))
        self._spoken[topic] = (first, count + 1)

    def _is_clock_set(self, suspects: _Suspects) -> bool:
        """Whether more topics have the time of these suspects than may go on with the old one."""
        joined = {
            topic: other
            for topic, other in self._suspects.items()
            if other.is_stamped == suspects.is_stamped and abs(other.stamp - suspects.stamp) <= JUMP
        }
        if max(len(other.messages) for other in joined.values()) == 1:
            return False
        rest = self._newest.keys() - self._unstamped - joined.keys()
        if suspects.stamp - suspects.since >= PATIENCE:
            rest = {t for t in rest if self._newest[t] != suspects.newest_then.get(t)}
            suspects.since, suspects.newest_then = suspects.stamp, dict(self._newest)
        return len(joined) > len(rest)

    def _change_clock(self, stamp: int) -> list[Step]:
        """End what was before a clock was set; what topics said since then counts."""
        steps, suspects = self.flush(), self._suspects
        self._episode += 1
        self._set_clock()
        for topic, others in suspects.items():
            for first, content in others.messages:
                if abs(first - stamp) > JUMP:
                    continue
                self.wrong[topic] -= 1
                if first < self._newest.get(topic, 0):
                    self.late[topic] += 1
                else:
                    self._wait(topic, first, content)
        return steps

    def flush(self) -> list[Step]:
        """Work through all that waits, when nothing more is due; the open episode stays open."""
        return self._work(max(self._newest.values()) + 1) if self._newest else []

    def note_wrong(self, topic: str, what: str) -> None:
        """Count a message that cannot be used."""
        self.wrong[topic] += 1
        self.last_wrong[topic] = what[:300]

    def lacking(self, missing: Mapping[tuple[str, str], int]) -> Counter[str]:
        """Return how many steps lacked something, by what and why in words.

        What one topic lacked equally often has one cause, and is told once: without names if it is
        all that the robot file takes of it.

        Parameters
        ----------
        missing : mapping of tuple to int
            As the attribute, or of some of the steps.

        """
        source_of = {source.name: source for source in self._robot.sources}
        of = {name: (s.path.topic, s.is_channel) for name, s in source_of.items()}
        sizes = Counter(of.values())
        alike: dict[tuple, list[str]] = {}
        for (name, cause), count in missing.items():
            why = self._why(source_of.get(name), cause)
            alike.setdefault((of.get(name, name), count, why), []).append(name)
        words: Counter[str] = Counter()
        for (origin, count, why), names in alike.items():
            what = names[0]
            if len(names) > 1:
                topic, is_channel = origin
                noun = 'channel' if is_channel else 'value'
                what = f'{counted(len(names), noun)} of {topic}'
                what += f' ({listed(names)})' if len(names) < sizes[origin] else ''
            words[f'{what}: {why}'] = count
        return words

    def _why(self, source: Source | None, cause: str) -> str:
        """Return why a step lacked something, by what is known of its messages by now."""
        if cause == _NEVER and source.name in self._held:
            return 'no message yet'
        if cause == _NEVER and self.received[source.path.topic]:
            return 'no message of use'
        if cause == _OLD:
            topic, max_age = source.path.topic, source.max_age
            first, count = self._spoken.get(topic, (0, 0))
            period = (self._newest[topic] - first) / SECOND / (count - 1) if count > 1 else 0.0
            if period > max_age:
                return f'its messages come every {period:.3g} s, max_age is {max_age:g} s'
            return f'silent for more than its max_age, {max_age:g} s'
        return cause

    def _read(self, topic: str, message) -> dict:
        """Return what the message says, so that itself need not be kept."""
        content: dict = {}
        problem: str | None = None
        for source in self._by_topic[topic]:
            try:
                values = source.read(message)
                if values:
                    content[source.name] = values
            except UnlistedKindError as error:
                content[source.name] = [math.nan]  # What it was before, it is no longer.
                problem = str(error)
            except _UNREADABLE as error:
                problem = str(error)
        for key in ('reward', *_ENDS):
            rule = getattr(self._robot, key)
            if isinstance(rule, FieldPath) and rule.topic == topic:
                try:
                    content[key, 'rule'] = sum(rule.numbers(message)) if rule.fields else 1.0
                except _UNREADABLE as error:
                    problem = str(error)
        if self._robot.action and topic == self._robot.action + STATUS:
            try:
                content['goals',] = [
                    (bytes(map(int, entry.goal_info.goal_id.uuid)), int(entry.status))
                    for entry in FieldPath(topic, ('status_list',)).read(message)[0]
                ]
            except _UNREADABLE as error:
                problem = str(error)
        if problem is not None:  # However many fields it concerns, it is one message.
            self.note_wrong(topic, problem)
        return content

    def _work(self, limit: int) -> list[Step]:
        """Work through what is before a time, in groups of equal time."""
        steps = []
        while self._waiting and self._waiting[0][0] < limit:
            time = self._waiting[0][0]
            steps += self._tick(time)
            is_step = False
            while self._waiting and self._waiting[0][0] == time:
                _, _, _, topic, content = heapq.heappop(self._waiting)
                is_step |= topic == self._robot.step_topic
                self._take(time, content)
            if is_step:
                steps += self._make_step(time)
        if self._passed is None or limit > self._passed:
            self._passed = limit
        return steps

    def _tick(self, time: int) -> list[Step]:
        """Make the steps of a fixed rate that lie before a time."""
        if self._period is None:
            return []
        steps = []
        if self._next_tick is None:
            self._next_tick = -(-time // self._period) * self._period
        while self._next_tick < time:
            steps += self._make_step(self._next_tick)
            self._next_tick += self._period
        return steps

    def _take(self, time: int, content: dict) -> None:
        for key, value in content.items():
            if key == ('reward', 'rule'):
                self._sum += value
                self._has_reward = True
            elif key == ('goals',):
                self._follow_goals(value)
            elif isinstance(key, tuple):
                self._follow_end(key[0], bool(value))
            else:
                self._held[key] = (time, value)

    def _follow_end(self, end: str, is_so: bool) -> None:
        """Note what a path says of an end: one that never says no tells of moments."""
        self._events[end] |= is_so
        if not is_so:
            self._has_been_zero.add(end)
        self._holds[end] = is_so and end in self._has_been_zero

    def _follow_goals(self, goals: list[tuple[bytes, int]]) -> None:
        for goal, status in goals:
            if goal == self._goal and status in _ENDED:
                self._events[_ENDED[status]] = True
                self._events['truncated' if status == 5 else 'terminated'] = True
                self._goal = None
        running = [goal for goal, status in goals if status in _EXECUTING]
        if running and self._goal not in running:
            self._events['truncated'] |= self._goal is not None
            self._goal = running[-1]

    def _make_step(self, time: int) -> list[Step]:
        """Reach a step: the transition from the one before is complete."""
        state, values = self._state(time)
        left, before = self._left, self._before
        if left is None:
            self._before = values | _OWN
            self._begin(time, state, before)
            return []
        self._step += 1
        values |= {'step': float(self._step)}
        values |= {name: float(self._events[name]) for name in _ENDED.values()}
        terminated = self._ends('terminated', values, before)
        truncated = self._ends('truncated', values, before) or self._step == self._robot.steps
        reward = self._reward(values, before)
        steps = []
        if left[1] is not None and math.isfinite(reward):
            sample = RewardSample(
                reward, terminated, truncated and not terminated, self._episode, self._step - 1
            )
            steps.append(Step(left[0], left[1], sample))
            self.num_steps += 1
        elif left[1] is not None:
            self.missing['reward', _NO_VALUE] += 1
        if terminated or truncated:
            self._episode += 1
            self._before = values | _OWN
            self._begin_episode()
        else:
            self._before = values
            self._left = (time, state)
            self._sum = 0.0
            self._has_reward = False
        return steps

    def _begin(self, time: int, state: array | None, before: dict) -> None:
        """Begin an episode, unless what ends one holds already."""
        is_over = [self._ends(end, self._before, before, is_open=False) for end in _ENDS]
        self._begin_episode()
        # Outside an action's goals, and before every channel has spoken, none begins.
        may_begin = self._robot.action is None or self._goal is not None
        if may_begin and (state is not None or self.num_steps):
            if any(is_over):
                self.num_between += 1
            else:
                self._left = (time, state)

    def _state(self, time: int) -> tuple[array | None, dict[str, float]]:
        """Return the state at a time, None if it lacks a channel, and all values by name."""
        self.num_moments += 1
        state, values, is_whole = array('d'), {}, True
        for source in self._robot.sources:
            since, held = self._held.get(source.name, (None, []))
            why = None
            if since is None:
                why = _NEVER
            elif time - since > source.max_age * SECOND:
                why = _OLD
            elif source.one_hot and math.isnan(held[0]):
                why = _UNLISTED
            elif not all(map(math.isfinite, held)):
                why = _NAN if any(map(math.isnan, held)) else _INFINITE
            if why is not None:
                self.missing[source.name, why] += 1
                is_whole &= not source.is_channel
                values |= dict.fromkeys((source.name, *source.names), math.nan)
                continue
            if source.is_channel:
                state.extend(held)
            values |= zip(source.names, held, strict=True)
        return (state if is_whole else None), values

    def _ends(self, end: str, values: dict, before: dict, is_open: bool = True) -> bool:
        """Tell whether an episode ends here, or if none is open, whether none may begin."""
        rule = getattr(self._robot, end)
        if isinstance(rule, Expression):
            value = rule(values, before)
            if not math.isnan(value):
                self._holds[end] = bool(value)
        # Between episodes a mere event has passed: a message of a topic, or a goal's end.
        may_hold = is_open or (isinstance(rule, FieldPath) and rule.fields)
        return self._holds[end] or (may_hold and self._events[end])

    def _reward(self, values: dict, before: dict) -> float:
        if isinstance(self._robot.reward, Expression):
            return self._robot.reward(values, before)
        return self._sum if self._has_reward else 0.0


def _far(stamp: int, newest: int, is_received: bool) -> str:
    what = f'{stamp / SECOND:.3f} s is far from {newest / SECOND:.3f} s, where the others are'
    if is_received:
        return (
            f'it has no stamp, and when it was received, {what}: if their time is simulated, '
            'set use_sim_time, or record /clock'
        )
    return f'its stamp {what}: set the clock of whoever stamps it'
