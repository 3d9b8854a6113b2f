"""Does the return depend on a sensor? Compared with what sensors delivered in other episodes.

A *shadow* of a sensor has its values and their course in time, but those of other episodes, so
that the return has nothing to do with it. The idea of shadows is that of Boruta (Kursa &
Rudnicki, Feature selection with the Boruta package, 2010). Here whole episodes change places:
neighbouring steps of an episode are not independent of each other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats

from .episode import Episode
from .search import Criterion, Sensor, channels

#: A sensor that stands out has a p-value, corrected for the choice among many, of at most this ...
_LEVEL = 0.05
#: ... and where that is one among the shadows of all sensors, among its own at most this.
_OWN_LEVEL = 0.2
#: Own shadows of the first sensor, and of a further one; at least so many shadows of all.
_NUM_FIRST, _NUM_OWN, _NUM_ALL = 20, 10, 24
#: Spreads below this are of rounding.
_ROUNDING = 1e-6
#: Median absolute deviation of the standard Gumbel law, which SciPy does not tell.
_GUMBEL_MAD = 0.7670

MakeCriterion = Callable[[list[Episode]], Criterion]


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


def permutation_test(
    make_criterion: MakeCriterion,
    episodes: Sequence[Episode],
    sensors: Sequence[Sensor],
    n_permutations: int,
    random_state: int,
) -> PermutationTest:
    """Test whether the return depends on any single sensor.

    `ConditionalMISelector.permutation_test` tells how.
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


def num_beyond_shadows(
    make_criterion: MakeCriterion,
    episodes: Sequence[Episode],
    ranked: Sequence[Sensor],
    random_state: int,
) -> int:
    """Return how many sensors, the first of those ranked, do better than shadows.

    The first sensor has to stand out among its own shadows. Each further one has to stand out
    among shadows of all the sensors that it was chosen from, in the company of those ranked
    before it, and to do better than most of its own: a sensor that hardly varies costs less than
    noise, and so do its shadows. The first sensor that fails ends it.

    Parameters
    ----------
    make_criterion : callable
        Gives the criterion of some episodes. Channels that no subset names must not matter.
    episodes : sequence of Episode
    ranked : sequence of tuple of int
        The channels of each sensor, best first.
    random_state : int
        Seed of the shadows.

    Notes
    -----
    Being chosen among m sensors costs a factor of m (Bonferroni). The tails are approximations,
    chosen on the seeds 0 to 49 of the grid world; `permutation_test` needs none.

    """
    rng = np.random.default_rng([random_state, 1])

    def contest(sensors, count):
        extended, shadows = _with_shadows(episodes, sensors, count, rng)
        return make_criterion(extended), shadows

    for place, sensor in enumerate(ranked):
        before, left = channels(ranked, range(place)), ranked[place:]
        if place == 0:
            pvalue = _among_own(*contest([sensor], _NUM_FIRST), sensor, before)
            kept = pvalue * len(left) <= _LEVEL
        else:
            pvalue = _among_all(*contest(left, -(-_NUM_ALL // len(left))), sensor, before)
            kept = (
                pvalue * len(left) <= _LEVEL
                and _among_own(*contest([sensor], _NUM_OWN), sensor, before) <= _OWN_LEVEL
            )
        if not kept:
            return place
    return len(ranked)


def _with_shadows(episodes, sensors, count, rng) -> tuple[list[Episode], list[Sensor]]:
    """Return the episodes with the channels of `count` shadows of each sensor, and the shadows."""
    own = channels(sensors, range(len(sensors)))
    trajectories = [episode.states[:, own] for episode in episodes]
    copies = [exchange(trajectories, rng) for _ in range(count)]
    extended = [
        Episode(np.hstack([episode.states, *more]), episode.rewards)
        for episode, *more in zip(episodes, *copies, strict=True)
    ]
    new = iter(range(episodes[0].num_channels, extended[0].num_channels))
    return extended, [tuple(next(new) for _ in sensor) for _ in copies for sensor in sensors]


def _among_all(criterion, shadows, sensor, before) -> float:
    """Return the p-value of a sensor, together with those before it, among shadows of all.

    The tail is that of a Gumbel law. It is fitted by the median and the median absolute
    deviation, which are those of most sensors: few with greater scores do not move them.
    """
    own, *others = criterion([[*before, *rival] for rival in (sensor, *shadows)])
    scale = max(stats.median_abs_deviation(others) / _GUMBEL_MAD, _ROUNDING)
    location = np.median(others) - stats.gumbel_r.median() * scale
    return float(stats.gumbel_r.sf(own, location, scale))


def _among_own(criterion, shadows, sensor, before) -> float:
    """Return the p-value of a sensor, alone and with those before it, among its own shadows.

    Roots of the scores, standardised, are added up; roots, because the scores of one sensor that
    tells nothing are near 0 and very skewed. The tail is that of a Gumbel law with the mean and
    the standard deviation of the shadows.
    """
    evidence = np.zeros(1 + len(shadows))
    for company in [[], before] if before else [[]]:
        scores = criterion([[*company, *rival] for rival in (sensor, *shadows)])
        roots = np.sqrt(np.maximum(scores, 0))
        evidence += (roots - roots.mean()) / max(roots.std(), _ROUNDING)
    own, *others = evidence
    spread = np.std(others, ddof=1) * np.sqrt(1 + 1 / len(others))
    scale = max(spread / stats.gumbel_r.std(), _ROUNDING)
    location = np.mean(others) - stats.gumbel_r.mean() * scale
    return float(stats.gumbel_r.sf(own, location, scale))
