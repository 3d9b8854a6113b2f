"""What episodes have of those before them: a floor gets wet, a policy learns, a motor warms up.

Where a task drifts, its returns are alike from episode to episode, and so are the readings of any
slow sensor, whether these have to do with each other or not. To a test that takes episodes for
independent that is evidence. Therefore what is left of the return is first freed of slow waves and
of what the past foretells (prewhitening: Cochrane & Orcutt, Application of least squares regression
to relationships containing auto-correlated error terms, 1949; the first episode after Prais &
Winsten, Trend estimators and serial correlation, 1954). How much of these there is, the data say
(Akaike's criterion for small samples, but stricter: Hurvich & Tsai, Regression and time series
model selection in small samples, 1989); where episodes are independent it is mostly nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import ndimage

#: An episode is like those before it in level, slope and curvature over its steps.
_NUM_SHAPES = 3
#: Keeps the shapes of episodes of few steps small.
_RIDGE = 0.05
#: How many slow waves there may be, and over how many episodes the past may be averaged.
_WAVES = (0, 1, 2, 4, 8)
_MEMORIES = (0, 1, 3, 9)
#: Where there is drift, a sensor is looked at without as many of its slowest waves.
_WAVES_OF_SENSOR = 2
#: Cost of a wave or a share; by Akaike's, 2, too much is taken off what does not drift.
_PENALTY = 3.0
_TINY = 1e-100


class Memory(NamedTuple):
    """How many slow waves there are; over how many episodes the past is averaged, and its share."""

    waves: int = 0
    episodes: int = 0
    share: float = 0.0


class Episodes:
    """Rows of episodes, to be freed of what these have of each other.

    Parameters
    ----------
    step : numpy.ndarray, shape (N,)
        The step of each row, standardised; the rows of an episode stand together, and the episodes
        in the order in which they came.
    starts : numpy.ndarray, shape (M,)
        The first row of each episode.

    """

    def __init__(self, step: np.ndarray, starts: np.ndarray):
        self._starts = starts
        self._lengths = np.diff(starts, append=len(step))
        self._weights = self._lengths / self._lengths.mean()
        self._shapes = np.polynomial.hermite_e.hermevander(step, _NUM_SHAPES - 1)
        gram = self._mean(self._shapes[:, :, None] * self._shapes[:, None, :])
        self._gram = gram + _RIDGE * np.eye(_NUM_SHAPES)

    def memories(self, values: np.ndarray) -> list[Memory]:
        """Return the memory of each shape that all columns of values (N, k) have in common."""
        of_shapes = np.moveaxis(self._parts(values), 1, 0)
        return [memory_of(parts, self._weights, _WAVES) for parts in of_shapes]

    def freed(self, values: np.ndarray, memories: list[Memory]) -> np.ndarray:
        """Return values (N, k) without what the past foretells."""
        parts = self._parts(values)
        foretold = np.zeros_like(parts)
        for shape, memory in enumerate(memories):
            if any(memory):
                new = _without_waves(parts[:, shape], self._weights, memory.waves)
                new = innovations(new, self._weights, memory)
                foretold[:, shape] = parts[:, shape] - (new - new.mean(axis=0))
        of_rows = np.repeat(foretold, self._lengths, axis=0)
        return values - np.einsum('ns,nsk->nk', self._shapes, of_rows)

    def without_slowest(self, values: np.ndarray) -> np.ndarray:
        """Return values (N, k) without the slowest waves of the means of the episodes."""
        means = self._mean(values)
        slow = means - _without_waves(means, self._weights, _WAVES_OF_SENSOR)
        return values - np.repeat(slow, self._lengths, axis=0)

    def _mean(self, values):
        """Return the mean over the rows of each episode."""
        counts = self._lengths.reshape(-1, *[1] * (values.ndim - 1))
        return np.add.reduceat(values, self._starts) / counts

    def _parts(self, values):
        """Return how much of each shape each episode's values (N, k) have: (M, shapes, k)."""
        return np.linalg.solve(self._gram, self._mean(self._shapes[:, :, None] * values[:, None]))


def memory_of(parts: np.ndarray, weights: np.ndarray, waves_tried=(0,)) -> Memory:
    """Return the memory that columns (M, k) have in common, which stand in the order of time."""
    parts = parts[:, np.ptp(parts, axis=0) > 0]
    if not parts.size:
        return Memory()
    best, least = Memory(), np.inf
    for waves in waves_tried:
        left = _without_waves(parts, weights, waves)
        scale = weights[:, None] / np.maximum(weights @ left**2, _TINY)
        for episodes in _MEMORIES:
            past = _average_of_past(left, weights, episodes)
            share = np.sum(scale * left * past) / max(np.sum(scale * past**2), _TINY)
            share = float(np.clip(share, 0, 1))
            squares = np.maximum(weights @ (left - share * past) ** 2, _TINY)
            count = waves + 2 * bool(episodes)
            cost = np.mean(np.log(squares)) + _PENALTY * count / max(len(parts) - count - 1, 1)
            if cost < least:
                best, least = Memory(waves, episodes, share), cost
    return best


def innovations(parts: np.ndarray, weights: np.ndarray, memory: Memory) -> np.ndarray:
    """Return columns (M, k) less the share of their past that comes again."""
    new = parts - memory.share * _average_of_past(parts, weights, memory.episodes)
    new[0] *= np.sqrt(1 - memory.share**2)
    return new


def _average_of_past(parts, weights, episodes):
    """Return for each episode the average (M, k) over those before it, the newest the most."""
    if not episodes:
        return np.zeros_like(parts)
    ago = np.arange(3 * episodes, -1, -1)
    fading = np.where(ago > 0, np.exp(-ago / episodes), 0.0)
    # The window of an episode ends with itself.
    options = {'axis': 0, 'mode': 'constant', 'origin': len(ago) - 1 - len(ago) // 2}
    total = ndimage.correlate1d(parts * weights[:, None], fading, **options)
    weight = ndimage.correlate1d(weights, fading, **options)
    return total / np.maximum(weight, _TINY)[:, None]


def _without_waves(parts, weights, waves):
    """Return columns (M, k) without their mean and their slowest cosines."""
    age = np.pi * (np.arange(len(parts)) + 0.5) / len(parts)
    cosines = np.cos(np.outer(age, np.arange(min(waves, len(parts) // 4) + 1)))
    weighted = cosines.T * weights
    return parts - cosines @ np.linalg.solve(weighted @ cosines, weighted @ parts)
