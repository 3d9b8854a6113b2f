# SPDX-License-Identifier: Apache-2.0

"""A peer that knows groups: conditional feature importance of hidimstat, which is optional.

Chamma, Engemann & Thirion, Statistically valid variable importance assessment through conditional
permutations, 2023, and, for groups, Chamma, Thirion & Engemann, 2024. A forest predicts the
target from channels and actions; the importance of a sensor is how much worse it gets, in episodes
left out, when the sensor is drawn anew given the others. The p-value is that of Nadeau & Bengio
(2003) over the folds, corrected for the number of sensors (Bonferroni).
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from contextlib import redirect_stderr

import numpy as np

_LEVEL = 0.05
_NUM_FOLDS, _NUM_DRAWS = 10, 5


def conditional_selection(
    inputs: np.ndarray,
    target: np.ndarray,
    episode_numbers: np.ndarray,
    sensors: Sequence[tuple[int, ...]],
    seed: int,
) -> list[int]:
    """Return the sensors with p <= 0.05, the most important first.

    Parameters
    ----------
    inputs : numpy.ndarray, shape (n, v)
        Channels and, after them, what else is given.
    target : numpy.ndarray, shape (n,)
    episode_numbers : numpy.ndarray, shape (n,)
        That of each row.
    sensors : sequence of tuple of int
        The columns of each; all others are only given.
    seed : int

    """
    from hidimstat import CFICV
    from sklearn.ensemble import ExtraTreesRegressor
    from sklearn.model_selection import PredefinedSplit

    names = np.unique(episode_numbers)
    folds = np.random.default_rng(seed).permutation(len(names)) % _NUM_FOLDS
    importance = CFICV(
        ExtraTreesRegressor(100, min_samples_leaf=5, random_state=seed),
        PredefinedSplit(folds[np.searchsorted(names, episode_numbers)]),
        n_permutations=_NUM_DRAWS,
        features_groups=dict(enumerate(map(list, sensors))),
        random_state=seed,
    )
    with redirect_stderr(io.StringIO()):  # It has progress bars.
        importance.fit(inputs, target)
        importance.importance(inputs, target)
    pvalues = importance.pvalues_ * len(sensors)
    best_first = np.argsort(-importance.importances_.mean(axis=1), kind='stable')
    return [int(i) for i in best_first if pvalues[i] <= _LEVEL]
