# SPDX-License-Identifier: Apache-2.0

"""What topics carry: what is saved where one is switched off."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple


class Rate(NamedTuple):
    """What comes on a topic in a second."""

    messages: float
    bytes: float


@dataclass(frozen=True)
class Traffic:
    """How many messages and bytes came in some time, by topic."""

    seconds: float = 0.0
    messages: Mapping[str, int] = field(default_factory=dict)
    bytes: Mapping[str, int] = field(default_factory=dict)


def rates_of(recordings: Sequence[Traffic]) -> dict[str, Rate]:
    """Return the mean rate of each topic in recordings; nothing if they took no time."""
    seconds = sum(traffic.seconds for traffic in recordings)
    messages, sizes = Counter[str](), Counter[str]()
    for traffic in recordings:
        messages.update(traffic.messages)
        sizes.update(traffic.bytes)
    if seconds <= 0:
        return {}
    return {topic: Rate(n / seconds, sizes[topic] / seconds) for topic, n in messages.items()}
