# SPDX-License-Identifier: Apache-2.0

"""Fingerprints: small numbers that tell whether steps or episodes are the same."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from .episode import Episode

#: Number of steps in a run.
_RUN = 3
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


def fingerprint(episode: Episode) -> bytes:
    """Return the same 16 bytes for episodes of the same states, rewards and actions, else others.

    An error has a probability of about 2**-64 even among billions of episodes.
    """
    found = hashlib.blake2b(digest_size=16)
    for values in (episode.states, episode.rewards, episode.actions):
        found.update(repr(values.shape).encode())
        found.update(np.ascontiguousarray(values))
    return found.digest()


def first_of_each(prints: Sequence[bytes]) -> np.ndarray:
    """Return the indices of all but copies of earlier ones, in increasing order."""
    return np.sort(np.unique(np.array(prints), return_index=True)[1])


def fingerprints_of_rows(values: np.ndarray) -> np.ndarray:
    """Return a number for each row of values (N, k), equal for equal rows: shape (N,)."""
    return _of_rows((values + 0.0).view(np.uint64))  # There are two zeros.


def fingerprints_of_runs(values: np.ndarray) -> np.ndarray:
    """Return a number for each run of three of the rows of values (N, k): shape (N - 2,).

    It is 0 where the three are equal, as those of a robot at rest.
    """
    rows = fingerprints_of_rows(values)
    runs = np.column_stack([rows[i : len(rows) - _RUN + 1 + i] for i in range(_RUN)])
    return np.where((runs == runs[:, :1]).all(axis=1), np.uint64(0), _of_rows(runs))


def _of_rows(words: np.ndarray) -> np.ndarray:
    factors = _mixed(np.arange(1, words.shape[1] + 1, dtype=np.uint64) * _GOLDEN) | np.uint64(1)
    return _mixed((words * factors).sum(axis=1, dtype=np.uint64))


def _mixed(words: np.ndarray) -> np.ndarray:
    """Return words whose bits depend on all bits (splitmix64: Steele, Lea & Flood 2014)."""
    words = (words ^ (words >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    words = (words ^ (words >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return words ^ (words >> np.uint64(31))
