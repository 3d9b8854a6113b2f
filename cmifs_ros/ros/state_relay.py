# SPDX-License-Identifier: Apache-2.0

"""The selector's `selected_state`, relayed from each state unless a sampler publishes it."""

from __future__ import annotations

from array import array

from rclpy.node import Node
from std_msgs.msg import Header

from cmifs_ros.collect.episodes.filter import StateFilter, layout_of

from .publishers import UNKNOWN_NODE, nodes_publishing
from .selected_state_publisher import SelectedStatePublisher
from .selection_in_use import SelectionInUse


class StateRelay:
    """Publish the selected channels of each state, unless another node does.

    A node that publishes both `state` and `selected_state`, as the sampler does, needs no relay.

    Parameters
    ----------
    node : rclpy.node.Node
    settings : dict
        The node's parameters by name, kept up to date.

    """

    def __init__(self, node: Node, settings: dict):
        self._node, self._settings = node, settings
        self._publisher = SelectedStatePublisher(node, settings)
        self._input = node.resolve_topic_name('state')
        self._filter: StateFilter | None = None
        self._others: set[str] = set()
        self._is_certain = False

    @property
    def num_lacking(self) -> int:
        """Number of states without a selected channel since the selection was made."""
        return 0 if self._filter is None else self._filter.num_lacking

    @property
    def is_lacking(self) -> bool:
        """Whether a selected channel is missing from the newest state."""
        return self._filter is not None and self._filter.is_lacking

    def other_publisher(self) -> str:
        """Return the node that publishes `selected_state` itself; empty if there is none."""
        self._look()
        return min(self._others, default='')

    def forget_publishers(self) -> None:
        """Look for other publishers again, because one of `state` has come or gone."""
        self._is_certain = False

    def use(self, in_use: SelectionInUse | None) -> None:
        """Apply a selection; None: all channels are selected."""
        self._filter = None
        if in_use is not None:
            names = layout_of(self._settings['layout'], in_use.channel_names, in_use.channels)
            self._filter = StateFilter(in_use.channels, names)
        self._publisher.use(None if in_use is None else in_use.selection.number)

    def relay(self, header: Header, names: list[str], values: array) -> None:
        """Publish the selected channels of a state."""
        # A sampler has its publisher of `selected_state` before that of `state`, so it is enough to
        # look when one of `state` comes or goes. To look at each state takes longer than the rest.
        if not self._is_certain:
            self._look()
        if self._others or len(names) != len(values):
            return
        if self._filter is not None:
            values = self._filter.pick(names, values)
            names = self._filter.names
        elif not self._settings['pass_through_until_selected']:
            return
        if values is not None:
            self._publisher.publish(header.stamp, names, values)

    def _look(self) -> None:
        origins = nodes_publishing(self._node, self._input)
        publishers = nodes_publishing(self._node, self._publisher.topic_name)
        others = set(publishers) - {self._node.get_fully_qualified_name()}
        self._is_certain = bool(origins) and not any(
            UNKNOWN_NODE in name for name in origins + publishers
        )
        # An unknown node may be the sampler: until it is known, publish nothing twice.
        self._others = {n for n in others if not self._is_certain or n in origins}
