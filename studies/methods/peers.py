# SPDX-License-Identifier: Apache-2.0

"""Peers that look at one channel at a time: ennemi and scikit-learn, step by step.

Each estimates the mutual information between the return and one channel from nearest neighbours,
here separately at each step. The mean over the steps, weighted as in `core.conditional_mi`,
estimates I(eta; z | n) for that channel alone. Both packages are optional.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cmifs_ros.core import Episode
from cmifs_ros.core.samples import step_samples

#: Both packages' own default.
NUM_NEIGHBOURS = 3

#: (returns (M,), channels (M, v)) -> their mutual information, shape (v,)
Estimator = Callable[[np.ndarray, np.ndarray], np.ndarray]


def ennemi_estimator(seed: int, num_threads: int) -> Estimator:
    """Return the estimator of ennemi, which draws noise from its own seed."""
    from ennemi import estimate_mi

    return lambda returns, channels: estimate_mi(
        returns, channels, k=NUM_NEIGHBOURS, max_threads=num_threads
    )[0]


def sklearn_estimator(seed: int, num_threads: int) -> Estimator:
    """Return the estimator of scikit-learn, which uses one thread."""
    from sklearn.feature_selection import mutual_info_regression

    return lambda returns, channels: mutual_info_regression(
        channels, returns, n_neighbors=NUM_NEIGHBOURS, random_state=seed
    )


ESTIMATORS = {'ennemi': ennemi_estimator, 'sklearn': sklearn_estimator}


def information_by_channel(
    episodes: Sequence[Episode], estimate: Estimator, *, gamma: float = 0.95
) -> np.ndarray:
    """Return the conditional mutual information of the return and each channel: shape (v,).

    Long episodes are pooled into time bins as in `ConditionalMISelector`. A constant, and a step
    with no more samples than neighbours, count as 0.
    """
    steps = step_samples(
        episodes,
        gamma=gamma,
        standardize=False,
        max_time_bins=32,
        num_folds=2,
        num_centers=None,
        random_state=0,
    )
    information = np.zeros(episodes[0].num_channels)
    for step in steps:
        varies = np.ptp(step.states, axis=0) > 0
        if len(step.returns) > NUM_NEIGHBOURS and np.ptp(step.returns) > 0 and varies.any():
            values = estimate(step.returns, step.states[:, varies])
            information[varies] += len(step.returns) * values
    return information / sum(map(len, episodes))
