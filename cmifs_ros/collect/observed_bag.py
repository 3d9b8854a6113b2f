# SPDX-License-Identifier: Apache-2.0

"""A first robot file from the topics of a bag."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from .robot_file.observed_fields import MAX_LOOKS, ObservedTopic
from .robot_file.template import is_of_robot, robot_file_of_topics
from .sampling.bag_reader import OpenBag, Undecoded, messages_of, open_bag, unwatched
from .simulated_time import CLOCK, CLOCK_TYPE, SimulatedTime

#: Of messages up to this size, each that differs from the previous one is read: a bumper is hit
#: rarely.
_MAX_SHORT = 64


def robot_file_of_bag(
    path: str | Path,
    watch: Callable[[Iterable, int], Iterable] = unwatched,
    open_bag: OpenBag = open_bag,
) -> str:
    """Return the text of a robot file with all channels of a bag.

    It is complete except for the reward, which only the user knows.

    Parameters
    ----------
    path : path
        A file or a folder.
    watch, open_bag : callable, optional
        As in `episodes_of_bag`.

    Raises
    ------
    RecordingError
        If the bag cannot be read, or no topic has a readable message.

    """
    with open_bag(path) as reader:
        heard = {
            topic: ObservedTopic(
                topic, info.msgtype, reader.types.fields_of, info.msgcount, reader.duration / 1e9
            )
            for topic, info in reader.topics.items()
        }
        simulated = SimulatedTime()
        clock = {CLOCK} if CLOCK in heard and heard[CLOCK].kind == CLOCK_TYPE else set()
        topics = clock.union(topic for topic in heard if is_of_robot(topic))
        total = sum(heard[topic].count for topic in topics)
        messages = messages_of(reader, path, topics, _Choice(heard))
        for topic, message, _ in watch(messages, total):
            if topic in clock and not isinstance(message, Undecoded):
                simulated.take(message)
            elif not isinstance(message, Undecoded):
                heard[topic].look(message)
            elif message.cause:
                heard[topic].problem = f': {message.cause}'
        if simulated.seconds:
            for one in heard.values():
                one.seconds = simulated.seconds
        return robot_file_of_topics(Path(path).name, heard.values(), simulated.seconds > 0)


class _Choice:
    """Choose the messages of a bag to read.

    Of long ones, that is a random one of each few in succession, the same each time: if it were
    each tenth, some of ten nodes that publish one topic in turn would never be read.
    """

    def __init__(self, heard: dict[str, ObservedTopic]):
        self._heard = heard
        self._random = np.random.default_rng(0)
        self._counts: Counter[str] = Counter()
        self._turns: dict[str, int] = {}
        self._last: dict[str, bytes] = {}

    def __call__(self, topic: str, data: bytes) -> bool:
        heard = self._heard[topic]
        if not heard.is_open:
            return False
        few = -(-heard.count // MAX_LOOKS)
        place = self._counts[topic] % few
        self._counts[topic] += 1
        if place == 0:
            self._turns[topic] = int(self._random.integers(few))
        if len(data) <= _MAX_SHORT:
            is_same = data == self._last.get(topic)
            self._last[topic] = data
            return not is_same
        is_chosen = place == self._turns[topic] or heard.trace.is_open
        heard.num_unseen += not is_chosen
        return is_chosen
