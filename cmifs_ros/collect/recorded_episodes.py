# SPDX-License-Identifier: Apache-2.0

"""The episodes of one recording of any kind."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from cmifs_ros.core import Episode
from cmifs_ros.core.words import counted, listed

from .episodes.end_counts import EndCounts
from .episodes.episode_check import Condition
from .traffic import Traffic


class RecordingError(Exception):
    """A recording cannot be read; the message says why."""


#: Returns a small grey picture for each step, given as episode and step, by reading the recording
#: again: shape (height, width), uint8; None where there is none.
Camera = Callable[[Sequence[tuple[int, int]]], Sequence[np.ndarray | None]]


@dataclass(frozen=True)
class RecordedEpisodes:
    """The episodes of a recording, and what was dropped.

    Attributes
    ----------
    channel_names : tuple of str
    episodes : list of Episode
    num_read : int
        Number of messages read from the requested topics, or of steps if each row is one.
    action_names : tuple of str
        Names of the values of an action; empty if there are no actions.
    stamps : list of numpy.ndarray of int, shape (T,), or None
        Times of the steps of each episode, in nanoseconds; None if unknown.
    step_seconds : float
        Time between steps, if there are no stamps; NaN if unknown.
    num_between : int
        Steps between episodes, while the end condition of the last one still held.
    num_cut : int
        Number of episodes closed at the greatest length.
    num_open_steps : int
        Number of steps after the last end.
    dropped : mapping of str to int
        Numbers of messages, steps and episodes dropped, by cause; causes come before their
        consequences.
    unreadable : mapping of str to str
        Topics or columns, none of them requested, that cannot be read, and why.
    traffic : Traffic
        Of the requested topics, by their names in the robot file.
    unit : str
        Unit of `num_read`: `message` or `step`.
    no_rewards : str
        Why there are no rewards; empty if there are.
    ends : mapping of Condition to collections.Counter
        How often the conditions that end episodes were true, false and unknown (None).
    topics : mapping of str to str
        The recorded topics by their names in the robot file.
    end_counts : EndCounts
        Episodes by kind of end, and how many of each kind were lost.
    cameras : mapping of str to Camera
        By sensor, what returns its pictures.
    notes : tuple of str
        What looks wrong.

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
    ends: Mapping[Condition, Counter[bool | None]] = field(default_factory=dict)
    topics: Mapping[str, str] = field(default_factory=dict)
    end_counts: EndCounts = field(default_factory=EndCounts)
    cameras: Mapping[str, Camera] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Return the counts and names, not the numbers."""
        dropped = [f'dropped {count}: {cause}' for cause, count in self.dropped.items()]
        counts = f'{counted(len(self.episodes), "episode")} of {counted(self.num_read, self.unit)}'
        said = [
            counts,
            f'channels {listed(self.channel_names)}',
            f'actions {listed(self.action_names) or "none"}',
            *dropped,
            *self.notes,
        ]
        return f'RecordedEpisodes({"; ".join(said)})'

    def __sizeof__(self) -> int:
        """Return the size in memory, by which a cluster decides what is too large to move."""
        return super().__sizeof__() + sum(episode.nbytes for episode in self.episodes)

    @property
    def distances(self) -> np.ndarray:
        """The known times between steps, in nanoseconds."""
        if self.stamps is None:
            found = np.full(sum(len(episode) - 1 for episode in self.episodes), self.step_seconds)
            return found[np.isfinite(found)] * 1e9
        return np.concatenate([np.diff(stamps) for stamps in self.stamps] or [np.empty(0)])
