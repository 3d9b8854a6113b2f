# SPDX-License-Identifier: Apache-2.0

"""A peer for decisions: recursive feature selection with extra trees.

Castelletti, Galelli, Restelli & Soncini-Sessa, Tree-based feature selection for dimensionality
reduction of large-scale control systems, 2011. Inputs are selected for the reward, then for the
next value of each selected channel, and so on. The selection for one variable follows Galelli &
Castelletti, Tree-based iterative input variable selection for hydrological modeling, 2013: trees
rank all inputs by how well they explain the residual, the best single one of the first few is
added, and the search ends when the model does not improve. Unlike there, the action is an input of
each model, so that sensors that matter only with it are found, and models are compared out of bag.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cmifs_ros.core import Episode

_NUM_TREES = 50
_NUM_COMPARED = 3
#: Share of the variance that an input must add.
_LEAST_GAIN = 0.01


def recursive_selection(episodes: Sequence[Episode], seed: int) -> list[int]:
    """Return the channels that a decision needs, in the order found."""
    states = np.concatenate([e.states for e in episodes])
    actions = np.concatenate([e.actions for e in episodes])
    rewards = np.concatenate([e.rewards for e in episodes])
    goes_on = np.concatenate([np.arange(len(e)) < len(e) - 1 for e in episodes])
    now = np.flatnonzero(goes_on)
    found = _selected(states, actions, rewards, seed)
    for channel in found:  # It grows meanwhile.
        further = _selected(states[now], actions[now], states[now + 1, channel], seed)
        found += [c for c in further if c not in found]
    return found


def _selected(states, actions, target: np.ndarray, seed: int) -> list[int]:
    """Return the channels that predict a target (n,) given the actions."""
    chosen: list[int] = []
    target = target - target.mean()
    residual, explained = _residual_and_score(actions, target, seed)
    while len(chosen) < states.shape[1]:
        ranking = np.argsort(-_importances(np.hstack([states, actions]), residual, seed))
        likely = [int(c) for c in ranking if c < states.shape[1]][:_NUM_COMPARED]
        alone = [
            _residual_and_score(np.column_stack([states[:, c], actions]), residual, seed)[1]
            for c in likely
        ]
        best = likely[int(np.argmax(alone))]
        if best in chosen:
            break
        inputs = np.column_stack([states[:, [*chosen, best]], actions])
        left, score = _residual_and_score(inputs, target, seed)
        if score < explained + _LEAST_GAIN:
            break
        chosen, residual, explained = [*chosen, best], left, score
    return chosen


def _forest(seed: int):
    from sklearn.ensemble import ExtraTreesRegressor

    return ExtraTreesRegressor(
        _NUM_TREES, min_samples_leaf=5, bootstrap=True, oob_score=True, random_state=seed
    )


def _importances(inputs, target, seed):
    return _forest(seed).fit(inputs, target).feature_importances_


def _residual_and_score(inputs, target, seed) -> tuple[np.ndarray, float]:
    """Return the out-of-bag residual of a forest, and the share of variance explained."""
    if not inputs.shape[1] or not np.ptp(target):
        return target, 0.0
    left = target - _forest(seed).fit(inputs, target).oob_prediction_
    return left, float(1 - np.mean(left**2) / np.var(target))
