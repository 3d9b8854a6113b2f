# SPDX-License-Identifier: Apache-2.0

"""Read states into the values of known channels, in one order and all finite."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Callable, Sequence
from math import inf, isfinite, isinf, isnan

import numpy as np

from cmifs_ros.core.channel_names import problem_of_names
from cmifs_ros.core.words import counted, listed

#: States that are checked together: one at a time would take as long as everything else.
_UNSEEN = 64


class StateReader:
    """Read states by the names of their channels.

    An infinite value is a reading out of range (REP 117): +inf is replaced by `inf_value`, -inf by
    the least value of the channel so far. NaN is a gap: the previous value is held for up to
    `max_hold_steps` states; after that the state is unusable.

    Parameters
    ----------
    drop : callable
        Called with the cause and a message for each unusable state.

    Attributes
    ----------
    channel_names : tuple of str or None
        Required channels, in any order; set them before reading the first state.
    max_hold_steps : int
        Consecutive states over which a gap is bridged; 0: none.
    inf_value : float
        Replaces +inf; `inf` means the greatest value of the channel so far.
    num_states : int
        Number of states with the known channels.
    gaps : collections.Counter
        Number of these without a usable value, by channel.
    foreign : list of str
        The channels of the newest state if they are not the known ones; otherwise empty.
    last_foreign : list of str
        The channels in which the last such state differed.
    num_switches : int
        How often such a state followed one with the known channels.

    """

    def __init__(self, drop: Callable[[str, str], None]):
        self._drop = drop
        self.max_hold_steps = 0
        self.inf_value = inf
        self.clear()

    def clear(self) -> None:
        """Forget the channels and their counts."""
        self.channel_names: tuple[str, ...] | None = None
        self.num_states = 0
        self.gaps: Counter[str] = Counter()
        self.foreign: list[str] = []
        self.last_foreign: list[str] = []
        self.num_switches = 0
        self._layout: list[str] = []
        self._columns: list[int] | None = None
        self._last: array | None = None
        self._held: Counter[int] = Counter()
        self._bounds: tuple[np.ndarray, np.ndarray] | None = None
        self._unseen: list[Sequence[float]] = []  # states not yet included in the bounds

    def state_of(self, names: list[str], values: array) -> array | None:
        """Return the values in the order of the channels, or None if they cannot be used."""
        if len(names) != len(values) or not names:
            self._drop(*problem_of_state(names, values))
            return None
        if names != self._layout and not self._learn_layout(names):
            return None
        self.foreign = []
        if self._columns is not None:
            values = array('d', [values[column] for column in self._columns])
        self.num_states += 1
        # One value that is not finite makes the sum not finite; huge values may, too.
        if not isfinite(sum(values)) and not all(map(isfinite, values)):
            values = self._mended(names, values)
            if values is None:
                return None
        else:
            self._held.clear()
            self._unseen.append(values)
            if len(self._unseen) >= _UNSEEN:
                self._widen_bounds()
        self._last = values
        return values

    def _learn_layout(self, names: list[str]) -> bool:
        """Look up the names of a state; the next states mostly have the same, in the same order."""
        columns = None
        if tuple(names) != self.channel_names:
            if len(names) != len(self.channel_names) or set(names) != set(self.channel_names):
                known = set(self.channel_names)
                odd = (
                    sorted(set(names) - known) or sorted(known - set(names)) or ['a repeated name']
                )
                self.num_switches += not self.foreign
                self.foreign, self.last_foreign = names, odd
                self._drop(
                    'wrong_channels',
                    f'a state differs from the {counted(len(self.channel_names), "known channel")} '
                    f'by {listed(odd)}',
                )
                return False
            column_of = {name: column for column, name in enumerate(names)}
            columns = [column_of[name] for name in self.channel_names]
        self._layout, self._columns = names, columns
        return True

    def _mended(self, names: Sequence[str], values: array) -> array | None:
        names = self.channel_names or names
        finite = np.array(values)
        finite[~np.isfinite(finite)] = np.nan
        self._unseen.append(finite)
        least, greatest = self._widen_bounds()
        mended, gaps = array('d', values), []
        for channel, value in enumerate(values):
            if value == inf:
                mended[channel] = greatest[channel] if self.inf_value == inf else self.inf_value
            elif value == -inf:
                mended[channel] = least[channel]
            if isnan(mended[channel]):
                gaps.append(channel)
                self.gaps[names[channel]] += 1
        self._held = Counter({channel: self._held[channel] + 1 for channel in gaps})
        for channel in gaps:
            if self._last is None or self._held[channel] > self.max_hold_steps:
                share = self.gaps[names[channel]] / self.num_states
                remedy = 'inf_value' if isinf(values[channel]) else 'max_hold_steps'
                self._drop(
                    'not_finite',
                    f'channel {listed([names[channel]])} is {values[channel]}, as {share:.1%} of '
                    f'its values so far ({remedy} can bridge it)',
                )
                return None
            mended[channel] = self._last[channel]
        return mended

    def _widen_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the least and greatest finite value of each channel; nan if there is none."""
        states = np.array(self._unseen)
        self._unseen = []
        least, greatest = np.fmin.reduce(states), np.fmax.reduce(states)
        if self._bounds is not None:
            least, greatest = np.fmin(least, self._bounds[0]), np.fmax(greatest, self._bounds[1])
        self._bounds = least, greatest
        return self._bounds


def problem_of_state(names: Sequence[str], values: Sequence[float]) -> tuple[str, str] | None:
    """Return the cause and a message if a state is unusable with any channels."""
    if len(names) != len(values) or not names:
        values_for_names = f'{counted(len(values), "value")} for {counted(len(names), "name")}'
        return 'wrong_length', f'a state has {values_for_names}'
    problem = problem_of_names(names)
    return ('wrong_channels', f'a state has {problem}') if problem else None
