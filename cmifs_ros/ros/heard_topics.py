# SPDX-License-Identifier: Apache-2.0

"""The topics of the selector's channels, as published by a sampler, if there is one."""

from __future__ import annotations

import json

from rclpy.node import Node
from std_msgs.msg import String

from cmifs_ros.collect.json_values import text_of
from cmifs_ros.collect.sensor_topics import SensorTopics, sensor_topics_of
from cmifs_ros.core.selection import Selection

from .qos import LATCHED_QOS


class HeardTopics:
    """Subscribe to `channel_topics`.

    Parameters
    ----------
    node : rclpy.node.Node

    Attributes
    ----------
    losses : str
        How the sampler's loss of episodes depended on their end; empty if it did not.

    """

    def __init__(self, node: Node):
        self._node = node
        self._newest: SensorTopics | None = None
        self.losses = ''
        node.create_subscription(String, 'channel_topics', self._take, LATCHED_QOS)

    def of(self, selection: Selection) -> SensorTopics | None:
        """Return the newest topics if they include those of the selection's channels."""
        # A selection of a fixed number has only the ranked channels.
        channels = {channel for sensor in selection.sensors for channel in sensor.channels}
        is_of_it = self._newest is not None and channels <= self._newest.topics.keys()
        return self._newest if is_of_it else None

    def _take(self, message: String) -> None:
        try:
            fields = json.loads(message.data)
            self._newest = sensor_topics_of(fields)
            self.losses = text_of(fields.get('losses', ''))
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            self._node.get_logger().warning(
                f'channel_topics cannot be read: {error!r}', throttle_duration_sec=60.0
            )
