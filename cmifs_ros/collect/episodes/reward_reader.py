# SPDX-License-Identifier: Apache-2.0

"""Read reward messages by the names of their fields."""

from __future__ import annotations

from array import array
from math import isfinite

from cmifs_ros.collect.discount import Discount
from cmifs_ros.core.targets import TARGETS
from cmifs_ros.core.words import counted, listed

from .builder import RewardSample


class RewardReader:
    """Read reward messages; fast if the fields are in the order of the previous message.

    Only `reward` is required. The fields of `RewardSample` and `Discount`, and `target`, are
    used; others are ignored.

    Attributes
    ----------
    discount : Discount or None
        Discount of the newest message, if any.
    target : str or None
        Target of the newest message, if any; messages contain its index in `TARGETS`.

    """

    def __init__(self):
        self.discount: Discount | None = None
        self.target: str | None = None
        self._names: list[str] | None = None
        self._columns: list[int | None] = []
        self._discount_columns: dict[str, int] = {}
        self._target_column: int | None = None

    def sample_of(self, names: list[str], values: array) -> RewardSample:
        """Return the sample from a message's names and values.

        Raises
        ------
        ValueError
            If their numbers differ, `reward` is missing, a field is not finite, or the target is
            unknown.

        """
        if len(names) != len(values):
            positions = counted(len(values), 'position')
            raise ValueError(f'{positions} for {counted(len(names), "name")}; expected as many')
        if names != self._names:
            column_of = {name: column for column, name in enumerate(names)}
            if 'reward' not in column_of:
                raise ValueError(
                    f'fields are {listed(names) or "none"}; expected reward among them'
                )
            self._discount_columns = {
                field: column_of[field] for field in ('gamma', 'half_life') if field in column_of
            }
            self._target_column = column_of.get('target')
            self._columns = [column_of.get(field) for field in RewardSample._fields]
            self._names = names
        # One value that is not finite makes the sum not finite; huge values may, too.
        if not isfinite(sum(values)):
            for name, value in zip(names, values, strict=True):
                if not isfinite(value):
                    raise ValueError(f'{listed([name])} is {value}; expected a finite number')
        if self._discount_columns:
            self.discount = Discount(**{f: values[c] for f, c in self._discount_columns.items()})
        if self._target_column is not None:
            self.target = _target_of(values[self._target_column])
        reward, terminated, truncated, episode, step = self._columns
        return RewardSample(
            values[reward],
            None if terminated is None else bool(values[terminated]),
            None if truncated is None else bool(values[truncated]),
            None if episode is None else int(values[episode]),
            None if step is None else int(values[step]),
        )


def _target_of(number: float) -> str:
    if number not in range(len(TARGETS)):
        known = ', '.join(f'{i} ({target})' for i, target in enumerate(TARGETS))
        raise ValueError(f'target is {number:g}; expected {known}')
    return TARGETS[int(number)]
