# SPDX-License-Identifier: Apache-2.0

"""Why steps lack channels or values: counts and messages."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from cmifs_ros.collect.robot_file.model import Source
from cmifs_ros.core.words import counted, first, listed, short

from .moments import SECOND

#: Why a step lacks a value.
NEVER, NOT_YET, SILENT = 'no message', 'no message yet', 'silent'
_LATE = 'its messages come later than steps can wait'
_NAN, _INFINITE, NO_VALUE = 'it is NaN', 'it is infinite', 'it has no value'
_UNLISTED = 'its category is not listed in one_hot'


def cause(source: Source, since: float | None, values: Sequence[float], time: int) -> str | None:
    """Return why the newest values of a source cannot be used at a time, None if they can.

    Parameters
    ----------
    source : Source
    since : float or None
        Time of these values in nanoseconds; None if there was no message.
    values : sequence of float
    time : int
        In nanoseconds.

    """
    if since is None:
        return NEVER
    if time - since > source.max_age * SECOND:
        return SILENT
    if source.one_hot and math.isnan(values[0]):
        return _UNLISTED
    if all(map(math.isfinite, values)):
        return None
    return _NAN if any(map(math.isnan, values)) else _INFINITE


def silent_for(source: Source) -> str:
    """Return the message for a source that is silent."""
    return f'silent for more than its max_age, {source.max_age:g} s'


class MissingValues:
    """Count what steps lack.

    Parameters
    ----------
    sources : iterable of Source
    received : mapping of str to int
        Number of messages by topic, usable or not; it is only read.
    late : mapping of str to int
        Number of those that were too late; it is only read.

    Attributes
    ----------
    counts : collections.Counter
        Number of steps by source, or `reward`, and cause; see `in_words`.

    """

    def __init__(
        self, sources: Iterable[Source], received: Mapping[str, int], late: Mapping[str, int]
    ):
        self._sources = {source.name: source for source in sources}
        self._received, self._late = received, late
        self.counts: Counter[tuple[str, str]] = Counter()
        # By topic: count, first and last time, and how many were late by then.
        self._heard: dict[str, tuple[int, int, int, int]] = {}
        self._useful: set[str] = set()

    def heard(self, topic: str, stamp: int, names: Iterable[str]) -> None:
        """Note the time of a message and the sources for which it has a value."""
        count, first, _, _ = self._heard.get(topic, (0, stamp, stamp, 0))
        self._heard[topic] = (count + 1, first, stamp, self._late[topic])
        self._useful.update(names)

    def forget_times(self) -> None:
        """Forget the times of messages, because the clock was set."""
        self._heard.clear()

    def in_words(self, counts: Mapping[tuple[str, str], int]) -> Counter[str]:
        """Return how many steps lacked something, by a message of what and why.

        Sources of one topic that were missing equally often share a message, without names if they
        are all of the topic.

        Parameters
        ----------
        counts : mapping of tuple to int
            Like `counts`, possibly for some of the steps.

        """
        of = {name: (s.path.topic, s.role) for name, s in self._sources.items()}
        sizes = Counter(of.values())
        alike: dict[tuple, list[str]] = {}
        for (name, why), count in counts.items():
            key = (of.get(name, name), count, self._explained(name, why))
            alike.setdefault(key, []).append(name)
        words: Counter[str] = Counter()
        for (origin, count, why), names in alike.items():
            what = names[0]
            if len(names) > 1:
                topic, role = origin
                what = f'{counted(len(names), role)} of {topic}'
                what += f' ({listed(names)})' if len(names) < sizes[origin] else ''
            words[f'{what}: {why}'] = count
        return words

    def named(self, names: Iterable[str]) -> str:
        """Return sources as text: one by its name, several of a topic by their number.

        A name that is not a source stands for itself.
        """
        alike: dict[tuple[str, str], list[str]] = {}
        for name in sorted(names):
            source = self._sources.get(name)
            key = (source.path.topic, source.role) if source else (name, '')
            alike.setdefault(key, []).append(name)
        return first(
            [
                short(some[0]) if len(some) == 1 else f'{counted(len(some), role)} of {topic}'
                for (topic, role), some in alike.items()
            ]
        )

    def before_first(self) -> tuple[int, str]:
        """Return how many steps came before the first message of some source, and of which last.

        Such steps are at the beginning, so the count of the last source is that of all.
        """
        counts = {
            name: count
            for (name, why), count in self.counts.items()
            if why == NEVER and name in self._useful
        }
        last = max(counts, key=counts.__getitem__, default='')
        return counts.get(last, 0), self._sources[last].path.topic if last else ''

    def _explained(self, name: str, why: str) -> str:
        """Return why a step lacked something, from what is known of the topic by now."""
        if why not in (NEVER, SILENT):
            return why
        source = self._sources[name]
        count, first, newest, late = self._heard.get(source.path.topic, (0, 0, 0, 0))
        if why == NEVER and name in self._useful:
            return NOT_YET
        if self._late[source.path.topic] > late:
            return _LATE
        if why == NEVER:
            return self._never_usable(source)
        period = (newest - first) / SECOND / (count - 1) if count > 1 else 0.0
        if period > source.max_age:
            return f'its messages come every {period:.3g} s, max_age is {source.max_age:g} s'
        return silent_for(source)

    def _never_usable(self, source: Source) -> str:
        if not self._received[source.path.topic]:
            return NEVER
        # Messages without an entry that braces name are not wrong: they are of other things.
        if any(field[0] == '{' for field in source.path.fields):
            return f'no message has a usable value at {source.path}'
        return f'no usable message on {source.path.topic}'
