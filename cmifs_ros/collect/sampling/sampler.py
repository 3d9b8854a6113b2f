# SPDX-License-Identifier: Apache-2.0

"""From a robot's messages to steps: states, actions and rewards in event time.

The same class serves live messages and bags. It uses others for the order of events, the steps and
the ends of episodes, the newest values and the missing ones.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter

from cmifs_ros.collect.episodes.end_counts import EndCounts
from cmifs_ros.collect.episodes.episode_check import Condition
from cmifs_ros.collect.robot_file.expression import Expression
from cmifs_ros.collect.robot_file.model import ACTION, CHANNEL, OWN_VALUES, RobotFile

from .episode_ends import EpisodeEnds
from .event_order import EventOrder
from .held_values import HeldValues
from .message_reader import MessageReader
from .missing_values import MissingValues
from .moments import CLOCK_SET, SECOND, Moment
from .open_episode import Beginning, OpenEpisode
from .saving import Saving
from .step import Step
from .taken_actions import TakenActions

#: After this silence a waiting step, or one at which the episode ends, is made.
QUIET = 2 * SECOND
_OWN = dict.fromkeys(OWN_VALUES, 0.0)


class Sampler:
    """Make steps from messages.

    Parameters
    ----------
    robot : RobotFile
    max_lateness : float or None
        Longest wait for a topic in seconds; None: the messages are recorded. See `EventOrder`.

    Attributes
    ----------
    received, late, wrong : collections.Counter
        Messages by topic: all; too late for their step; without the field or with a far stamp.
    unclear : collections.Counter
        By topic, steps back in time that may be resets. See `EventOrder`.
    last_wrong : dict of str to str
        By topic, the problem of the newest wrong message.
    missing : MissingValues
        Counts of what steps lack.
    ends : EndCounts
        Counts of how episodes ended, and which were lost.
    num_moments : int
        Steps due, whether or not they were complete.
    num_steps : int
        Steps made.
    num_between : int
        Steps due between episodes, while the end condition of the last one still held.
    saving : Saving
        Which topics are switched off.
    away : dict of str to float
        Topics that are switched off, or have not been heard since; with the time from which on one
        counts again, if known. Episodes that begin without one are not used for learning: no steps
        are made.

    """

    def __init__(self, robot: RobotFile, max_lateness: float | None = 5.0):
        self._robot = robot
        self._reader = MessageReader(robot)
        self._period = int(SECOND / robot.rate) if robot.rate else None
        self._order = EventOrder(robot.topics, max_lateness)
        self.late, self.wrong = self._order.late, self._order.wrong
        self.unclear, self.last_wrong = self._order.unclear, self._order.last_wrong
        self.received: Counter[str] = Counter()
        self.missing = MissingValues(robot.sources, self.received, self.late)
        self.saving = Saving(robot)
        self.away: dict[str, float] = {}
        self.ends = EndCounts()
        self._end = EpisodeEnds(robot)
        self.num_moments = 0
        self.num_steps = 0
        self.num_between = 0
        self._episode = 0
        self._held = HeldValues(s for s in robot.sources if s.role != ACTION)
        self._actions = TakenActions(s for s in robot.sources if s.role == ACTION)
        self._begin_anew()

    def _begin_anew(self) -> None:
        """Forget everything except latched values, because the clock was set."""
        self._held.begin_anew()
        self._actions.begin_anew()
        self.missing.forget_times()
        self.away = dict.fromkeys(self.away, math.inf)
        self._end.begin_anew()
        self._last_time: int | None = None  # Of the newest processed message.
        self._news: set[str] = set()  # Topics with a message processed since the last step.
        self._next_tick: int | None = None
        names = {name for source in self._robot.sources for name in (source.name, *source.names)}
        # The values at the previous step.
        self._before = dict.fromkeys(names | OWN_VALUES, math.nan)
        self._begin_episode()

    def _begin_episode(self) -> None:
        self._left: Beginning | None = None  # Of the current step.
        self._open = OpenEpisode(self._episode, not self.away, self._end, self.ends, self.missing)
        self._begin_step()

    def _begin_step(self) -> None:
        self._sum = 0.0
        self._has_reward = False

    @property
    def end_looks(self) -> dict[Condition, Counter[bool | None]]:
        """How often the conditions that end episodes were true, false and unknown (None)."""
        return self._end.looks

    def add(self, topic: str, message, received: int) -> list[Step]:
        """Add a message; return the steps that are complete now.

        Parameters
        ----------
        topic : str
            A topic of the robot file.
        message : object
            Has the attributes of the message type; it is not kept.
        received : int
            Receive or recording time in nanoseconds, used if it has no stamp.

        """
        self.received[topic] += 1
        stamp, content, problem = self._reader.content_of(topic, message)
        if problem:
            self.note_wrong(topic, problem)
        if content is None:
            return []
        time = received if stamp is None else stamp
        if self.away.get(topic) == math.inf and topic not in self.saving.off:
            self.away[topic] = time
        return self._work(self._order.add(topic, stamp, received, content))

    def set_clock(self, now: int) -> list[Step]:
        """Set the time of /clock in nanoseconds; return the steps before a reset, if any."""
        return self._work(self._order.set_clock(now))

    def flush(self) -> list[Step]:
        """Process all waiting messages, because nothing more is due; the episode stays open."""
        steps = self._work(self._order.flush())
        steps += self._settle()
        if self._last_time is not None:
            self._order.pass_by(self._last_time)
        return steps

    def wait_for(self, topic: str) -> float:
        """Return the current wait for a topic, in seconds."""
        return self._order.wait_for(topic)

    def note_wrong(self, topic: str, what: str) -> None:
        """Count an unusable message."""
        self._order.note_wrong(topic, what)

    def _work(self, moments: list[Moment]) -> list[Step]:
        steps: list[Step] = []
        for moment in moments:
            if moment is CLOCK_SET:
                steps += self._settle()
                self._episode += 1
                self._begin_anew()
            else:
                steps += self._take(moment)
        return steps

    def _take(self, moment: Moment) -> list[Step]:
        steps = []
        time = moment.time
        if self._last_time is not None and time - self._last_time > QUIET:
            steps += self._settle()
        steps += self._tick(time)
        for message in moment.messages:
            content = message.content
            self._news.add(message.topic)
            self.missing.heard(message.topic, time, content.values)
            if self.away.get(message.topic, math.inf) <= time:
                del self.away[message.topic]
            self._held.hear(time, content.values)
            self._actions.hear(time, content.values)
            if content.reward is not None:
                self._sum += content.reward
                self._has_reward = True
            for end, is_so in content.ends.items():
                self._end.follow(end, is_so)
            self._end.follow_goals(content.goals)
        self._last_time = time
        if any(message.topic == self._robot.step_topic for message in moment.messages):
            steps += self._make_step(time)
        return steps

    def _tick(self, time: int) -> list[Step]:
        """Make the steps of a fixed rate before a time."""
        if self._period is None:
            return []
        steps = []
        if self._next_tick is None:
            self._next_tick = -(-time // self._period) * self._period
        while self._next_tick < time:
            steps += self._make_step(self._next_tick)
            self._next_tick += self._period
        return steps

    def _settle(self) -> list[Step]:
        """Make the step that is due after silence: the next tick, or that of an end."""
        if self._left is None or not self._news:
            return []
        if self._period is not None:
            self._last_time = self._next_tick
            return self._tick(self._next_tick + 1)
        self._actions.pass_on()
        # At the time of the previous step: that of a message without a stamp is not exact.
        time = self._left.time
        is_due = self._end.is_due(self._peek(time), self._before)
        return self._make_step(time) if is_due else []

    def _make_step(self, time: int) -> list[Step]:
        """Reach a step, which completes the transition from the previous one."""
        self._news.clear()
        reached, values = self._look(time)
        left, before = self._left, self._before
        action = self._actions.of_step(left.time if left else time, time)
        if left is None:
            self._before = values | _OWN
            self._begin(reached, before)
            return []
        self._open.step += 1
        if action.lacking:
            for source, cause in action.lacking.items():
                self.missing.counts[source.name, cause] += 1
            left = left._replace(state=None, lacking=(*left.lacking, *action.lacking))
        else:
            values |= zip(self._robot.action_names, action.values, strict=True)
        values |= {'step': float(self._open.step)} | self._end.goal_ends
        has_ended = self._end.look(values, before, is_open=True)
        reward = self._reward(values, before)
        steps = self._open.advance(left, action.values, reached, reward, has_ended)
        self.num_steps += len(steps)
        if has_ended:
            self.saving.end_episode(self._open.is_whole)
            self.away |= dict.fromkeys(self.saving.off, math.inf)
            self._episode += 1
            self._before = values | _OWN
            self._end.forget_events()
            self._begin_episode()
        else:
            self._before = values
            self._left = reached
            self._begin_step()
        return steps

    def _begin(self, reached: Beginning, before: dict) -> None:
        """Begin an episode, unless an end condition holds."""
        is_over = self._end.look(self._before, before, is_open=False)
        self._end.forget_events()
        self._begin_episode()
        # None begins before every channel has a value.
        if self._end.may_begin and (reached.state is not None or self.num_steps):
            if is_over:
                self.num_between += 1
            else:
                self._left = reached

    def _look(self, time: int) -> tuple[Beginning, dict[str, float]]:
        """Return the state at a time, and all values by name."""
        self.num_moments += 1
        state, lacking = array('d'), []
        values = dict.fromkeys(self._robot.action_names, math.nan)
        for source in self._held.sources:
            held, cause = self._held.of(source, time)
            if cause is not None:
                if source.path.topic not in self.away:
                    self.missing.counts[source.name, cause] += 1
                values |= dict.fromkeys((source.name, *source.names), math.nan)
                if source.role == CHANNEL:
                    lacking.append(source)
                continue
            if source.role == CHANNEL:
                state.extend(held)
            values |= zip(source.names, held, strict=True)
        return Beginning(time, None if lacking else state, tuple(lacking)), values

    def _peek(self, time: int) -> dict[str, float]:
        """Return all values by name that the next step would have, if it were at a time."""
        values = self._before | {'step': self._open.step + 1.0}
        for held in (self._held, self._actions.held):
            for source in held.sources:
                if source.path.topic not in self._news:
                    continue
                newest, cause = held.peek(source, time)
                if cause is not None:
                    newest = [math.nan] * len(source.names)
                values |= zip(source.names, newest, strict=True)
        return values

    def _reward(self, values: dict, before: dict) -> float:
        if isinstance(self._robot.reward, Expression):
            return self._robot.reward(values, before)
        return self._sum if self._has_reward else 0.0
