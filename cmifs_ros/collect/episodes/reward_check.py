# SPDX-License-Identifier: Apache-2.0

"""Check, before selecting, that episodes have what the target needs: returns or actions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cmifs_ros.core import Episode
from cmifs_ros.core.targets import ACTION
from cmifs_ros.core.thinning import ThinnedEpisodes
from cmifs_ros.core.words import counted

#: Returns that differ by less than this share of the greatest are equal up to rounding.
_ROUNDING = 1e-9
_NO_ACTIONS = (
    "target is 'action', but the episodes have no actions: add `actions` to the robot file, or "
    'publish each on `action` with the stamp of its state'
)


def problem_of_target(episodes: Sequence[Episode] | ThinnedEpisodes, target: str) -> str:
    """Return why nothing can be selected for one of `TARGETS`; empty if something can.

    Parameters
    ----------
    episodes : sequence of Episode, or ThinnedEpisodes
        At least one; all with actions or all without.
    target : str

    """
    if target == ACTION:
        first = episodes.samples if isinstance(episodes, ThinnedEpisodes) else episodes[0]
        return '' if first.actions.size else _NO_ACTIONS
    if isinstance(episodes, ThinnedEpisodes):
        samples = episodes.samples
        return _problem_of_rewards(samples.step, samples.rewards, samples.returns, len(episodes))
    rewards = [episode.rewards for episode in episodes]
    with np.errstate(over='ignore'):
        returns = np.concatenate([np.cumsum(of_one[::-1])[::-1] for of_one in rewards])
    steps = np.concatenate([np.arange(len(of_one)) for of_one in rewards])
    return _problem_of_rewards(steps, np.concatenate(rewards), returns, len(episodes))


def _problem_of_rewards(
    steps: np.ndarray, rewards: np.ndarray, returns: np.ndarray, num_episodes: int
) -> str:
    """Return why the return of no step differs between the episodes; empty if one does.

    A constant reward is no problem by itself: if each step costs the same, the return depends on
    how soon the episode ends. The returns are equal only if all episodes have the same rewards
    step by step, and the additional steps of longer episodes have the reward 0.
    """
    tolerance = _ROUNDING * np.abs(returns).max()
    order = np.lexsort((returns, steps))
    with np.errstate(over='ignore', invalid='ignore'):
        differs = np.diff(returns[order]) > tolerance
    if (differs & (np.diff(steps[order]) == 0)).any():
        return ''
    is_constant = np.ptp(rewards) <= tolerance
    what = f'every reward is {rewards[0]:g}' if is_constant else 'the rewards repeat exactly'
    return (
        f'{what}, in all {counted(num_episodes, "episode")}: no return differs between the '
        'episodes, so nothing can be selected; define a reward that differs, by `reward` in the '
        'robot file or in the reward messages'
    )
