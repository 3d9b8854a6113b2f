# SPDX-License-Identifier: Apache-2.0

"""The methods to compare, by name, with one way to call them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np

from cmifs_ros.core import ConditionalMI, ConditionalMISelector, Episode, KDRSelector, Lsmi
from cmifs_ros.core.criterion import WIDTHS
from cmifs_ros.core.samples import step_samples
from cmifs_ros.core.search import forward_selection
from cmifs_ros.core.shadows import exchange
from cmifs_ros.core.statuses import DISPENSABLE

from .direct_port import rank_directly
from .forests import FORESTS
from .linear import linear_selection
from .peers import ESTIMATORS, information_by_channel
from .readings import READINGS, rank_read

#: The name of each method, and its name in tables.
METHODS = {
    'kdr': 'KDR',
    'paper': "ours, set as in the paper ('paper')",
    'default': 'ours, default',
    'score': 'ours, by the score alone',
    'score_as_port': 'ours, by the score alone, set as the port',
    'centers_25': 'ours, 25 centres',
    'centers_50': 'ours, 50 centres',
    'centers_all': 'ours, all centres',
    'ennemi': 'ennemi, a step and a channel at a time',
    'sklearn': 'scikit-learn, a step and a channel at a time',
    'forest': 'extra trees, permutation importance',
    'boruta': 'Boruta',
    'direct_port': 'direct port',
    'paper_standardized': "'paper', standardised",
    'paper_program': "'paper', h'alpha/2 - 1/2",
    'paper_held_out': "'paper', held-out",
    'paper_held_out_standardized': "'paper', held-out, standardised",
    'kdr_own_widths': 'KDR, a width for each set',
    'kdr_scaled': 'KDR, eps times M',
    'automatic': 'ours, automatic number',
    'automatic_shuffled': 'ours, automatic number, states of other episodes',
    'redundant': 'ours, what is redundant with what is confirmed',
    'dispensable': 'ours, what is dispensable',
    'linear': 'linear model, errors by episode',
}
#: Methods that rank only some of the sensors.
SELECTING = ('automatic', 'automatic_shuffled', 'redundant', 'dispensable', 'linear')
#: The default with other bounds of the number of kernel centres.
NUM_CENTERS = {'centers_25': 25, 'centers_50': 50, 'centers_all': None}
#: The estimators of rankings by the score alone: the default's, and that of the direct port.
ESTIMATORS_OF_SCORE = {'score': Lsmi(widths=WIDTHS, num_centers=50), 'score_as_port': Lsmi()}
#: Methods without sensors of several channels.
RANKED_BY_CHANNEL = (*ESTIMATORS_OF_SCORE, *READINGS, 'direct_port')
#: The package that a method needs, by its names in Python and in pip.
_PACKAGES = {
    'ennemi': ('ennemi', 'ennemi'),
    'sklearn': ('sklearn', 'scikit-learn'),
    'forest': ('sklearn', 'scikit-learn'),
    'boruta': ('boruta', 'boruta'),
}


class Ranking(NamedTuple):
    """The sensors ranked, best first, as indices from 0, and the score of each place.

    Without groups, sensors are channels. The peers score each sensor alone, the others the first 1,
    2, ... together. The automatic number ranks the selected sensors, `redundant` those that could
    replace some of them, `dispensable` the dispensable ones, and the linear model those with
    evidence. A method for channels only ranks a sensor by its first channel.
    """

    channels: tuple[int, ...]
    scores: tuple[float, ...]


def what_is_missing(method: str) -> str | None:
    """Return how to install the missing package of a method, or None."""
    if method in _PACKAGES:
        module, package = _PACKAGES[method]
        if find_spec(module) is None:
            return f'not installed: python3 -m pip install {package}'
    return None


def rank(
    method: str,
    episodes: Sequence[Episode],
    *,
    target: Sequence[int],
    seed: int,
    sensors: Mapping[str, tuple[int, ...]] | None = None,
    num_features: int | None = None,
    n_jobs: int = 1,
) -> Ranking:
    """Rank the sensors by one of the methods.

    Parameters
    ----------
    method : str
        One of `METHODS`.
    episodes : sequence of Episode
    target : sequence of int
        For KDR: the channels that the reward depends on directly.
    seed : int
        Seed of everything random in the method.
    sensors : mapping of str to tuple of int, optional
        Each sensor's channels, in the order of their first ones; without it, each channel is one.
    num_features : int, optional
        Number of sensors to rank; None ranks all.
    n_jobs : int
        Threads of this package and of ennemi; BLAS threads are set outside.

    """
    if sensors is None:
        sensors = {str(i): (i,) for i in range(episodes[0].num_channels)}
    parts = list(sensors.values())
    groups = {name: part for name, part in sensors.items() if len(part) > 1}
    count = num_features or len(parts)
    num_channels = episodes[0].num_channels if groups else count
    if method in ESTIMATORS:
        estimate = ESTIMATORS[method](seed, n_jobs)
        information = information_by_channel(episodes, estimate)
        return _by_score([max(information[list(part)]) for part in parts], count)
    if method in FORESTS:
        return _by_score(FORESTS[method](episodes, parts, seed, n_jobs), count)
    if method == 'linear':
        found = linear_selection(episodes, parts)
        return Ranking(tuple(found), (0.0,) * len(found))
    if method in SELECTING:
        return _selected(method, episodes, groups, seed, n_jobs)
    if method in RANKED_BY_CHANNEL:
        if method in READINGS:
            found = rank_read(method, episodes, target, seed, num_channels)
        elif method == 'direct_port':
            found = rank_directly(episodes, num_channels, random_state=seed)
        else:
            criterion = criterion_of(ESTIMATORS_OF_SCORE[method], episodes, seed, n_jobs)
            channels = [(channel,) for channel in range(episodes[0].num_channels)]
            found = forward_selection(criterion, channels, num_channels)
        return _of_sensors(*found, parts, count)
    if method == 'kdr':
        selector = KDRSelector(count, groups=groups, target=target, random_state=seed)
    elif method == 'paper':
        selector = ConditionalMISelector.paper(
            count, groups=groups, random_state=seed, n_jobs=n_jobs
        )
    else:
        options = {'num_centers': NUM_CENTERS[method]} if method in NUM_CENTERS else {}
        options |= {'groups': groups, 'random_state': seed, 'n_jobs': n_jobs}
        selector = ConditionalMISelector(None if count == len(parts) else count, **options)
    selector.fit(episodes)
    return Ranking(tuple(selector.ranking_.tolist()), tuple(selector.scores_.tolist()))


def _selected(method: str, episodes, groups, seed: int, n_jobs: int) -> Ranking:
    if method == 'automatic_shuffled':  # The rewards stay, so they are independent of the states.
        states = exchange([e.states for e in episodes], np.random.default_rng([seed, 3]))
        pairs = zip(states, episodes, strict=True)
        episodes = [Episode(s, e.rewards, source=e.source) for s, e in pairs]
    selector = ConditionalMISelector(groups=groups, random_state=seed, n_jobs=n_jobs)
    selector.fit(episodes)
    if method == 'redundant':
        places = [i for i, of in enumerate(selector.redundant_with_) if of]
    elif method == 'dispensable':
        places = [i for i, status in enumerate(selector.statuses_) if status == DISPENSABLE]
    else:
        places = range(selector.num_features_)
    return Ranking(
        tuple(int(selector.ranking_[i]) for i in places),
        tuple(float(selector.scores_[i]) for i in places),
    )


def criterion_of(estimator: Lsmi, episodes, seed: int, n_jobs: int = 1) -> ConditionalMI:
    """Return the ranking criterion of the default, with another estimator."""
    steps = step_samples(
        episodes,
        gamma=0.95,
        standardize=True,
        max_time_bins=32,
        num_folds=estimator.num_folds,
        num_centers=estimator.num_centers,
        random_state=seed,
    )
    return ConditionalMI(steps, estimator, tuning_window=2, n_jobs=n_jobs)


def _by_score(scores: Sequence[float], count: int) -> Ranking:
    best = np.argsort(-np.asarray(scores), kind='stable')[:count]
    return Ranking(tuple(best.tolist()), tuple(float(scores[i]) for i in best))


def _of_sensors(channels, scores, parts: list[tuple[int, ...]], count: int) -> Ranking:
    owner = {channel: sensor for sensor, part in enumerate(parts) for channel in part}
    first: dict[int, float] = {}
    for channel, score in zip(channels, scores, strict=True):
        first.setdefault(owner[channel], score)
    return Ranking(tuple(first)[:count], tuple(first.values())[:count])
