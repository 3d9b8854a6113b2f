# SPDX-License-Identifier: Apache-2.0

"""A permutation test of whether the return, or the action, depends on any sensor at all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from .episode import Episode, as_episodes
from .shadows import exchange


class Scorer(Protocol):
    """What the test needs of a selector, such as `ConditionalMISelector`."""

    random_state: int

    def single_scores(self, episodes, names: Sequence[str] | None = None) -> np.ndarray:
        """Return the score of each sensor alone: shape (S,)."""


class PermutationTest(NamedTuple):
    """Result of a permutation test, named as in SciPy.

    Attributes
    ----------
    statistic : float
        The best score of a single sensor.
    pvalue : float
        (1 + number of permutations whose statistic is no smaller) / (1 + number of permutations).
    null_distribution : numpy.ndarray, shape (n_permutations,)
        The statistic of each permutation.

    """

    statistic: float
    pvalue: float
    null_distribution: np.ndarray


def permutation_test(
    selector: Scorer,
    episodes,
    names: Sequence[str] | None = None,
    *,
    n_permutations: int = 99,
) -> PermutationTest:
    """Test whether the return depends on any single sensor; with the target 'action', the action.

    The statistic is the best score of a single sensor, the first of a forward selection. Whole
    trajectories of states, with all their channels, are permuted over the episodes; rewards and
    actions stay. If these are independent of the states, all permutations are equally likely, and
    the p-value is uniform on 1/(n + 1), 2/(n + 1), ..., 1. With unequal lengths (see
    `shadows.exchange`) this requires that the lengths are independent of the states too.

    Parameters
    ----------
    selector : ConditionalMISelector
        Its settings define the score. It need not be fitted, and is not changed.
    episodes, names
        As in `ConditionalMISelector.fit`.
    n_permutations : int
        Each costs one round of the search; the p-value is at least 1 / (n_permutations + 1).

    Raises
    ------
    ValueError
        If a parameter or the data are invalid; the message names the value.

    """
    if n_permutations < 1:
        raise ValueError(f'n_permutations is {n_permutations}; expected at least 1')
    episodes = as_episodes(episodes)

    def best_score(states):
        pairs = zip(states, episodes, strict=True)
        exchanged = [Episode(s, episode.rewards, episode.actions) for s, episode in pairs]
        return float(selector.single_scores(exchanged, names).max())

    rng = np.random.default_rng([selector.random_state, 2])
    states = [episode.states for episode in episodes]
    statistic = best_score(states)
    null = np.array([best_score(exchange(states, rng)) for _ in range(n_permutations)])
    pvalue = (1 + int((null >= statistic).sum())) / (1 + n_permutations)
    return PermutationTest(statistic, pvalue, null)
