# SPDX-License-Identifier: Apache-2.0

"""Messages of arbitrary content, and the names in valid ones."""

from __future__ import annotations

import numpy as np
from sensor_msgs.msg import JointState

NUM_CHANNELS = 14
NAMES = [f'channel_{i}' for i in range(NUM_CHANNELS)]
FIELDS = ['reward', 'terminated', 'truncated', 'episode', 'step']
LENGTH = 20  # steps of an episode

_TEXTS = ('a', 'b', 'c', 'reward', 'step', '', 'ä', '\U0001f916', 'x' * 1000, '\n', 'a' * 257)
_VALUES = (0.0, 1.0, -1.0, np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324, 1e17, 0.5)


def random_message(rng: np.random.Generator, names: tuple[str, ...]) -> JointState:
    """Return a message of arbitrary content; its first names are often the valid ones."""
    msg = JointState()
    wide = rng.random() < 0.5
    msg.header.stamp.sec = int(rng.integers(-(2**31), 2**31) if wide else rng.integers(3))
    msg.header.stamp.nanosec = int(rng.integers(2**32) if wide else rng.integers(20))
    msg.header.frame_id = str(rng.choice(_TEXTS))
    if rng.random() < 0.5:
        msg.name = list(names[: rng.integers(len(names) + 1)])
    else:
        size = 5000 if rng.random() < 0.005 else rng.integers(8)
        msg.name = [str(text) for text in rng.choice(_TEXTS, size=size)]
    size = len(msg.name) if rng.random() < 0.9 else rng.integers(8)
    msg.position = (rng.choice(_VALUES, size) if wide else rng.normal(size=size)).tolist()
    msg.velocity = rng.choice(_VALUES, size=rng.integers(3)).tolist()
    return msg


def random_state(rng: np.random.Generator) -> JointState:
    """Return a message for `state` of arbitrary content."""
    return random_message(rng, ('a', 'b', 'c'))


def random_reward(rng: np.random.Generator) -> JointState:
    """Return a message for `reward` of arbitrary content."""
    return random_message(rng, tuple(FIELDS))
