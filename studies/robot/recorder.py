# SPDX-License-Identifier: Apache-2.0

"""Record topics to MCAP with the writer of rosbags."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore


class Recorder:
    """Subscribe to topics and write each message as it is received.

    Parameters
    ----------
    node : rclpy.node.Node
        Must be spun.
    path : Path
        A new folder.
    topics : mapping of str to (type, QoSProfile)

    """

    def __init__(self, node: Node, path: Path, topics: Mapping[str, tuple[type, QoSProfile]]):
        store = get_typestore(Stores.ROS2_JAZZY)
        self._writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
        self._writer.open()
        self.num_messages = 0
        for topic, (kind, qos) in topics.items():
            name = f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'
            connection = self._writer.add_connection(topic, name, typestore=store)
            node.create_subscription(
                kind, topic, lambda data, to=connection: self._write(to, data), qos, raw=True
            )

    def _write(self, connection, data: bytes) -> None:
        self._writer.write(connection, time.time_ns(), data)
        self.num_messages += 1

    def close(self) -> None:
        """Finish the file."""
        self._writer.close()
