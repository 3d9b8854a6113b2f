# SPDX-License-Identifier: Apache-2.0

"""The rows of samples in a test, and how the episodes they belong to may be compared."""

from __future__ import annotations

import numpy as np

from .cyclic_shifts import CyclicShifts
from .drift import cosines, independent_episodes
from .kernel_regression import extended
from .samples import Samples, standardized

_NUM_FOLDS = 5
#: From fewer blocks of episodes no error can be estimated.
_FEWEST_BLOCKS = 5
#: Cosines of the step in every regression. The step is all that an irrelevant sensor and the return
#: have in common, so its effect on either may have any smooth shape.
_NUM_STEP_COSINES = 6


class EpisodeRows:
    """The rows of samples, in the order of their episodes.

    Parameters
    ----------
    samples : Samples
    random_state : int
        Seed of folds, centres and, where it means nothing, the order of the episodes.
    ordered : bool
        Whether the order of the episodes is that of time.

    Attributes
    ----------
    states, actions : numpy.ndarray, shapes (N, v), (N, a)
    step : numpy.ndarray, shape (N,)
    owner : numpy.ndarray of int, shape (N,)
        The episode of each row.
    starts, lengths : numpy.ndarray of int, shape (M,)
        The first row and the number of rows of each episode.
    folds : numpy.ndarray of int, shape (N,)
        Cross-validation folds of whole episodes.
    shuffled : numpy.ndarray of int, shape (N,)
        All rows in random order, to draw centres from.
    step_cosines : numpy.ndarray, shape (N, k)
        Slow cosines of the step.
    fixed : numpy.ndarray, shape (N, p)
        Orthonormal columns of fixed effects: a mean for each source, and slow cosines of the step.
    shifts : CyclicShifts

    """

    def __init__(self, samples: Samples, random_state: int, ordered: bool):
        rng = np.random.default_rng([random_state, 1])
        self.states = standardized(samples.states)
        self.actions = standardized(samples.actions)
        self.step = standardized(samples.step.astype(float))
        is_same = np.diff(samples.owner, append=-1) == 0
        self._gaps = np.where(is_same, np.diff(samples.step, append=0), np.inf)[:, None]
        present, self.owner = np.unique(samples.owner, return_inverse=True)
        self.starts = np.flatnonzero(np.diff(self.owner, prepend=-1))
        self.lengths = np.diff(self.starts, append=len(self.owner))
        num_episodes = len(present)
        num_folds = min(_NUM_FOLDS, num_episodes)
        self.folds = (rng.permutation(num_episodes) * num_folds // num_episodes)[self.owner]
        self.shuffled = rng.permutation(len(self.owner))
        sources = _pooled(samples.sources[present])
        columns = (sources[self.owner, None] == np.unique(sources)).astype(float)
        means = columns / np.sqrt(columns.sum(axis=0))
        self.step_cosines = _step_cosines(samples.step)
        self.fixed = extended(means, self.step_cosines)
        self.is_ordered = ordered
        order = np.arange(num_episodes) if ordered else rng.permutation(num_episodes)
        self.shifts = CyclicShifts(self.starts, self.lengths, sources, order, rng)

    def means(self, values: np.ndarray) -> np.ndarray:
        """Return the mean of values (N, k) in each episode: shape (M, k)."""
        return np.add.reduceat(values, self.starts) / self.lengths[:, None]

    def starts_of_blocks(self, values: np.ndarray) -> np.ndarray:
        """Return the first row of each block of episodes that resemble each other in values (N, k).

        A block is so many neighbouring episodes as count as one, by the column in which they
        resemble each other most. If they do not, or their order means nothing, it is an episode.
        """
        count = len(self.starts)
        if not self.is_ordered:
            return self.starts
        worth = min(independent_episodes(means) for means in self.means(values).T)
        size = int(np.ceil(count / worth))
        return self.starts[:: min(size, max(count // _FEWEST_BLOCKS, 1))]

    def differences(self, values: np.ndarray, discount: float) -> np.ndarray:
        """Return values (N, k) less the discounted ones of the next row; none follows the last."""
        following = np.append(values[1:], np.zeros_like(values[:1]), axis=0)
        return values - np.where(self._gaps < np.inf, discount**self._gaps, 0.0) * following


def _step_cosines(step: np.ndarray) -> np.ndarray:
    """Return slow cosines of the steps' ranks: late steps, which few episodes reach, share one."""
    steps, which, counts = np.unique(step, return_inverse=True, return_counts=True)
    place = (np.cumsum(counts) - counts / 2) / len(step)
    return cosines(place, min(_NUM_STEP_COSINES, len(steps) - 1))[which]


def _pooled(sources: np.ndarray) -> np.ndarray:
    """Return the sources; those of a single episode, which has nothing beside it, are one."""
    names, which, counts = np.unique(sources, return_inverse=True, return_counts=True)
    return np.where(counts[which] > 1, names[which], '')
