# SPDX-License-Identifier: Apache-2.0

"""Pick the selected channels of a state by name."""

from __future__ import annotations

import math
from array import array
from collections.abc import Collection, Sequence

#: Channels to publish: the selected ones, or all, NaN where not selected.
LAYOUTS = ('selected', 'full')


def layout_of(
    layout: str, channel_names: Sequence[str], selected: Collection[str] | None
) -> list[str]:
    """Return the channels to publish, in the order of the state.

    Parameters
    ----------
    layout : str
        One of `LAYOUTS`.
    channel_names : sequence of str
        All channels.
    selected : collection of str or None
        None: before the first selection.

    """
    if layout == 'full' or selected is None:
        return list(channel_names)
    return [name for name in channel_names if name in selected]


class StateFilter:
    """Pick the values of some channels from states with any order of channels.

    Parameters
    ----------
    selected : collection of str
        The channels to pick.
    names : sequence of str
        Channels to return, in this order; NaN for those not selected.

    Attributes
    ----------
    names : list of str
    num_lacking : int
        Number of states that lacked a selected channel.
    is_lacking : bool
        Whether the newest state lacked one.

    """

    def __init__(self, selected: Collection[str], names: Sequence[str]):
        self.names = list(names)
        self._selected = set(selected)
        self.num_lacking = 0
        self._state_names: list[str] | None = None
        self._columns: list[int | None] | None = []

    @property
    def is_lacking(self) -> bool:
        """Whether the newest state lacks one of the channels."""
        return self._columns is None

    def pick(self, names: list[str], values: Sequence[float]) -> array | None:
        """Return the values, or None if the state lacks a selected channel."""
        if names != self._state_names:
            self._state_names = names
            columns = {name: c for c, name in enumerate(names) if name in self._selected}
            is_complete = len(columns) == len(self._selected)
            self._columns = [columns.get(name) for name in self.names] if is_complete else None
        if self._columns is None:
            self.num_lacking += 1
            return None
        return array('d', [math.nan if c is None else values[c] for c in self._columns])
