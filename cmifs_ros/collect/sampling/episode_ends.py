# SPDX-License-Identifier: Apache-2.0

"""When episodes end, and when one may begin, according to the robot file."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping

from cmifs_ros.collect.episodes.episode_check import Condition
from cmifs_ros.collect.robot_file.expression import Expression
from cmifs_ros.collect.robot_file.field_path import FieldPath
from cmifs_ros.collect.robot_file.model import RobotFile

ENDS = ('terminated', 'truncated')
_EXECUTING = (1, 2, 3)
_GOAL_ENDS = {4: 'succeeded', 5: 'canceled', 6: 'aborted'}


class EpisodeEnds:
    """Follow the end conditions: expressions, topics, and the goals of an action.

    Attributes
    ----------
    terminated, truncated : bool
        The result of `look`.
    looks : dict of Condition to collections.Counter
        How often each condition was true, false and unknown (None).

    """

    def __init__(self, robot: RobotFile):
        self._robot = robot
        self.terminated = self.truncated = False
        self._conditions = {
            end: Condition(f'{end}: {rule}', isinstance(rule, FieldPath))
            for end in ENDS
            if (rule := getattr(robot, end)) is not None
        }
        self.looks: dict[Condition, Counter[bool | None]] = {
            condition: Counter() for condition in self._conditions.values()
        }
        self._kind = ''
        self.begin_anew()

    def begin_anew(self) -> None:
        """Forget everything, because the clock was set."""
        self._goal: bytes | None = None
        # By end, whether its condition held when last known.
        self._holds = dict.fromkeys(ENDS, False)
        self._has_been_zero: set[str] = set()
        self.forget_events()

    def forget_events(self) -> None:
        """Forget momentary events, when an episode begins."""
        self._events = dict.fromkeys((*ENDS, *_GOAL_ENDS.values()), False)

    @property
    def may_begin(self) -> bool:
        """Whether an episode may begin; with an action, only during a goal."""
        return self._robot.action is None or self._goal is not None

    def is_due(self, values: Mapping, before: Mapping) -> bool:
        """Return whether a message since the last step has announced an end, or made it true.

        A condition that would be true without any message, such as of a number of steps, does not
        count: it needs its step.

        Parameters
        ----------
        values, before : mapping of str to float
            Values by now and at the last step, including `step`.

        """
        silent = {**before, 'step': values['step']}
        rules = [getattr(self._robot, end) for end in ENDS]
        return any(self._events.values()) or any(
            _is_true(rule(values, before)) and not _is_true(rule(silent, before))
            for rule in rules
            if isinstance(rule, Expression)
        )

    @property
    def goal_ends(self) -> dict[str, float]:
        """How the goal ended, as values for expressions."""
        return {name: float(self._events[name]) for name in _GOAL_ENDS.values()}

    @property
    def kind(self) -> str:
        """The end that `look` found: its key in the robot file, or the result of the goal."""
        of_goal = [name for name in _GOAL_ENDS.values() if self._events[name]]
        return of_goal[0] if of_goal else self._kind

    def follow(self, end: str, is_so: bool) -> None:
        """Note the value of an end's field; a field that has never been 0 announces moments."""
        self._events[end] |= is_so
        self.looks[self._conditions[end]][is_so] += 1
        if not is_so:
            self._has_been_zero.add(end)
        self._holds[end] = is_so and end in self._has_been_zero

    def follow_goals(self, goals: Iterable[tuple[bytes, int]]) -> None:
        """Note the ids and statuses of an action's goals."""
        for goal, status in goals:
            if goal == self._goal and status in _GOAL_ENDS:
                self._events[_GOAL_ENDS[status]] = True
                self._events['truncated' if status == 5 else 'terminated'] = True
                self._goal = None
        running = [goal for goal, status in goals if status in _EXECUTING]
        if running and self._goal not in running:
            self._events['truncated'] |= self._goal is not None
            self._goal = running[-1]

    def look(self, values: Mapping, before: Mapping, *, is_open: bool) -> bool:
        """Return whether an episode ends here; between episodes, whether none may begin.

        Parameters
        ----------
        values, before : mapping of str to float
            Values at this step and at the previous one, including `step`.
        is_open : bool

        """
        self.terminated = self._is_so('terminated', values, before, is_open)
        self.truncated = self._is_so('truncated', values, before, is_open)
        is_full = is_open and values['step'] == self._robot.steps
        self._kind = 'terminated' if self.terminated else 'truncated' if self.truncated else 'steps'
        self.truncated = not self.terminated and (self.truncated or is_full)
        return self.terminated or self.truncated

    def _is_so(self, end: str, values: Mapping, before: Mapping, is_open: bool) -> bool:
        rule = getattr(self._robot, end)
        if isinstance(rule, Expression):
            value = rule(values, before)
            is_known = not math.isnan(value)
            self.looks[self._conditions[end]][bool(value) if is_known else None] += 1
            if is_known:
                self._holds[end] = bool(value)
        # Between episodes, momentary events are over: a message of a topic, the end of a goal.
        may_hold = is_open or (isinstance(rule, FieldPath) and bool(rule.fields))
        return self._holds[end] or (may_hold and self._events[end])


def _is_true(value: float) -> bool:
    return bool(value) and not math.isnan(value)
