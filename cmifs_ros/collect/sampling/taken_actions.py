# SPDX-License-Identifier: Apache-2.0

"""The action of a step: the command given after its state and before the next one.

A command follows the state that it answers. So the action of a step from time t0 to t1 is the
newest message at t0 or later, but before t1. If there is none, the previous one holds for its
`max_age`.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from cmifs_ros.collect.robot_file.model import Source

from .held_values import HeldValues


class TakenAction(NamedTuple):
    """The action of a step, and by source why a part of it is missing."""

    values: array
    lacking: dict[Source, str]


class TakenActions:
    """Hold the newest values of the actions of a robot file.

    Attributes
    ----------
    held : HeldValues
        Of the messages that count to the current step.

    """

    def __init__(self, sources: Iterable[Source]):
        self.held = HeldValues(sources)
        # Messages of one time, at which a step may begin.
        self._waiting: list[tuple[int, Mapping]] = []

    def begin_anew(self) -> None:
        """Forget everything except latched values, because the clock was set."""
        self.pass_on()
        self.held.begin_anew()

    def hear(self, time: int, values: Mapping[str, Sequence[float]]) -> None:
        """Take the values of a message with its time in nanoseconds, which never goes back."""
        self.pass_on(time)
        self._waiting.append((time, values))

    def pass_on(self, time: float = float('inf')) -> None:
        """Count messages before this time to the current step."""
        if self._waiting and self._waiting[0][0] < time:
            for message in self._waiting:
                self.held.hear(*message)
            self._waiting = []

    def of_step(self, begin: int, end: int) -> TakenAction:
        """Return the action of a step from one time until another."""
        self.pass_on(end)
        action = TakenAction(array('d'), {})
        for source in self.held.sources:
            values, cause = self.held.of(source, begin)
            if cause is None:
                action.values.extend(values)
            else:
                action.lacking[source] = cause
        return action
