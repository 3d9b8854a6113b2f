# SPDX-License-Identifier: Apache-2.0

"""What is known of a recording without its steps, which may stay where they were read."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from cmifs_ros.core.fingerprints import fingerprint, fingerprints_of_rows

from .recorded_episodes import RecordedEpisodes


@dataclass(frozen=True)
class Outline:
    """A recording of M episodes, without their steps.

    Attributes
    ----------
    recording : RecordedEpisodes
        Without episodes and stamps.
    lengths : numpy.ndarray of int, shape (M,)
        Number of steps of each episode.
    is_acting : numpy.ndarray of bool, shape (M,)
        Whether each has actions.
    prints : list of bytes
        The fingerprint of each.
    begin, end : float
        Times of the first and the last step, in nanoseconds; inf if unknown.
    num_distances : int
        Number of known times between steps.
    distance : float
        Their median, in nanoseconds; NaN if there is none.

    """

    recording: RecordedEpisodes
    lengths: np.ndarray
    is_acting: np.ndarray
    prints: list[bytes]
    begin: float
    end: float
    num_distances: int
    distance: float

    def __len__(self) -> int:
        """Return the number of episodes M."""
        return len(self.lengths)


class Trace(NamedTuple):
    """When the steps of a recording were, and what they were.

    Attributes
    ----------
    owner : numpy.ndarray of int, shape (T,)
        The episode of each step.
    stamps : numpy.ndarray of int, shape (T,)
        Its time, in nanoseconds.
    prints : numpy.ndarray of int, shape (T,)
        The fingerprint of its state.

    """

    owner: np.ndarray
    stamps: np.ndarray
    prints: np.ndarray


def outline_of(recording: RecordedEpisodes) -> Outline:
    """Return the outline of a recording."""
    episodes, stamps, distances = recording.episodes, recording.stamps, recording.distances
    return Outline(
        replace(recording, episodes=[], stamps=None),
        np.array([len(episode) for episode in episodes], dtype=int),
        np.array([episode.actions.size > 0 for episode in episodes], dtype=bool),
        [fingerprint(episode) for episode in episodes],
        min((float(of_one[0]) for of_one in stamps or ()), default=np.inf),
        max((float(of_one[-1]) for of_one in stamps or ()), default=np.inf),
        len(distances),
        float(np.median(distances)) if len(distances) else np.nan,
    )


def trace_of(recording: RecordedEpisodes) -> Trace:
    """Return the trace of a recording with stamps."""
    stamps = recording.stamps or []
    return Trace(
        np.repeat(np.arange(len(stamps)), [len(of_one) for of_one in stamps]),
        np.concatenate(stamps),
        np.concatenate([fingerprints_of_rows(episode.states) for episode in recording.episodes]),
    )
