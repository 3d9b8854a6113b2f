# SPDX-License-Identifier: Apache-2.0

"""Peers that fit trees to all samples at once: extra trees with permutation importance, Boruta.

The return of a step is learned from its channels and actions, without the step's number. Both
packages are optional. FOCI (Azadkia & Chatterjee, 2021) has no Python package.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cmifs_ros.core import Episode
from cmifs_ros.core.returns import discounted_returns

NUM_FOLDS = 5
NUM_REPEATS = 3
GAMMA = 0.95


def _samples(episodes: Sequence[Episode]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return inputs (n, v + a), returns (n,) and the number of each sample's episode (n,).

    The first inputs are the channels, the others the actions.
    """
    inputs = np.concatenate([np.hstack([e.states, e.actions]) for e in episodes])
    returns = np.concatenate([discounted_returns(e.rewards, GAMMA) for e in episodes])
    return inputs, returns, np.repeat(np.arange(len(episodes)), [len(e) for e in episodes])


def forest_importance(
    episodes: Sequence[Episode], sensors: Sequence[tuple[int, ...]], seed: int, num_threads: int
) -> np.ndarray:
    """Return the decrease of R^2 on held-out episodes when a sensor is permuted: shape (S,).

    Extra trees (Geurts et al., 2006) are fitted to four fifths of the episodes, five times; the
    channels of a sensor are permuted together.
    """
    from sklearn.ensemble import ExtraTreesRegressor

    inputs, returns, numbers = _samples(episodes)
    rng = np.random.default_rng(seed)
    num_folds = min(NUM_FOLDS, len(episodes))
    folds = rng.permutation(len(episodes)) % num_folds
    importance = np.zeros(len(sensors))
    for fold in range(num_folds):
        is_left_out = folds[numbers] == fold
        forest = ExtraTreesRegressor(
            n_estimators=100, min_samples_leaf=5, random_state=seed, n_jobs=num_threads
        ).fit(inputs[~is_left_out], returns[~is_left_out])
        left_out, wanted = inputs[is_left_out], returns[is_left_out]
        error = np.mean((forest.predict(left_out) - wanted) ** 2)
        for i, sensor in enumerate(sensors):
            columns = list(sensor)
            for _ in range(NUM_REPEATS):
                permuted = left_out.copy()
                permuted[:, columns] = left_out[rng.permutation(len(left_out))][:, columns]
                importance[i] += np.mean((forest.predict(permuted) - wanted) ** 2) - error
    spread = np.var(returns)
    return importance / (num_folds * NUM_REPEATS * spread) if spread > 0 else importance


def boruta_importance(
    episodes: Sequence[Episode], sensors: Sequence[tuple[int, ...]], seed: int, num_threads: int
) -> np.ndarray:
    """Return minus the rank that Boruta (Kursa & Rudnicki, 2010) gives a sensor's best channel.

    Boruta distinguishes accepted, undecided and rejected channels, and ranks the rejected ones.
    Ties are ordered at random, because relevant channels may come first in the data.
    """
    from boruta import BorutaPy
    from sklearn.ensemble import ExtraTreesRegressor

    inputs, returns, _ = _samples(episodes)
    forest = ExtraTreesRegressor(max_depth=7, n_jobs=num_threads)
    boruta = BorutaPy(forest, n_estimators=100, max_iter=50, random_state=seed)
    boruta.fit(inputs, returns)
    ranks = np.array([min(boruta.ranking_[list(sensor)]) for sensor in sensors], dtype=float)
    return -ranks - 0.5 * np.random.default_rng(seed).random(len(sensors))


FORESTS = {'forest': forest_importance, 'boruta': boruta_importance}
