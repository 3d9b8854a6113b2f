# SPDX-License-Identifier: Apache-2.0

"""The traffic of topics: what switching one off would save."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from cmifs_ros.core.words import counted


class Rate(NamedTuple):
    """Messages and bytes per second."""

    messages: float
    bytes: float


@dataclass(frozen=True)
class Traffic:
    """Numbers of messages and bytes by topic, and the duration they were counted in.

    If it is simulated, the duration is that of /clock: the robot's own, however fast the simulation
    ran.
    """

    seconds: float = 0.0
    messages: Mapping[str, int] = field(default_factory=dict)
    bytes: Mapping[str, int] = field(default_factory=dict)
    is_simulated: bool = False


def rates_of(recordings: Sequence[Traffic]) -> dict[str, Rate]:
    """Return the mean rate of each topic over recordings; empty if their duration is 0."""
    seconds = sum(traffic.seconds for traffic in recordings)
    messages, sizes = Counter[str](), Counter[str]()
    for traffic in recordings:
        messages.update(traffic.messages)
        sizes.update(traffic.bytes)
    if seconds <= 0:
        return {}
    return {topic: Rate(n / seconds, sizes[topic] / seconds) for topic, n in messages.items()}


class TrafficMeter:
    """Measure the traffic of topics while they are on, and what is saved while they are off.

    Attributes
    ----------
    saved : dict of str to Rate
        By topic, roughly the messages and bytes not received because it was off.

    """

    def __init__(self):
        self._messages: Counter[str] = Counter()
        self._sizes: dict[str, int] = {}  # Sizes of the newest messages in bytes.
        # Seconds for which a topic was on, since its first message.
        self._seconds: dict[str, float] = {}
        # CPU and elapsed seconds, by whether any topic was off.
        self._cpu: dict[bool, tuple[float, float]] = {}
        self.saved: dict[str, Rate] = {}

    def take(self, topic: str) -> None:
        """Count a message."""
        self._messages[topic] += 1

    def weigh(self, topic: str, size: int) -> None:
        """Note the size of a topic's newest message in bytes."""
        self._sizes[topic] = size

    def use_cpu(self, cpu_seconds: float, seconds: float, is_saving: bool) -> None:
        """Add CPU time used in some seconds, while any topic was off, or while none was."""
        cpu, total = self._cpu.get(is_saving, (0.0, 0.0))
        self._cpu[is_saving] = cpu + cpu_seconds, total + seconds

    def pass_time(self, seconds: float, off: Collection[str]) -> None:
        """Add the robot's time since the last call, in which these topics were off."""
        for topic in self._messages.keys() - set(off):
            self._seconds[topic] = self._seconds.get(topic, 0.0) + seconds
        for topic in off:
            rate, saved = self.rate(topic), self.saved.get(topic, Rate(0.0, 0.0))
            self.saved[topic] = Rate(
                saved.messages + seconds * rate.messages, saved.bytes + seconds * rate.bytes
            )

    def rate(self, topic: str) -> Rate:
        """Return the mean rate of a topic while it is on."""
        seconds = self._seconds.get(topic, 0.0)
        messages = self._messages[topic] / seconds if seconds else 0.0
        return Rate(messages, messages * self._sizes.get(topic, 0))

    def cpu_share(self, is_saving: bool) -> float | None:
        """Return the share of a core while any topic is off, or while none is; None if never."""
        cpu, total = self._cpu.get(is_saving, (0.0, 0.0))
        return cpu / total if total else None


def rate_in_words(rate: Rate) -> str:
    """Return messages and bytes per second as text."""
    return f'{counted(f"{rate.messages:.3g}", "message")}/s, {size_in_words(rate.bytes)}/s'


def size_in_words(number: float) -> str:
    """Return a number of bytes as text."""
    for unit in ('B', 'kB', 'MB'):
        if number < 999.5:
            return f'{number:.3g} {unit}'
        number /= 1000
    return f'{number:.3g} GB'
