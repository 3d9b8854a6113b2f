# SPDX-License-Identifier: Apache-2.0

"""The newest values of the selected channels, for control.

Learning is in event time and waits for late messages (`sampler`); here a message counts as soon as
it is received.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Collection, Iterator, Sequence

from cmifs_ros.collect.robot_file.model import CHANNEL, RobotFile, Source, UnlistedCategoryError

from .held_values import HeldValues
from .message_reader import UNREADABLE
from .missing_values import NEVER, NOT_YET, SILENT, silent_for
from .moments import SECOND

#: Seconds from the first message of any channel in which the first ones of the others are awaited.
_FIRST = 1.0


class NewestValues:
    """Hold the newest values of a robot's channels.

    Times are nanoseconds of one clock of the caller, which may be set back.

    Parameters
    ----------
    robot : RobotFile

    Attributes
    ----------
    names : list of str
        The channels that `state` returns, in order; at first all channels.
    missing : dict of str to str
        By sensor, why the newest `state` has NaN for a selected channel of it, or is None.

    """

    def __init__(self, robot: RobotFile):
        self._held = HeldValues()
        self._sources = [source for source in robot.sources if source.role == CHANNEL]
        self._by_topic: dict[str, list[Source]] = {}
        # For selections to come, the newest message of each topic is kept unread. But where several
        # nodes fill a topic, it may lack the entries that a source selects: these are read at once.
        self._received: dict[str, tuple[int, object]] = {}  # By topic.
        self._selecting = {source.name for source in self._sources if source.path.selects}
        self._entries: dict[str, tuple[int, list[float]]] = {}  # By source of these.
        self._begun: int | None = None  # Time of the first `state` with a message.
        self._is_waiting = True
        self._last = self._set_back = 0
        self.missing: dict[str, str] = {}
        self.select(robot.channel_names, robot.channel_names)

    def select(self, selected: Collection[str], names: Sequence[str]) -> None:
        """Select channels.

        Parameters
        ----------
        selected : collection of str
            Channels of the robot file.
        names : sequence of str
            The channels that `state` returns, in order; NaN for those not selected.

        """
        self.names = list(names)
        place = {name: i for i, name in enumerate(names) if name in selected}
        self._places = [
            (source, [(i, place[name]) for i, name in enumerate(source.names) if name in place])
            for source in self._sources
            if not place.keys().isdisjoint(source.names)
        ]
        self._held.follow(source for source, _ in self._places)
        read = self._selecting | {source.name for source, _ in self._places}
        self._by_topic = {}
        for source in self._sources:
            if source.name in read:
                self._by_topic.setdefault(source.path.topic, []).append(source)
        # A latched message does not come again.
        for topic, (time, message) in self._received.items():
            self._held.hold(time, dict(self._readings(topic, message)))
        for name, (time, values) in self._entries.items():
            self._held.hold(time, {name: values})

    def has(self, channels: Collection[str], time: int) -> bool:
        """Tell whether these channels, selected or not, have messages that are still valid."""
        time = self._never_back(time)
        return all(
            (heard := self._heard(source)) is not None and time - heard <= source.max_age * SECOND
            for source in self._sources
            if not set(channels).isdisjoint(source.names)
        )

    def _heard(self, source: Source) -> int | None:
        """Return the time of the newest message for a source, if there was one."""
        newest: tuple[int, object] | None = self._received.get(source.path.topic)
        if source.name in self._selecting:
            newest = self._entries.get(source.name)
        return newest[0] if newest else None

    def take(self, topic: str, message, time: int) -> None:
        """Take a message."""
        time = self._never_back(time)
        self._received[topic] = time, message
        values = dict(self._readings(topic, message))
        self._held.hear(time, values)
        for name in values.keys() & self._selecting:
            self._entries[name] = time, values[name]

    def _readings(self, topic: str, message) -> Iterator[tuple[str, list[float]]]:
        for source in self._by_topic.get(topic, ()):
            try:
                values = source.readings(message)
            except UnlistedCategoryError:
                values = [math.nan] * len(source.names)
            except UNREADABLE:
                continue
            if values:
                yield source.name, values

    def state(self, time: int) -> array | None:
        """Return the values at a time, NaN if missing or not finite; at first None.

        It is None until each selected channel has had a message, or for a second from the first one
        of any of them. Summaries cover the time since the last call: call this once per step.
        """
        time = self._never_back(time)
        state = array('d', [math.nan]) * len(self.names)
        self.missing = {}
        num_never = 0
        for source, places in self._places:
            values, cause = self._held.of(source, time)
            if cause == NEVER:
                num_never += 1
                self.missing[source.name] = NOT_YET
            elif cause == SILENT:
                self.missing[source.name] = silent_for(source)
            elif cause is not None and source.over:
                self.missing[source.name] = cause
            else:
                self._fill(state, source, places, values)
        if self._is_waiting:
            if self._begun is None and num_never < len(self._places):
                self._begun = time
            is_over = self._begun is not None and time - self._begun > _FIRST * SECOND
            self._is_waiting = num_never > 0 and not is_over
        return None if self._is_waiting else state

    def _fill(self, state: array, source: Source, places, values: Sequence[float]) -> None:
        for i, place in places:
            if math.isfinite(values[i]):
                state[place] = values[i]
            else:
                self.missing[source.name] = f'it is {values[i]}'

    def _never_back(self, time: int) -> int:
        """Return a time that continues where the clock was before it was set back."""
        self._set_back += max(0, self._last - time)
        self._last = time
        return time + self._set_back
