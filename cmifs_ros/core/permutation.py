"""A permutation test of whether the return depends on any sensor at all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from .episode import Episode
from .search import Criterion, Sensor
from .shadows import exchange

MakeCriterion = Callable[[list[Episode]], Criterion]


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
    make_criterion: MakeCriterion,
    episodes: Sequence[Episode],
    sensors: Sequence[Sensor],
    n_permutations: int,
    random_state: int,
) -> PermutationTest:
    """Test whether the return depends on any single sensor.

    See `ConditionalMISelector.permutation_test`.
    """

    def best_score(states):
        pairs = zip(states, episodes, strict=True)
        criterion = make_criterion([Episode(s, episode.rewards) for s, episode in pairs])
        return float(criterion(sensors).max())

    rng = np.random.default_rng([random_state, 2])
    states = [episode.states for episode in episodes]
    statistic = best_score(states)
    null = np.array([best_score(exchange(states, rng)) for _ in range(n_permutations)])
    pvalue = (1 + int((null >= statistic).sum())) / (1 + n_permutations)
    return PermutationTest(statistic, pvalue, null)
