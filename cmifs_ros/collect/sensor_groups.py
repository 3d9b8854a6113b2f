# SPDX-License-Identifier: Apache-2.0

"""Which channels form one sensor, from their names alone."""

from __future__ import annotations

import re
from collections.abc import Sequence

_MEMBER = re.compile(r'(?s)(.+)(?:\[\d+(?:,\d+)*\]|\.[^.\[\]]+)')


def groups_by_name(channel_names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return the sensors of several channels: `stem[0]`, `stem[0,1]`, or `stem.a`, `stem.b`.

    The stem is the name without its last index or part. A stem of a single channel makes no group,
    and neither does one that is itself the name of a channel.

    >>> groups_by_name(['x', 'scan[0]', 'scan[30]', 'yaw.sin', 'yaw.cos', 'imu.z'])
    {'scan': ('scan[0]', 'scan[30]'), 'yaw': ('yaw.sin', 'yaw.cos')}

    Parameters
    ----------
    channel_names : sequence of str
        Distinct.

    Returns
    -------
    dict of str to tuple of str
        The channels of each sensor by its stem, in order.

    """
    found: dict[str, list[str]] = {}
    for name in channel_names:
        member = _MEMBER.fullmatch(name)
        if member is not None:
            found.setdefault(member[1], []).append(name)
    return {
        stem: tuple(members)
        for stem, members in found.items()
        if len(members) > 1 and stem not in channel_names
    }
