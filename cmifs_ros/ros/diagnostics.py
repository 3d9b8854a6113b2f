# SPDX-License-Identifier: Apache-2.0

"""Messages for /diagnostics, after REP 107."""

from __future__ import annotations

from collections.abc import Mapping

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN
ERROR, STALE = DiagnosticStatus.ERROR, DiagnosticStatus.STALE


def status(name: str, level: bytes, message: str, values: Mapping) -> DiagnosticStatus:
    """Return one status; values are shown as text."""
    return DiagnosticStatus(
        name=name,
        level=level,
        message=message,
        hardware_id='cmifs_ros',
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )


def diagnostic_array(stamp: Time, *statuses: DiagnosticStatus) -> DiagnosticArray:
    """Return a message of several statuses."""
    msg = DiagnosticArray(status=list(statuses))
    msg.header.stamp = stamp
    return msg
