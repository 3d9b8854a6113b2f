# SPDX-License-Identifier: Apache-2.0

"""The output of the selector: the selection in use, and the state reduced to it."""

from __future__ import annotations

import dataclasses
import json
import time

from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, Int32MultiArray, String

from cmifs_ros.collect.selection_fields import fields_of
from cmifs_ros.core.selection import Selection
from cmifs_ros.core.words import listed

from . import conversions
from .heard_topics import HeardTopics
from .publishers import UNKNOWN_NODE, nodes_publishing
from .qos import LATCHED_QOS
from .selection_in_use import SelectionInUse
from .state_relay import StateRelay

#: Seconds for which a killed node of the same name may remain in the graph.
_LEASE = 30.0


class SelectorOutput:
    """Hold the selection in use, number it, publish it, and apply it to the state.

    Parameters
    ----------
    node : rclpy.node.Node
    settings : dict
        The node's parameters by name, kept up to date.

    Attributes
    ----------
    in_use : SelectionInUse or None
    relay : StateRelay
    topics : HeardTopics
    conflict : str
        Says that several nodes publish selections; empty if none does but this one.

    """

    def __init__(self, node: Node, settings: dict):
        self._node, self._settings = node, settings
        self._indices_publisher = node.create_publisher(
            Int32MultiArray, 'selected_indices', LATCHED_QOS
        )
        self._scores_publisher = node.create_publisher(JointState, 'scores', LATCHED_QOS)
        self._selection_publisher = node.create_publisher(String, 'selection', LATCHED_QOS)
        self.relay = StateRelay(node, settings)
        self.topics = HeardTopics(node)
        self.in_use: SelectionInUse | None = None
        self.conflict = ''
        self._alone_at = time.monotonic()  # When no other node had this name.
        self._is_of_topics = False  # Whether the published advice is about topics.
        self._last_number = 0

    def use(self, selection: Selection, channel_names: tuple[str, ...], cause: str) -> Selection:
        """Apply a new selection; return it with its number."""
        selection = dataclasses.replace(selection, number=self._last_number + 1)
        self._apply(selection, channel_names, time.monotonic(), cause)
        return selection

    def restore(self, selection: Selection, channel_names: tuple[str, ...], age: float) -> None:
        """Apply the selection of an earlier run, made `age` seconds ago."""
        # A selection that `select_from_bag` saved has no number.
        selection = dataclasses.replace(selection, number=selection.number or 1)
        self._apply(selection, channel_names, time.monotonic() - age, 'restored from the file')

    def change_channels(self, channel_names: tuple[str, ...]) -> None:
        """Keep the selection if the new channels include all of its own; otherwise drop it."""
        in_use = self.in_use
        if in_use is None or in_use.channel_names == channel_names:
            return
        selection = in_use.selection
        missing = set(selection.names) - set(channel_names)
        if missing:
            self._node.get_logger().warning(
                f'the selection is dropped: {listed(sorted(missing))} is not among the new '
                f'channels {listed(channel_names)}'
            )
            self.in_use = None
            self.relay.use(None)
            return
        indices = tuple(map(channel_names.index, selection.names))
        moved = dataclasses.replace(
            selection, indices=indices, means=(), spreads=(), number=self._last_number + 1
        )
        self._apply(moved, channel_names, in_use.selected_at, in_use.cause)

    def fields(self, selection: Selection) -> dict:
        """Return a selection as a dict for JSON, with the topics of its channels if known."""
        return fields_of(selection, self.topics.of(selection))

    def apply(self) -> None:
        """Apply changed parameters."""
        self.relay.use(self.in_use)

    def update(self, problem: str) -> None:
        """Publish the selection again if its doubt, or whether its topics are known, has changed.

        Also look for other selectors.

        Parameters
        ----------
        problem : str
            Message of the last attempt to select, if it failed.

        """
        self._look_for_others()
        if self.in_use is None:
            return
        doubt = self.in_use.doubt(problem)
        selection = dataclasses.replace(self.in_use.selection, doubt=doubt)
        # A restored selection was published before any topics could be heard.
        is_of_topics = self.topics.of(selection) is not None
        if doubt != self.in_use.selection.doubt or is_of_topics != self._is_of_topics:
            self.in_use.selection = selection
            self._publish_selection()

    def _apply(
        self, selection: Selection, channel_names: tuple[str, ...], selected_at: float, cause: str
    ) -> None:
        self._last_number = selection.number
        self.in_use = SelectionInUse(
            selection,
            channel_names,
            selected_at=selected_at,
            cause=cause,
            horizon=self._settings['min_episodes'],
        )
        self.relay.use(self.in_use)
        self._publish_selection()
        self._indices_publisher.publish(conversions.indices_to_msg(selection.indices))
        header = Header(stamp=self._node.get_clock().now().to_msg())
        self._scores_publisher.publish(
            conversions.named_values_to_msg(header, selection.ranking, selection.scores)
        )

    def _look_for_others(self) -> None:
        topic, own = self._selection_publisher.topic_name, self._node.get_fully_qualified_name()
        publishers = [
            name for name in nodes_publishing(self._node, topic) if UNKNOWN_NODE not in name
        ]
        if publishers.count(own) < 2:
            self._alone_at = time.monotonic()
        has_twin = time.monotonic() > self._alone_at + _LEASE
        before, self.conflict = self.conflict, ''
        if has_twin or any(name != own for name in publishers):
            self.conflict = f'{listed(publishers)} all publish {topic}: end all but one'
            if not before:
                self._node.get_logger().warning(self.conflict)

    def _publish_selection(self) -> None:
        self._is_of_topics = self.topics.of(self.in_use.selection) is not None
        fields = self.fields(self.in_use.selection)
        self._selection_publisher.publish(String(data=json.dumps(fields)))
