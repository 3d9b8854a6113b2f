"""Shadows of a sensor: what it might have said if it told nothing about the return.

The idea of shadows is that of Boruta (Kursa & Rudnicki, Feature selection with the Boruta
package, 2010); exchanging among neighbours that of the local permutation test (Runge, Conditional
independence testing based on a nearest-neighbor estimator of conditional mutual information,
2018).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .samples import Samples

#: Among how many episodes, the nearest in what is given, a value changes places.
_NUM_NEIGHBOURS = 5
#: Least unexplained share of the variance with which a channel counts as no copy.
_LEAST_OWN_SHARE = 0.5


def exchange(trajectories: Sequence[np.ndarray], rng: np.random.Generator) -> list[np.ndarray]:
    """Return trajectories, arrays (T, v), that changed places at random.

    Each place keeps its length T. Where a trajectory ends before its new place does, it is
    continued by the one that took its own place, and so on: each value is used exactly once and
    stays at its step. With equal lengths all stay whole.
    """
    successor = rng.permutation(len(trajectories))
    lengths = np.array([len(trajectory) for trajectory in trajectories])
    exchanged = [np.empty_like(trajectory) for trajectory in trajectories]
    start = 0
    for end in np.unique(lengths):
        places = np.flatnonzero(lengths >= end)
        sources = successor[places]
        while (ended := lengths[sources] < end).any():
            sources[ended] = successor[sources[ended]]
        for place, source in zip(places, sources, strict=True):
            exchanged[place][start:end] = trajectories[source][start:end]
        start = end
    return exchanged


def whole_shadows(
    samples: Samples, channels: Sequence[int], count: int, rng: np.random.Generator
) -> np.ndarray:
    """Return the channels with whole trajectories exchanged: shape (count, N, len(channels)).

    Their course in time stays, since neighbouring steps are not independent of each other.
    """
    starts = np.flatnonzero(np.diff(samples.owner)) + 1
    trajectories = np.split(samples.states[:, list(channels)], starts)
    return np.stack([np.concatenate(exchange(trajectories, rng)) for _ in range(count)])


def local_shadows(
    samples: Samples,
    channels: Sequence[int],
    given: Sequence[int],
    count: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return the channels exchanged between like episodes: shape (count, N, len(channels)).

    At each step a value goes to one of the episodes that are nearest in the given channels,
    each used once where that is possible. What the sensor shares with the given ones stays, and
    all it tells beyond them is lost.
    """
    sources = np.tile(np.arange(len(samples.step)), (count, 1))
    order = np.argsort(samples.step, kind='stable')
    for rows in np.split(order, np.flatnonzero(np.diff(samples.step[order])) + 1):
        if len(rows) < 2:
            continue
        if len(given):
            points = samples.states[np.ix_(rows, given)]
            # A trace of chance decides between equal distances, as of a sensor of few values.
            jitter = rng.random((count, len(rows), len(rows)))
            picked = _pick(points, jitter, rng.random((count, len(rows))), _NUM_NEIGHBOURS)
        else:
            picked = rng.permuted(np.tile(np.arange(len(rows)), (count, 1)), axis=1)
        sources[:, rows] = rows[picked]
    values = samples.states[:, list(channels)]
    shared = _shared(values, samples.states[:, list(given)])
    return shared + (values - shared)[sources]


def _shared(values: np.ndarray, given: np.ndarray) -> np.ndarray:
    """Return what of each channel (N, k) is a linear function of those given (N, g), else 0.

    The neighbours of a sample lie some way off, and a copy of a given channel would lose that way.
    """
    design = np.column_stack([np.ones(len(given)), given])
    fitted = design @ np.linalg.lstsq(design, values, rcond=None)[0]
    explains = np.var(values - fitted, axis=0) < _LEAST_OWN_SHARE * np.var(values, axis=0)
    return np.where(explains, fitted, 0.0)


def _pick(points, jitter, priority, num_neighbours):
    from .local_exchange import pick  # Compiled code is loaded where it is used.

    return pick(np.ascontiguousarray(points), jitter, priority, num_neighbours)
