# SPDX-License-Identifier: Apache-2.0

"""The episodes of one recording, whatever it was written by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from cmifs_ros.core import Episode

from .traffic import Traffic


class RecordingError(Exception):
    """A recording cannot be used; the message says why."""


@dataclass(frozen=True)
class RecordedEpisodes:
    """What a recording holds of episodes.

    Attributes
    ----------
    channel_names : tuple of str
    episodes : list of Episode
    num_read : int
        Messages read of the topics that were asked for; steps where each row is one.
    action_names : tuple of str
        Of the values of the episodes' actions; empty without any.
    stamps : list of numpy.ndarray of int, shape (T,), or None
        When the steps of each episode were, in nanoseconds; None if the recording does not say.
    step_seconds : float
        From one step to the next, where there are no stamps; NaN if not known.
    num_between : int
        Steps that belong to no episode, as what had ended the one before still held.
    num_cut : int
        Episodes closed at their greatest length.
    num_open_steps : int
        Steps after the last end.
    dropped : mapping of str to int
        How many messages, steps and episodes were dropped, by cause; causes first, then what
        follows from them.
    unreadable : mapping of str to str
        Topics or columns that cannot be read, none of them asked for, and why.
    traffic : Traffic
        Of the topics that were asked for, by their names in the robot file.
    unit : str
        What `num_read` counts: `message` or `step`.
    no_rewards : str
        Why there are no rewards; empty if there are.

    """

    channel_names: tuple[str, ...]
    episodes: list[Episode]
    num_read: int
    action_names: tuple[str, ...] = ()
    stamps: list[np.ndarray] | None = None
    step_seconds: float = float('nan')
    num_between: int = 0
    num_cut: int = 0
    num_open_steps: int = 0
    dropped: Mapping[str, int] = field(default_factory=dict)
    unreadable: Mapping[str, str] = field(default_factory=dict)
    traffic: Traffic = field(default_factory=Traffic)
    unit: str = 'message'
    no_rewards: str = ''

    @property
    def distances(self) -> np.ndarray:
        """The known times from one step to the next, in nanoseconds."""
        if self.stamps is None:
            found = np.full(sum(len(episode) - 1 for episode in self.episodes), self.step_seconds)
            return found[np.isfinite(found)] * 1e9
        return np.concatenate([np.diff(stamps) for stamps in self.stamps] or [np.empty(0)])
