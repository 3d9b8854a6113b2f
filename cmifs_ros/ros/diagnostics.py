# SPDX-License-Identifier: Apache-2.0

"""Messages for /diagnostics, after REP 107."""

from __future__ import annotations

from collections.abc import Mapping

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from cmifs_ros.collect.robot_file.own_topics import HARDWARE_ID

OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN
ERROR, STALE = DiagnosticStatus.ERROR, DiagnosticStatus.STALE


def name_of(node: Node) -> str:
    """Return the name of a node, with which the names of its statuses begin."""
    return node.get_fully_qualified_name().lstrip('/')


def status(name: str, level: bytes, message: str, values: Mapping) -> DiagnosticStatus:
    """Return one status; values are shown as text."""
    return DiagnosticStatus(
        name=name,
        level=level,
        message=message,
        hardware_id=HARDWARE_ID,
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )


def diagnostic_array(stamp: Time, *statuses: DiagnosticStatus) -> DiagnosticArray:
    """Return a message of several statuses."""
    msg = DiagnosticArray(status=list(statuses))
    msg.header.stamp = stamp
    return msg
