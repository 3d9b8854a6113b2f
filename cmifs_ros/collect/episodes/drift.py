"""Whether the data still look like those that a selection rests on."""

from __future__ import annotations

import numpy as np

from cmifs_ros.core import Episode
from cmifs_ros.core.selection import Selection

#: A channel has changed if its mean moved by more than this many standard deviations,
MAX_SHIFT = 1.0
#: or if its values spread, about the old mean, this many times as far.
MAX_SPREAD = 2.0


class Drift:
    """Compare the newest episodes with those of a selection, channel by channel.

    The newest are averaged with exponentially fading weights, so that a sudden change shows
    however many episodes came before it.

    Parameters
    ----------
    selection : Selection
    horizon : int
        Number of episodes over which the weights fade; before that many nothing is said.

    """

    def __init__(self, selection: Selection, horizon: int):
        self._means = np.array(selection.means)
        # A constant channel has changed as soon as it is another constant.
        rounding = 1e-9 * np.abs(self._means)
        self._spreads = np.maximum(selection.spreads, np.maximum(rounding, np.finfo(float).tiny))
        self._horizon = horizon
        self._count = 0
        self._shift = np.zeros(len(self._means))
        self._square = np.zeros(len(self._means))

    def add(self, episode: Episode) -> None:
        """Take a new episode; one with other channels is passed over."""
        values = np.column_stack([episode.states, episode.rewards])
        if values.shape[1] != len(self._means):
            return
        with np.errstate(over='ignore', invalid='ignore'):
            # Clipped, that squares stay finite.
            scaled = np.clip((values - self._means) / self._spreads, -1e6, 1e6)
            self._count += 1
            weight = 1 / min(self._count, self._horizon)
            self._shift += weight * (scaled.mean(axis=0) - self._shift)
            self._square += weight * ((scaled**2).mean(axis=0) - self._square)

    def changed(self) -> list[int]:
        """Return the channels that have changed; the one after the last is the reward."""
        if self._count < self._horizon:
            return []
        has_moved = (np.abs(self._shift) > MAX_SHIFT) | (self._square > MAX_SPREAD**2)
        return np.flatnonzero(has_moved).tolist()
