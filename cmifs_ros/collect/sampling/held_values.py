# SPDX-License-Identifier: Apache-2.0

"""The newest values of some sources of a robot file, and summaries since the last step."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable, Mapping, Sequence

from cmifs_ros.collect.robot_file.model import Source

from . import missing_values
from .summaries import Summary


class HeldValues:
    """Hold the newest values of some sources; ignore all other sources."""

    def __init__(self, sources: Iterable[Source] = ()):
        self._held: dict[str, tuple[float, Sequence[float]]] = {}
        self._summaries: dict[str, Summary] = {}
        self.follow(sources)

    def follow(self, sources: Iterable[Source]) -> None:
        """Hold the values of these sources from now on; keep what is held of them already."""
        self.sources = tuple(sources)
        self._names = {source.name for source in self.sources}
        self._held = {name: held for name, held in self._held.items() if name in self._names}
        self._summaries = {
            source.name: self._summaries.get(source.name) or Summary(source)
            for source in self.sources
            if source.over
        }

    def begin_anew(self) -> None:
        """Forget everything except latched values, because the clock was set."""
        latched = {source.name for source in self.sources if source.max_age == math.inf}
        self._held = {
            name: (-math.inf, values) for name, (_, values) in self._held.items() if name in latched
        }
        self._summaries = {source.name: Summary(source) for source in self.sources if source.over}

    def hear(self, time: int, values: Mapping[str, Sequence[float]]) -> None:
        """Take the values of a message, by source, with its time in nanoseconds."""
        self.hold(time, values)
        for name in values.keys() & self._summaries.keys():
            self._summaries[name].add(values[name])

    def hold(self, time: int, values: Mapping[str, Sequence[float]]) -> None:
        """Take values without adding them to a summary."""
        for name in values.keys() & self._names:
            self._held[name] = (time, values[name])

    def of(self, source: Source, time: int) -> tuple[Sequence[float], str | None]:
        """Return the values of a source at a time, and why they are unusable, or None.

        A summary starts over. If no message came since the last call, it is that of the newest
        message.
        """
        summary = self._summaries.get(source.name)
        if summary is not None and summary.is_known:
            return summary.take(), None
        since, held = self._held.get(source.name, (None, []))
        cause = missing_values.cause(source, since, held, time)
        if summary is not None and cause is None:
            held = summary.take_of(held)
        return held, cause

    def peek(self, source: Source, time: int) -> tuple[Sequence[float], str | None]:
        """Return what `of` would; no summary starts over."""
        summary = copy.deepcopy(self._summaries.get(source.name))
        found = self.of(source, time)
        if summary is not None:
            self._summaries[source.name] = summary
        return found
