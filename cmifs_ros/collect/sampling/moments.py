# SPDX-License-Identifier: Apache-2.0

"""Messages with their times, in nanoseconds."""

from __future__ import annotations

from typing import Any, NamedTuple

SECOND = 1_000_000_000


class Message(NamedTuple):
    """A waiting message; equal stamps are ordered by the topic's rank, then by arrival.

    `is_stamped` is False if its time is the receive time.
    """

    stamp: int
    rank: int
    sequence: int
    topic: str
    is_stamped: bool
    content: Any


class Moment(NamedTuple):
    """All messages with one time."""

    time: int
    messages: list[Message]


#: Marks the moment at which the clock was set.
CLOCK_SET = Moment(-1, [])
