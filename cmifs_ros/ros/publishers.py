# SPDX-License-Identifier: Apache-2.0

"""Which nodes publish a topic."""

from __future__ import annotations

from rclpy.node import Node

#: The name of a node that the middleware has not discovered yet.
UNKNOWN_NODE = '_NODE_NAME_UNKNOWN_'


def nodes_publishing(node: Node, topic: str) -> list[str]:
    """Return the full names of the nodes that publish a topic, sorted, once for each publisher."""
    found = node.get_publishers_info_by_topic(topic)
    return sorted(f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in found)
