"""The selected channels of a state, picked by name."""

from __future__ import annotations

from array import array
from collections.abc import Sequence


class StateFilter:
    """Pick the values of some channels out of states, whatever the order of their channels.

    Parameters
    ----------
    names : sequence of str
        The channels to pick.

    Attributes
    ----------
    names : list of str
    num_lacking : int
        States that lacked one of them.
    is_lacking : bool
        Whether the newest did.

    """

    def __init__(self, names: Sequence[str]):
        self.names = list(names)
        self.num_lacking = 0
        self._state_names: list[str] | None = None
        self._columns: list[int] | None = []

    @property
    def is_lacking(self) -> bool:
        """Whether the newest state lacks one of the channels."""
        return self._columns is None

    def pick(self, names: list[str], values: Sequence[float]) -> array | None:
        """Return the values of the channels, or None if the state lacks one of them."""
        if names != self._state_names:
            self._state_names = names
            columns = {name: column for column, name in enumerate(names)}
            is_complete = columns.keys() >= set(self.names)
            self._columns = [columns[name] for name in self.names] if is_complete else None
        if self._columns is None:
            self.num_lacking += 1
            return None
        return array('d', [values[column] for column in self._columns])
