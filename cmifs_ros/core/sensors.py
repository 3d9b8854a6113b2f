# SPDX-License-Identifier: Apache-2.0

"""Sensors from the names of channels and groups of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from numbers import Integral

from .search import Sensor


def checked_names(names: Sequence[str] | None, num_channels: int) -> tuple[str, ...]:
    """Return the names of the channels, by default x0, x1, ...; raise ValueError if invalid."""
    if names is None:
        return tuple(f'x{i}' for i in range(num_channels))
    names = tuple(names)
    if len(names) != num_channels:
        raise ValueError(
            f'there are {len(names)} names; expected {num_channels}, one for each channel'
        )
    for name, count in Counter(names).items():
        if not name or count > 1:
            raise ValueError(f'channel name {name!r} is empty or repeated; expected distinct names')
    return names


def channel_index(names: tuple[str, ...], channel: str | int, where: str) -> int:
    """Return the index of a channel given by name or index; `where` appears in the error."""
    index = names.index(channel) if channel in names else channel
    if not isinstance(index, Integral) or not 0 <= index < len(names):
        raise ValueError(f'{where} names channel {channel!r}; expected one of {", ".join(names)}')
    return int(index)


def sensors_of(
    names: tuple[str, ...], groups: Mapping[str, Sequence[str | int]]
) -> tuple[tuple[str, ...], list[Sensor]]:
    """Return the names and channels of all sensors, ordered by their first channels.

    Raises
    ------
    ValueError
        If a group is empty, names an unknown channel or one of another group, or has the name of a
        channel outside it.

    """
    grouped: dict[int, str] = {}
    sensors: dict[str, Sensor] = {}
    for group, members in groups.items():
        indices = []
        for member in members:
            index = channel_index(names, member, f'group {group!r}')
            if index in grouped:
                raise ValueError(
                    f'channel {names[index]!r} is in two groups, {grouped[index]!r} and {group!r}; '
                    'expected one'
                )
            grouped[index] = group
            indices.append(index)
        if not indices:
            raise ValueError(f'group {group!r} is empty; expected at least one channel')
        sensors[group] = tuple(indices)
    for index, name in enumerate(names):
        if index not in grouped:
            if name in sensors:
                raise ValueError(f'{name!r} names a group and a channel outside it; rename one')
            sensors[name] = (index,)
    ordered = sorted(sensors.items(), key=lambda item: min(item[1]))
    return tuple(name for name, _ in ordered), [channels for _, channels in ordered]
