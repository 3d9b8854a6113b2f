# SPDX-License-Identifier: Apache-2.0

"""Check, before selecting, that episodes have what the target needs: returns or actions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cmifs_ros.core import Episode
from cmifs_ros.core.targets import ACTION
from cmifs_ros.core.thinning import ThinnedEpisodes
from cmifs_ros.core.words import counted

#: What differs by less than this share of the greatest is equal up to rounding.
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
        rewards, differ = episodes.samples.rewards, _returns_differ(episodes)
    else:
        rewards, differ = max(episodes, key=len).rewards, _rewards_differ(episodes)
    if differ:
        return ''
    is_constant = np.ptp(rewards) <= _ROUNDING * np.abs(rewards).max()
    what = f'every reward is {rewards[0]:g}' if is_constant else 'the rewards repeat exactly'
    return (
        f'{what}, in all {counted(len(episodes), "episode")}: no return differs between the '
        'episodes, so nothing can be selected; define a reward that differs, by `reward` in the '
        'robot file or in the reward messages'
    )


def _rewards_differ(episodes: Sequence[Episode]) -> bool:
    """Return whether the return of any step differs between episodes, by a discount below 1.

    A constant reward is no problem by itself: if each step costs the same, the return depends on
    how soon the episode ends. The returns are equal only if all episodes have the same rewards
    step by step, and the additional steps of longer episodes have the reward 0.
    """
    longest = max(episodes, key=len).rewards
    tolerance = _ROUNDING * np.abs(longest).max()
    for episode in episodes:
        begin, rest = longest[: len(episode)], longest[len(episode) :]
        with np.errstate(over='ignore'):
            differs = np.abs(episode.rewards - begin) > tolerance
        if differs.any() or (np.abs(rest) > tolerance).any():
            return True
    return False


def _returns_differ(episodes: ThinnedEpisodes) -> bool:
    """Return whether the return of any step that is kept differs between episodes."""
    returns, steps = episodes.samples.returns, episodes.samples.step
    order = np.lexsort((returns, steps))
    with np.errstate(over='ignore', invalid='ignore'):
        differs = np.diff(returns[order]) > _ROUNDING * np.abs(returns).max()
    return bool((differs & (np.diff(steps[order]) == 0)).any())
