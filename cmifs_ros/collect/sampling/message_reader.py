# SPDX-License-Identifier: Apache-2.0

"""Extract what the robot file uses of a message, which need not be kept."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from cmifs_ros.collect.robot_file.field_path import FieldPath, MissingFieldError
from cmifs_ros.collect.robot_file.model import STATUS, RobotFile, Source, UnlistedCategoryError

from .episode_ends import ENDS
from .moments import SECOND

UNREADABLE = (
    MissingFieldError, TypeError, ValueError, AttributeError, LookupError, ArithmeticError,
)  # fmt: skip


@dataclass
class Content:
    """The contents of a message that the robot file uses.

    Attributes
    ----------
    values : dict of str to list of float
        By source.
    reward : float or None
    ends : dict of str to bool
        Values of fields for terminated and truncated.
    goals : list of (bytes, int)
        Ids and statuses of an action's goals.

    """

    values: dict[str, list[float]] = field(default_factory=dict)
    reward: float | None = None
    ends: dict[str, bool] = field(default_factory=dict)
    goals: list[tuple[bytes, int]] = field(default_factory=list)


def event_time(message) -> int | None:
    """Return the header stamp in nanoseconds; None if it is missing or 0."""
    stamp = getattr(getattr(message, 'header', None), 'stamp', None)
    return None if stamp is None else (stamp.sec * SECOND + stamp.nanosec or None)


class MessageReader:
    """Read messages of any type according to a robot file."""

    def __init__(self, robot: RobotFile):
        self._status_topic = robot.action + STATUS if robot.action else None
        rules = {key: getattr(robot, key) for key in ('reward', *ENDS)}
        self._rules = {
            topic: [
                (key, rule)
                for key, rule in rules.items()
                if isinstance(rule, FieldPath) and rule.topic == topic
            ]
            for topic in robot.topics
        }
        self._by_topic: dict[str, list[Source]] = {topic: [] for topic in robot.topics}
        for source in robot.sources:
            self._by_topic[source.path.topic].append(source)

    def content_of(self, topic: str, message) -> tuple[int | None, Content | None, str]:
        """Return the stamp if any, the content if usable, and what is wrong with the message.

        If several fields are wrong, the last problem is returned.
        """
        content, problem = Content(), ''
        try:
            stamp = event_time(message)
        except UNREADABLE as error:
            return None, None, f'its stamp: {error}'
        for source in self._by_topic[topic]:
            try:
                values = source.readings(message)
                if values:
                    content.values[source.name] = values
            except UnlistedCategoryError as error:
                content.values[source.name] = [math.nan]  # The previous category no longer holds.
                problem = str(error)
            except UNREADABLE as error:
                problem = str(error)
        for key, rule in self._rules[topic]:
            try:
                said = sum(rule.numbers_in(message)) if rule.fields else 1.0
            except UNREADABLE as error:
                problem = str(error)
                continue
            if key == 'reward':
                content.reward = said
            else:
                content.ends[key] = bool(said)
        if topic == self._status_topic:
            try:
                content.goals = _goals_of(topic, message)
            except UNREADABLE as error:
                problem = str(error)
        return stamp, content, problem


def _goals_of(topic: str, message) -> list[tuple[bytes, int]]:
    (entries,) = FieldPath(topic, ('status_list',)).values_in(message)
    return [(bytes(map(int, e.goal_info.goal_id.uuid)), int(e.status)) for e in entries]
