# SPDX-License-Identifier: Apache-2.0

"""The selection in use, its age, and how the data have changed since."""

from __future__ import annotations

import dataclasses
import time

from cmifs_ros.collect.episodes.drift import Drift
from cmifs_ros.core import Episode
from cmifs_ros.core.selection import Selection
from cmifs_ros.core.words import listed

#: Characters of a doubt: an attempt may have failed with a long error.
_MAX_DOUBT = 500


class SelectionInUse:
    """A selection that is applied until the next one.

    Parameters
    ----------
    selection : Selection
    channel_names : tuple of str
        The channels it was made from.
    selected_at : float
        By `time.monotonic`.
    cause : str
        What it was requested by.
    horizon : int
        Number of new episodes needed to detect a change in the data.

    Attributes
    ----------
    selection, channel_names, selected_at, cause : see above

    """

    def __init__(
        self,
        selection: Selection,
        channel_names: tuple[str, ...],
        *,
        selected_at: float,
        cause: str,
        horizon: int,
    ):
        self.selection, self.channel_names = selection, channel_names
        self.selected_at, self.cause = selected_at, cause
        self._horizon = horizon
        self._drift = Drift(selection, horizon)

    @property
    def age(self) -> float:
        """Seconds since it was made."""
        return time.monotonic() - self.selected_at

    @property
    def confirmed(self) -> tuple[str, ...]:
        """The sensors that stay confirmed until dispensable; none if its data were cleared."""
        return self.selection.confirmed if self.selection.means else ()

    @property
    def channels(self) -> tuple[str, ...]:
        """The selected channels, in the order of the state."""
        pairs = zip(self.selection.indices, self.selection.names, strict=True)
        return tuple(name for _, name in sorted(pairs))

    def add(self, episode: Episode) -> None:
        """Compare a new episode with those it was made from."""
        self._drift.add(episode)

    def forget_data(self) -> None:
        """Stop comparing, also after a restart: the episodes it was made from were cleared."""
        self.selection = dataclasses.replace(self.selection, means=(), spreads=())
        self._drift = Drift(self.selection, self._horizon)

    def doubt(self, attempt: str) -> str:
        """Return what speaks against it: that the data have changed, or the last attempt."""
        changed = self.changed()
        if not changed:
            return attempt[:_MAX_DOUBT]
        return f'the data have changed since the selection: {listed(changed)}'

    def changed(self) -> list[str]:
        """Return the channels, or 'the reward', whose distribution has changed."""
        names = (*self.channel_names, 'the reward')
        return [names[index] for index in self._drift.changed()]
