# SPDX-License-Identifier: Apache-2.0

"""The newest values of a robot file's sources, and summaries of all since the last step."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from cmifs_ros.collect.robot_file.model import Source

from . import missing_values
from .summaries import Summary


class HeldValues:
    """Hold the newest values of some sources; others are ignored."""

    def __init__(self, sources: Iterable[Source]):
        self.sources = tuple(sources)
        self._names = {source.name for source in self.sources}
        self._held: dict[str, tuple[float, Sequence[float]]] = {}
        self.begin_anew()

    def begin_anew(self) -> None:
        """Forget what was before the clock was set, but for what is latched."""
        latched = {source.name for source in self.sources if source.max_age == math.inf}
        self._held = {
            name: (-math.inf, values) for name, (_, values) in self._held.items() if name in latched
        }
        self._summaries = {source.name: Summary(source) for source in self.sources if source.over}

    def hear(self, time: int, values: Mapping[str, Sequence[float]]) -> None:
        """Take the values of a message, by source, at its time in nanoseconds."""
        for name in values.keys() & self._names:
            self._held[name] = (time, values[name])
            if name in self._summaries:
                self._summaries[name].add(values[name])

    def of(self, source: Source, time: int) -> tuple[Sequence[float], str | None]:
        """Return what a source tells at a time, and if that is of no use, why.

        A summary begins anew.
        """
        summary = self._summaries.get(source.name)
        if summary is not None and summary.is_known:
            return summary.take(), None
        since, held = self._held.get(source.name, (None, []))
        cause = missing_values.cause(source, since, held, time)
        if summary is not None and cause is None:
            held = summary.take_of(held)
        return held, cause
