# SPDX-License-Identifier: Apache-2.0

"""The newest values of the selected channels, whatever the others do: for control, at once.

Learning is by event time and waits (`sampler`); here a message counts as soon as it is received.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Collection, Iterator, Sequence

from cmifs_ros.collect.robot_file.model import CHANNEL, RobotFile, Source, UnlistedKindError

from .event_order import SECOND
from .message_reader import UNREADABLE
from .summaries import Summary

#: Seconds for which a channel of any `max_age` may take to speak for the first time.
_FIRST = 1.0


class NewestValues:
    """Hold the newest values of a robot's channels.

    Times are nanoseconds of one clock of the caller's, which may be set back.

    Parameters
    ----------
    robot : RobotFile

    Attributes
    ----------
    names : list of str
        What `state` returns, in order; at first all channels.
    gone : dict of str to str
        Why the newest `state` has NaN for a selected sensor, by its name. One that has not spoken
        yet is given a second.

    """

    def __init__(self, robot: RobotFile):
        self._robot = robot
        self._by_topic: dict[str, list[Source]] = {}
        self._received: dict[str, tuple[int, object]] = {}  # By topic, its newest message.
        self._held: dict[str, tuple[int, list[float]]] = {}  # By source, its newest values.
        self._summaries: dict[str, Summary] = {}  # By source, since the newest `state`.
        self._since: int | None = None  # When it was first asked.
        self._last = 0
        self.gone: dict[str, str] = {}
        self.select(robot.channel_names, robot.channel_names)

    def select(self, selected: Collection[str], names: Sequence[str]) -> None:
        """Select channels.

        Parameters
        ----------
        selected : collection of str
            Channels of the robot file.
        names : sequence of str
            What `state` is to return, in order; NaN for one that is not selected.

        """
        self.names = list(names)
        place = {name: i for i, name in enumerate(names) if name in selected}
        self._places = [
            (source, [(i, place[name]) for i, name in enumerate(source.names) if name in place])
            for source in self._robot.sources
            if source.role == CHANNEL and not place.keys().isdisjoint(source.names)
        ]
        self._by_topic = {}
        for source, _ in self._places:
            self._by_topic.setdefault(source.path.topic, []).append(source)
        self._summaries = {
            source.name: self._summaries.get(source.name) or Summary(source)
            for source, _ in self._places
            if source.over
        }
        # What is latched does not come again.
        for topic, (time, message) in self._received.items():
            for source, values in self._readings(topic, message):
                self._held[source.name] = time, values

    def take(self, topic: str, message, time: int) -> None:
        """Take a message, of which the values of the selected channels count."""
        self._received[topic] = time, message
        for source, values in self._readings(topic, message):
            self._held[source.name] = time, values
            if source.over:
                self._summaries[source.name].add(values)

    def _readings(self, topic: str, message) -> Iterator[tuple[Source, list[float]]]:
        for source in self._by_topic.get(topic, ()):
            try:
                values = source.readings(message)
            except UnlistedKindError:
                values = [math.nan] * len(source.names)
            except UNREADABLE:
                continue
            if values:
                yield source, values

    def state(self, time: int) -> array:
        """Return the values at a time, NaN for what has none or none that is finite.

        What is summarised is so since the call before: this is to be called once a step.
        """
        state = array('d', [math.nan]) * len(self.names)
        self.gone = {}
        if self._since is None:
            self._since = time
        if time < self._last:  # The clock was set back: what was received counts from now on.
            self._since = min(self._since, time)
            for newest in (self._held, self._received):
                newest |= {key: (min(at, time), what) for key, (at, what) in newest.items()}
        self._last = time
        for source, places in self._places:
            at, values = self._held.get(source.name, (None, ()))
            summary = self._summaries.get(source.name)
            if summary is not None and summary.is_known:
                self._fill(state, source, places, summary.take())
            elif at is None:
                if time - self._since > min(source.max_age, _FIRST) * SECOND:
                    self.gone[source.name] = 'no message yet'
            elif time - at > source.max_age * SECOND:
                self.gone[source.name] = f'silent for more than its max_age, {source.max_age:g} s'
            elif summary is not None and all(map(math.isfinite, values)):
                self._fill(state, source, places, summary.take_of(values))
            elif summary is not None:
                self.gone[source.name] = 'no finite value'
            else:
                self._fill(state, source, places, values)
        return state

    def _fill(self, state: array, source: Source, places, values: Sequence[float]) -> None:
        for i, place in places:
            if math.isfinite(values[i]):
                state[place] = values[i]
            else:
                self.gone[source.name] = f'it is {values[i]}'
