# SPDX-License-Identifier: Apache-2.0

"""Publish the topics of channels and their traffic from the sampler to the selector."""

from __future__ import annotations

import json
import time

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from cmifs_ros.collect.robot_file.model import RobotFile
from cmifs_ros.collect.robot_file.own_topics import is_own_entry
from cmifs_ros.collect.sensor_topics import SensorTopics, topic_fields
from cmifs_ros.collect.simulated_time import SimulatedTime
from cmifs_ros.collect.traffic import TrafficMeter

from .qos import LATCHED_QOS


class TopicTraffic:
    """Measure the topics of a robot file, and publish `channel_topics`.

    Parameters
    ----------
    node : rclpy.node.Node
    robot : RobotFile
    simulated : SimulatedTime, optional
        The robot's time, if it is simulated.

    Attributes
    ----------
    meter : TrafficMeter

    """

    def __init__(self, node: Node, robot: RobotFile, simulated: SimulatedTime | None = None):
        self._node, self._robot, self._simulated = node, robot, simulated
        self.meter = TrafficMeter()
        self._weighed: set[str] = set()  # Topics since the last report.
        self._looked_at = self._times()
        self._told = ''
        self._publisher = node.create_publisher(String, 'channel_topics', LATCHED_QOS)
        self._publish()

    def take(self, topic: str, message) -> None:
        """Count a message; measure the size of one message per topic and second.

        This package's own entries in /diagnostics are not the robot's.
        """
        if (
            isinstance(message, DiagnosticArray)
            and message.status
            and all(map(is_own_entry, message.status))
        ):
            return
        self.meter.take(topic)
        if topic not in self._weighed:
            self._weighed.add(topic)
            self.meter.weigh(topic, len(serialize_message(message)))

    def report(self, off: frozenset[str], losses: str) -> None:
        """Publish the rates, once a second.

        Parameters
        ----------
        off : frozenset of str
            The topics that are switched off.
        losses : str
            How the loss of episodes depended on their end; it is published, too.

        """
        now = self._times()
        of_robot, seconds, cpu_seconds = (
            at - then for at, then in zip(now, self._looked_at, strict=True)
        )
        self._looked_at = now
        self.meter.use_cpu(cpu_seconds, seconds, bool(off))
        self.meter.pass_time(of_robot, off)
        self._weighed.clear()
        self._publish(losses)

    def _times(self) -> tuple[float, float, float]:
        """Return the robot's time, the elapsed time and the CPU time in seconds."""
        elapsed = time.monotonic()
        of_robot = elapsed if self._simulated is None else self._simulated.seconds
        return of_robot, elapsed, time.process_time()

    def _publish(self, losses: str = '') -> None:
        name = self._node.resolve_topic_name
        rates = {topic: self.meter.rate(topic) for topic in self._robot.topics}
        found = SensorTopics(
            {channel: name(topic) for channel, topic in self._robot.channel_topics.items()},
            {name(topic): rate for topic, rate in rates.items() if rate.messages},
            tuple(map(name, self._robot.topics_for(()))),
        )
        text = json.dumps(topic_fields(found) | {'losses': losses})
        if text != self._told:
            self._told = text
            self._publisher.publish(String(data=text))
