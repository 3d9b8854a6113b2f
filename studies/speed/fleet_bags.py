# SPDX-License-Identifier: Apache-2.0

"""Bags of a fleet of robots: many channels, of which two matter."""

from __future__ import annotations

from pathlib import Path

import numpy as np

SECOND = 10**9
#: Steps per second.
RATE = 10
#: What one step leaves of a channel at the next.
_PERSISTENCE = 0.9
_JOINT_STATE = 'sensor_msgs/msg/JointState'


def write_bag(path: Path, number: int, *, episodes: int, steps: int, channels: int) -> None:
    """Write a bag with the topics `state` and `reward`, as the selector subscribes to them.

    The reward of a step is what the first channel and half of the second are, with noise. Every
    channel is an autoregression, begun anew with each episode.

    Parameters
    ----------
    path : Path
        A folder that does not exist.
    number : int
        Number of the bag, its seed; bag after bag is recorded.
    episodes, steps, channels : int
        Its size; steps of an episode, of 0.1 s.

    """
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    rng = np.random.default_rng([24, number])
    states = rng.normal(size=(episodes, steps, channels))
    for t in range(1, steps):
        states[:, t] *= np.sqrt(1 - _PERSISTENCE**2)
        states[:, t] += _PERSISTENCE * states[:, t - 1]
    rewards = states[..., 0] + 0.5 * states[..., 1] + rng.normal(size=(episodes, steps))
    is_last = np.zeros((episodes, steps))
    is_last[:, -1] = 1.0
    results = np.stack([rewards, np.zeros_like(rewards), is_last], axis=2)
    messages = {
        'state': ([f'channel_{i}' for i in range(channels)], states),
        'reward': (['reward', 'terminated', 'truncated'], results),
    }
    first = number * (episodes * steps + RATE) * SECOND // RATE
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {
            topic: (
                writer.add_connection(f'/{topic}', _JOINT_STATE, typestore=store),
                _Encoder(store, names),
                values.reshape(episodes * steps, -1),
            )
            for topic, (names, values) in messages.items()
        }
        for row in range(episodes * steps):
            time = first + (row + 1) * SECOND // RATE
            for connection, encoder, values in topics.values():
                writer.write(connection, time, encoder.encoded(time, values[row]))


class _Encoder:
    """Write messages by replacing the numbers in an encoded one, as that is fast."""

    def __init__(self, store, names: list[str]):
        types, none = store.types, np.empty(0)
        stamp = types['builtin_interfaces/msg/Time'](0, 0)
        header = types['std_msgs/msg/Header'](stamp, '')
        marks = 1e9 + np.arange(len(names))
        message = types[_JOINT_STATE](header, names, marks, none, none)
        self._bytes = bytearray(store.serialize_cdr(message, _JOINT_STATE))
        self._values = slice(self._bytes.index(marks.tobytes()), None)
        self._values = slice(self._values.start, self._values.start + marks.nbytes)

    def encoded(self, time: int, values: np.ndarray) -> bytes:
        """Return the message of a time with values; the first four bytes are the encoding."""
        self._bytes[4:12] = np.array(divmod(time, SECOND), np.uint32).tobytes()
        self._bytes[self._values] = values.tobytes()
        return bytes(self._bytes)
