"""The sampler node: any robot's topics become `state` and `reward`, as its robot file says."""

from __future__ import annotations

import importlib

from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from cmifs_ros.collect.robot_file import load_robot_file
from cmifs_ros.collect.sampler import Sampler, event_time

from . import conversions
from .following_subscription import FollowingSubscription


class SamplerNode(Node):
    """Subscribe to what the robot file names, as soon as somebody publishes it."""

    def __init__(self):
        super().__init__('sampler')
        path = self.declare_parameter('robot_file', '').value
        if not path:
            raise ValueError('robot_file is empty; expected the path of a robot file')
        try:
            self._robot = load_robot_file(path)
        except OSError as error:
            raise ValueError(f'robot_file cannot be read: {error}') from None
        self._names = self._robot.channel_names
        self._sampler = Sampler(self._robot)
        stream = QoSProfile(depth=1000)
        self._state_publisher = self.create_publisher(JointState, 'state', stream)
        self._reward_publisher = self.create_publisher(JointState, 'reward', stream)
        self._subscriptions_by_topic: dict[str, FollowingSubscription] = {}
        self._refused: set[str] = set()
        self._timer = self.create_timer(0.2, self._discover)
        self._discover()

    def _discover(self) -> None:
        """Subscribe to the topics whose type is known by now."""
        found = dict(self.get_topic_names_and_types())
        for topic in self._robot.topics:
            if topic in self._subscriptions_by_topic or topic in self._refused:
                continue
            name = (self._robot.types or {}).get(topic) or next(
                iter(found.get(self.resolve_topic_name(topic), ())), None
            )
            if name is None:
                continue
            try:
                package, kind, cls = name.split('/')
                message_type = getattr(importlib.import_module(f'{package}.{kind}'), cls)
            except (ValueError, ImportError, AttributeError) as error:
                self._refused.add(topic)
                self.get_logger().error(
                    f'{topic} has the type {name}, which is not installed here: {error}'
                )
                continue
            self._subscriptions_by_topic[topic] = FollowingSubscription(
                self, message_type, topic, self._callback(topic)
            )

    def _callback(self, topic: str):
        def take(message) -> None:
            # The EventsExecutor of rclpy 7.1.6 fails on callbacks that ask for the message's info,
            # so that without a stamp it is the time of receipt.
            stamp = event_time(message, self.get_clock().now().nanoseconds)
            for step in self._sampler.add(topic, message, stamp):
                header = Header(stamp=conversions.stamp_from_nanoseconds(step.stamp))
                self._state_publisher.publish(
                    conversions.named_values_to_msg(header, self._names, step.state)
                )
                fields = step.sample._asdict()
                self._reward_publisher.publish(
                    conversions.named_values_to_msg(header, fields, fields.values())
                )

        return take
