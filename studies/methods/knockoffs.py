# SPDX-License-Identifier: Apache-2.0

"""A peer for decisions: sequential knockoffs, as in SEEK.

Ma, Cai, Qi, Shi & Laber, Sequential Knockoffs for Variable Selection in Reinforcement Learning,
2023. Channels are selected for the reward, then for the next value of each selected channel, and so
on. For each of these, the steps are dealt out to several sets, so that neighbours, which depend on
each other, are in different ones; knockoffs select channels in each set, and the majority decides.
Second-order Gaussian knockoffs are those of hidimstat, which is optional. The statistic is the
importance in a forest, less that of the knockoff; the action is an input of the forest, so that
what matters only with it is seen.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cmifs_ros.core import Episode

#: Modified false discovery rate that is aimed at.
_RATE = 0.1
#: Share of the sets in which a channel has to be selected.
_MAJORITY = 0.5
_NUM_TREES = 100


def sequential_knockoffs(episodes: Sequence[Episode], seed: int) -> list[int]:
    """Return the channels that a decision needs, in the order in which they were found."""
    states = np.concatenate([e.states for e in episodes])
    actions = np.concatenate([e.actions for e in episodes])
    rewards = np.concatenate([e.rewards for e in episodes])
    times = np.concatenate([np.arange(len(e)) for e in episodes])
    goes_on = np.concatenate([np.arange(len(e)) < len(e) - 1 for e in episodes])
    now = np.flatnonzero(goes_on)
    found = _selected(states, actions, rewards, times, seed)
    for channel in found:  # It grows meanwhile.
        next_values = states[now + 1, channel]
        further = _selected(states[now], actions[now], next_values, times[now], seed)
        found += [c for c in further if c not in found]
    return found


def _selected(states, actions, target, times, seed: int) -> list[int]:
    num_sets = max(1, int(np.log(len(target))))
    votes = np.zeros(states.shape[1])
    for part in range(num_sets):
        own = times % num_sets == part
        if np.ptp(target[own]) > 0:
            votes += _passes(states[own], actions[own], target[own], [seed, part])
    best_first = np.argsort(-votes, kind='stable')
    return [int(c) for c in best_first if votes[c] > _MAJORITY * num_sets]


def _passes(states, actions, target, seed: Sequence[int]) -> np.ndarray:
    """Return which channels beat their knockoffs: shape (v,)."""
    from hidimstat.samplers import GaussianKnockoffs
    from sklearn.ensemble import ExtraTreesRegressor

    own, of_forest = (int(s) for s in np.random.SeedSequence(seed).generate_state(2))
    spread = states.std(axis=0)
    scaled = (states - states.mean(axis=0)) / np.where(spread > 0, spread, 1)
    knockoffs = GaussianKnockoffs().fit(scaled).sample(random_state=own)[0]
    forest = ExtraTreesRegressor(_NUM_TREES, min_samples_leaf=5, random_state=of_forest)
    forest.fit(np.hstack([scaled, knockoffs, actions]), target)
    num_channels = states.shape[1]
    importance = forest.feature_importances_
    statistic = importance[:num_channels] - importance[num_channels : 2 * num_channels]
    # The least threshold above which the knockoffs that win are few (Barber & Candes, 2015).
    for threshold in np.sort(np.abs(statistic[statistic != 0])):
        passes = statistic >= threshold
        if np.sum(statistic <= -threshold) <= _RATE * max(1, passes.sum()):
            return passes
    return np.zeros(num_channels, dtype=bool)
