# SPDX-License-Identifier: Apache-2.0

"""What the running graph publishes: the types, values and rates of its topics."""

from __future__ import annotations

import time

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rosidl_parser.definition import (
    AbstractGenericString,
    AbstractNestedType,
    BasicType,
    NamespacedType,
)

from cmifs_ros.collect.robot_file.observed_fields import BYTES, ObservedTopic, TypeField
from cmifs_ros.collect.robot_file.template import is_of_robot
from cmifs_ros.collect.simulated_time import CLOCK, CLOCK_TYPE, SimulatedTime

from . import conversions
from .following_subscription import FollowingSubscription
from .run_node import make_executor


def fields_of(kind: str) -> list[TypeField]:
    """Return the fields of an installed message type, in order."""
    cls = conversions.message_type(kind)
    return [
        TypeField(name, _what(slot))
        for name, slot in zip(cls.get_fields_and_field_types(), cls.SLOT_TYPES, strict=True)
    ]


def _what(slot) -> str:
    """Return a field as a `TypeField`."""
    if isinstance(slot, NamespacedType):
        return '/'.join(slot.namespaced_name())
    if isinstance(slot, BasicType):
        return 'number'
    if isinstance(slot, AbstractGenericString):
        return 'text'
    if not isinstance(slot, AbstractNestedType):
        return ''
    if isinstance(slot.value_type, BasicType):
        return '' if slot.value_type.typename in BYTES else 'numbers'
    element = _what(slot.value_type)
    return f'{element}[]' if '/' in element else ''


def survey(seconds: float) -> tuple[list[ObservedTopic], list[str], bool]:
    """Listen to all topics for a while.

    Parameters
    ----------
    seconds : float

    Returns
    -------
    heard : list of ObservedTopic
    unknown : list of str
        Messages that name the topics whose types are not installed.
    is_simulated : bool
        Whether a simulation publishes its time.

    """
    context = rclpy.Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('make_robot_file', context=context)
    executor = make_executor(context)
    executor.add_node(node)
    try:
        listener = _Listener(node)
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            listener.look()
            executor.spin_once(0.1)
        is_simulated = listener.time.seconds > 0
        return listener.heard(), sorted(listener.unknown.values()), is_simulated
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)


class _Listener:
    def __init__(self, node: Node):
        self._node = node
        self._heard: dict[str, ObservedTopic] = {}
        self._since: dict[str, tuple[float, float]] = {}
        self.time = SimulatedTime()
        self.unknown: dict[str, str] = {}

    def look(self) -> None:
        """Subscribe to the topics that are new since the last call."""
        for topic, kinds in self._node.get_topic_names_and_types():
            if topic in self._heard or topic in self.unknown:
                continue
            if not self._node.count_publishers(topic):
                continue
            try:
                message_type = conversions.message_type(kinds[0])
            except (ValueError, ImportError, AttributeError):
                self.unknown[topic] = f'{topic}: its type {kinds[0]} is not installed here'
                continue
            self._heard[topic] = ObservedTopic(topic, kinds[0], fields_of)
            self._since[topic] = time.monotonic(), self.time.seconds
            if topic == CLOCK and kinds[0] == CLOCK_TYPE:
                FollowingSubscription(self._node, message_type, topic, self.time.take)
            if is_of_robot(topic):
                FollowingSubscription(
                    self._node, message_type, topic, lambda m, topic=topic: self._hear(topic, m)
                )

    def _hear(self, topic: str, message) -> None:
        self._heard[topic].count += 1
        self._heard[topic].look(message)

    def heard(self) -> list[ObservedTopic]:
        now = time.monotonic(), self.time.seconds
        is_simulated = self.time.seconds > 0
        for topic, heard in self._heard.items():
            heard.seconds = now[is_simulated] - self._since[topic][is_simulated]
        return list(self._heard.values())
