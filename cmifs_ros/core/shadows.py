# SPDX-License-Identifier: Apache-2.0

"""Shadows: artificial uninformative sensors, whose scores give the null band.

The idea is from Boruta (Kursa & Rudnicki, Feature selection with the Boruta package, 2010).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy import special

from .samples import Samples
from .search import Criterion

#: Number of shadows for each place of the ranking.
_NUM_SHADOWS = 6
#: 5 %, median and 95 % of a further shadow, in standard deviations of the shadows: the prediction
#: interval of a normal distribution with estimated mean and deviation,
#: mean +- t(0.95, n - 1) sqrt(1 + 1/n) s.
_FACTOR = special.stdtrit(_NUM_SHADOWS - 1, 0.95) * np.sqrt(1 + 1 / _NUM_SHADOWS)
_BAND = np.array([-_FACTOR, 0.0, _FACTOR])


def exchange(trajectories: Sequence[np.ndarray], rng: np.random.Generator) -> list[np.ndarray]:
    """Return the trajectories, arrays (T, v), randomly permuted over the episodes.

    Each episode keeps its length T. If a trajectory is shorter than its new episode, the trajectory
    that took its own place continues it, and so on. So each value is used exactly once and stays at
    its step. With equal lengths all trajectories remain whole.
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


def null_scores(
    make_criterion: Callable[[Samples], Criterion],
    samples: Samples,
    channels: Sequence[int],
    places: Sequence[Sequence[int]],
    rng: np.random.Generator,
) -> np.ndarray:
    """Return the scores of uninformative sensors in combination with given channels.

    A shadow is a randomly drawn channel whose whole trajectories are permuted over the episodes.
    This preserves the dependence between neighbouring steps.

    Parameters
    ----------
    make_criterion : callable
        Returns the criterion for given samples.
    samples : Samples
    channels : sequence of int
        The channels from which shadows are made.
    places : sequence of sequence of int
        For each place, the channels together with which a shadow is scored; equal places are
        scored once.
    rng : numpy.random.Generator

    Returns
    -------
    numpy.ndarray, shape (len(places), 3)
        5 %, median and 95 % at each place: a further shadow lies within this band with
        probability 0.9 if the scores of shadows are normal.

    """
    starts = np.flatnonzero(np.diff(samples.owner)) + 1
    rounds = -(-_NUM_SHADOWS // len(channels))
    drawn = np.concatenate([rng.permutation(channels) for _ in range(rounds)])[:_NUM_SHADOWS]
    shadows = [
        np.concatenate(exchange(np.split(samples.states[:, channel], starts), rng))
        for channel in drawn
    ]
    first = samples.states.shape[1]
    criterion = make_criterion(samples.with_channels(np.column_stack(shadows)))
    # The criterion caches equal subsets.
    beside = ([[*given, first + i] for i in range(_NUM_SHADOWS)] for given in places)
    scores = [criterion(subsets) for subsets in beside]
    return np.array([of.mean() + of.std(ddof=1) * _BAND for of in scores])
