# SPDX-License-Identifier: Apache-2.0

"""Detect covariate shift: whether new data still resemble those a selection was made from."""

from __future__ import annotations

import numpy as np

from cmifs_ros.core import Episode
from cmifs_ros.core.selection import Selection

#: A channel has shifted if its mean moved by more than this many spreads of the selection,
MAX_SHIFT = 1.0
#: or if its spread around the old mean grew by more than this factor.
MAX_SPREAD = 2.0


class Drift:
    """Compare the newest episodes with those of a selection, channel by channel.

    What drifts steadily, such as a battery that drains, has a large spread: it has shifted only if
    it went further than in the data of the selection. New episodes are averaged with exponentially
    decaying weights, so a sudden change is detected no matter how many episodes came before it.

    Parameters
    ----------
    selection : Selection
    horizon : int
        Number of episodes over which the weights decay. No change is reported before that many.

    """

    def __init__(self, selection: Selection, horizon: int):
        self._means = np.array(selection.means)
        # A constant channel has shifted as soon as it has another value.
        rounding = 1e-9 * np.abs(self._means)
        self._spreads = np.maximum(selection.spreads, np.maximum(rounding, np.finfo(float).tiny))
        self._horizon = horizon
        self._count = 0
        self._shift = np.zeros(len(self._means))
        self._square = np.zeros(len(self._means))

    def add(self, episode: Episode) -> None:
        """Add a new episode; one with another number of channels is ignored."""
        values = np.column_stack([episode.states, episode.rewards])
        if values.shape[1] != len(self._means):
            return
        with np.errstate(over='ignore', invalid='ignore'):
            # Clipped so that squares stay finite.
            scaled = np.clip((values - self._means) / self._spreads, -1e6, 1e6)
            self._count += 1
            weight = 1 / min(self._count, self._horizon)
            self._shift += weight * (scaled.mean(axis=0) - self._shift)
            self._square += weight * ((scaled**2).mean(axis=0) - self._square)

    def changed(self) -> list[int]:
        """Return the indices of the channels that have shifted; v stands for the reward."""
        if self._count < self._horizon:
            return []
        has_moved = (np.abs(self._shift) > MAX_SHIFT) | (self._square > MAX_SPREAD**2)
        return np.flatnonzero(has_moved).tolist()
