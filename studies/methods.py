"""The methods that are compared, by name, each with one way to call it."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np

from cmifs_ros.core import ConditionalMISelector, Episode, KDRSelector
from cmifs_ros.core.shadows import exchange
from studies.paper.alternatives import READINGS, rank_read
from studies.paper.direct_port import rank_directly

from .peers import ESTIMATORS, information_by_channel

#: The name of each method and what tables call it.
METHODS = {
    'kdr': 'KDR',
    'paper': "ours, set as in the paper ('paper')",
    'default': 'ours, default',
    'centers_25': 'ours, 25 centres',
    'centers_50': 'ours, 50 centres',
    'centers_all': 'ours, all centres',
    'ennemi': 'ennemi, a step and a channel at a time',
    'sklearn': 'scikit-learn, a step and a channel at a time',
    'direct_port': 'direct port',
    'paper_standardized': "'paper', standardised",
    'paper_program': "'paper', h'alpha/2 - 1/2",
    'paper_held_out': "'paper', held-out",
    'paper_held_out_standardized': "'paper', held-out, standardised",
    'kdr_own_widths': 'KDR, a width for each set',
    'kdr_scaled': 'KDR, eps times M',
    'automatic': 'ours, automatic number',
    'automatic_shuffled': 'ours, automatic number, states of other episodes',
}
#: The default with other bounds of the number of kernel centres.
NUM_CENTERS = {'centers_25': 25, 'centers_50': 50, 'centers_all': None}
#: What pip calls the packages that a method of the same name needs.
_PACKAGES = {'ennemi': 'ennemi', 'sklearn': 'scikit-learn'}


class Ranking(NamedTuple):
    """The channels ranked, best first, as indices from 0, and the score of each place.

    The peers score each channel by itself; the others score the first 1, 2, ... together. The
    automatic number ranks what it selects.
    """

    channels: tuple[int, ...]
    scores: tuple[float, ...]


def what_is_missing(method: str) -> str | None:
    """Return how to install the package that a method needs and that is not here, or None."""
    if method in _PACKAGES and find_spec(method) is None:
        return f'not installed: python3 -m pip install {_PACKAGES[method]}'
    return None


def rank(
    method: str,
    episodes: Sequence[Episode],
    *,
    target: Sequence[int],
    seed: int,
    num_features: int | None = None,
    n_jobs: int = 1,
) -> Ranking:
    """Rank the channels by one of the methods.

    Parameters
    ----------
    method : str
        One of `METHODS`.
    episodes : sequence of Episode
    target : sequence of int
        What KDR is told: the channels that the reward depends on directly.
    seed : int
        Of everything random in the method.
    num_features : int, optional
        How many channels to rank; None ranks all.
    n_jobs : int
        Threads of our engine and of ennemi. Those of the linear algebra are set from outside.

    """
    count = num_features or episodes[0].num_channels
    if method in ESTIMATORS:
        estimate = ESTIMATORS[method](seed, n_jobs)
        information = information_by_channel(episodes, estimate)
        best = np.argsort(-information, kind='stable')[:count]
        return Ranking(tuple(best.tolist()), tuple(information[best].tolist()))
    if method in ('automatic', 'automatic_shuffled'):
        if method == 'automatic_shuffled':  # The rewards stay: they depend on nothing.
            states = exchange([e.states for e in episodes], np.random.default_rng([seed, 3]))
            pairs = zip(states, episodes, strict=True)
            episodes = [Episode(s, episode.rewards) for s, episode in pairs]
        selector = ConditionalMISelector(random_state=seed, n_jobs=n_jobs).fit(episodes)
        selected = selector.ranking_[: selector.num_features_]
        return Ranking(tuple(selected.tolist()), tuple(selector.scores_[: len(selected)].tolist()))
    if method in READINGS:
        ranking, scores = rank_read(method, episodes, target, seed, count)
        return Ranking(tuple(ranking), tuple(scores))
    if method == 'direct_port':
        ranking, scores = rank_directly(episodes, count, random_state=seed)
        return Ranking(tuple(ranking), tuple(scores))
    if method == 'kdr':
        selector = KDRSelector(count, target=target, random_state=seed)
    elif method == 'paper':
        selector = ConditionalMISelector.paper(count, random_state=seed, n_jobs=n_jobs)
    else:
        options = {'num_centers': NUM_CENTERS[method]} if method in NUM_CENTERS else {}
        selector = ConditionalMISelector(count, random_state=seed, n_jobs=n_jobs, **options)
    selector.fit(episodes)
    return Ranking(tuple(selector.ranking_.tolist()), tuple(selector.scores_.tolist()))


def rank_sum(ranking: Sequence[int], relevant: Sequence[int], num_channels: int) -> float:
    """Return the sum of the ranks, from 1, of the relevant channels.

    A channel that was not ranked counts as if the rest followed in random order.
    """
    unranked = (len(ranking) + 1 + num_channels) / 2
    places = {channel: place for place, channel in enumerate(ranking, start=1)}
    return sum(places.get(channel, unranked) for channel in relevant)


def mean_and_error(values: Sequence[float]) -> tuple[float, float]:
    """Return mean and standard error; a single value has an error of 0."""
    values = np.array(values, dtype=float)
    if len(values) == 1:
        return float(values[0]), 0.0
    return float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values)))
