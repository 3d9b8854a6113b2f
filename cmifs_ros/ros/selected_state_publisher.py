# SPDX-License-Identifier: Apache-2.0

"""Publishes the selected state: in one message, and on request as names and values apart."""

from __future__ import annotations

from array import array

from builtin_interfaces.msg import Time
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from cmifs_ros.collect.episodes.filter import LAYOUTS

from .parameters import Spec
from .qos import LATCHED_QOS, STREAM_QOS

#: Of the nodes that publish it.
PARAMETERS = (
    Spec('layout', 'selected',
         'Channels of selected_state: the selected ones, or all in fixed places (full), nan where '
         'not selected.', choices=LAYOUTS),
    Spec('pass_through_until_selected', True,
         'Publish all channels on selected_state until the first selection; false: nothing.'),
    Spec('control_msgs', False,
         'Publish selected_state also as control_msgs: its names as Keys on selected_state/names, '
         'its values as Float64Values on selected_state/values.', read_only=True),
)  # fmt: skip


class SelectedStatePublisher:
    """Publish `selected_state`; with `control_msgs` also its names and its values.

    Parameters
    ----------
    node : rclpy.node.Node
    settings : dict
        The node's parameters by name.

    Raises
    ------
    ValueError
        If `control_msgs` is set and its messages are not installed.

    """

    def __init__(self, node: Node, settings: dict):
        self._publisher = node.create_publisher(JointState, 'selected_state', STREAM_QOS)
        self._header = Header()  # Of all messages.
        # Reused: creating one takes as long as publishing it.
        self._message = JointState(header=self._header)
        self._apart = _NamesAndValues(node, self._header) if settings['control_msgs'] else None

    @property
    def topic_name(self) -> str:
        """The resolved name of `selected_state`."""
        return self._publisher.topic_name

    @property
    def num_subscribers(self) -> int:
        """Number of subscribers of the values in either form."""
        others = 0 if self._apart is None else self._apart.num_subscribers
        return self._publisher.get_subscription_count() + others

    def use(self, number: int | None) -> None:
        """Set the number of the selection that the next states are made by; None: of none."""
        self._header.frame_id = '' if number is None else str(number)

    def publish(self, stamp: Time, names: list[str], values: array) -> None:
        """Publish a state."""
        self._header.stamp = stamp
        # Publishing is most of the work, even without subscribers.
        if self._publisher.get_subscription_count():
            self._message.name, self._message.position = names, values
            self._publisher.publish(self._message)
        if self._apart is not None:
            self._apart.publish(names, values)


class _NamesAndValues:
    """Publish states as ros2_control's `state_interfaces_broadcaster` does.

    The names are published with the first state that has them, before its values.
    """

    def __init__(self, node: Node, header: Header):
        try:
            from control_msgs.msg import Float64Values, Keys
        except ImportError as error:  # Older versions do not have these messages.
            raise ValueError(
                'control_msgs is true, but the package control_msgs, 5.6.0 or newer, is not '
                'installed; set it to false, or: sudo apt install ros-jazzy-control-msgs'
            ) from error
        self._header = header
        self._names, self._values = Keys(header=header), Float64Values(header=header)
        self._names_publisher = node.create_publisher(Keys, 'selected_state/names', LATCHED_QOS)
        self._values_publisher = node.create_publisher(
            Float64Values, 'selected_state/values', STREAM_QOS
        )
        self._published: tuple[str, list[str]] | None = None  # Number and names.

    @property
    def num_subscribers(self) -> int:
        """Number of subscribers of the values."""
        return self._values_publisher.get_subscription_count()

    def publish(self, names: list[str], values: array) -> None:
        """Publish the values of a state, and its names if they or the number are new."""
        if self._published != (self._header.frame_id, names):
            self._published = self._header.frame_id, names
            self._names.keys = names
            self._names_publisher.publish(self._names)
        if self.num_subscribers:
            self._values.values = values
            self._values_publisher.publish(self._values)
