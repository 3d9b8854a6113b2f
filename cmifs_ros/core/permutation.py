"""Does the return depend on any sensor at all? Compared with what sensors said elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .conditional_mi_selector import ConditionalMISelector
from .episode import Episode, as_episodes
from .shadows import exchange


class PermutationTest(NamedTuple):
    """Result of a permutation test; the names are SciPy's.

    Attributes
    ----------
    statistic : float
        The best score that a single sensor has.
    pvalue : float
        (1 + number of permutations whose statistic is no smaller) / (1 + number of permutations).
    null_distribution : numpy.ndarray, shape (n_permutations,)
        The statistic of each permutation.

    """

    statistic: float
    pvalue: float
    null_distribution: np.ndarray


def permutation_test(
    selector: ConditionalMISelector,
    episodes,
    names: Sequence[str] | None = None,
    *,
    n_permutations: int = 99,
) -> PermutationTest:
    """Test whether the return depends on any single sensor.

    The statistic is the score of the best sensor, the first of a forward selection. All
    trajectories of states change places between the episodes, as wholes and all channels
    together; the rewards stay. If the return is independent of the states, all of that is
    equally likely, and the p-value is uniform on 1/(n + 1), 2/(n + 1), ..., 1. With
    unequal lengths, which `shadows.exchange` copes with, that holds if the length is
    independent of the states too.

    Parameters
    ----------
    selector : ConditionalMISelector
        Its settings make the score. It need not be fitted, and stays as it is.
    episodes, names
        As of `ConditionalMISelector.fit`.
    n_permutations : int
        Each costs one round of the search; the p-value is at least 1 / (n_permutations + 1).

    Raises
    ------
    ValueError
        If a parameter or the data are not as described; the message names the value.

    """
    if n_permutations < 1:
        raise ValueError(f'n_permutations is {n_permutations}; expected at least 1')
    episodes = as_episodes(episodes)

    def best_score(states):
        pairs = zip(states, episodes, strict=True)
        exchanged = [Episode(s, episode.rewards) for s, episode in pairs]
        return float(selector.single_scores(exchanged, names).max())

    rng = np.random.default_rng([selector.random_state, 2])
    states = [episode.states for episode in episodes]
    statistic = best_score(states)
    null = np.array([best_score(exchange(states, rng)) for _ in range(n_permutations)])
    pvalue = (1 + int((null >= statistic).sum())) / (1 + n_permutations)
    return PermutationTest(statistic, pvalue, null)
