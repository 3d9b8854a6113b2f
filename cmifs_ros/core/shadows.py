"""Shadows: sensors made uninformative by exchanging their trajectories between the episodes.

The idea is that of Boruta (Kursa & Rudnicki, Feature selection with the Boruta package, 2010).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy import special

from .samples import Samples
from .search import Criterion

#: Shadows for each place of the ranking.
_NUM_SHADOWS = 6
#: 5 %, median and 95 % of one more, in standard deviations of these: a prediction interval of a
#: normal law whose mean and deviation are estimated, mean +- t(0.95, n - 1) sqrt(1 + 1/n) s.
_FACTOR = special.stdtrit(_NUM_SHADOWS - 1, 0.95) * np.sqrt(1 + 1 / _NUM_SHADOWS)
_BAND = np.array([-_FACTOR, 0.0, _FACTOR])


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


def null_scores(
    make_criterion: Callable[[Samples], Criterion],
    samples: Samples,
    channels: Sequence[int],
    places: Sequence[Sequence[int]],
    rng: np.random.Generator,
) -> np.ndarray:
    """Return the scores that uninformative sensors have beside others.

    Of channels drawn at random whole trajectories change places: neighbouring steps are not
    independent of each other, and a shadow keeps its course in time.

    Parameters
    ----------
    make_criterion : callable
        Gives the criterion of samples.
    samples : Samples
    channels : sequence of int
        Those of which shadows are made.
    places : sequence of sequence of int
        The channels beside which a shadow is scored; the same ones are scored once.
    rng : numpy.random.Generator

    Returns
    -------
    numpy.ndarray, shape (len(places), 3)
        5 %, median and 95 % at each place: a further shadow lies within with probability 0.9,
        if the scores of shadows are normal.

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
    # Of equal places the criterion scores one.
    beside = ([[*given, first + i] for i in range(_NUM_SHADOWS)] for given in places)
    scores = [criterion(subsets) for subsets in beside]
    return np.array([of.mean() + of.std(ddof=1) * _BAND for of in scores])
