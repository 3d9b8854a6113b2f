# SPDX-License-Identifier: Apache-2.0

"""Check, before selecting, that episodes have what the target needs: returns or actions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cmifs_ros.core import Episode
from cmifs_ros.core.targets import ACTION
from cmifs_ros.core.words import counted

#: Rewards that differ by less than this share of the greatest are equal up to rounding.
_ROUNDING = 1e-9


def problem_of_target(episodes: Sequence[Episode], target: str) -> str:
    """Return why nothing can be selected for one of `TARGETS`; empty if something can.

    Parameters
    ----------
    episodes : sequence of Episode
        At least one; all with actions or all without.
    target : str

    """
    if target != ACTION:
        return problem_of_rewards(episodes)
    if episodes[0].actions.size:
        return ''
    return (
        "target is 'action', but the episodes have no actions: add `actions` to the robot file, or "
        'publish each on `action` with the stamp of its state'
    )


def problem_of_rewards(episodes: Sequence[Episode]) -> str:
    """Return why the return of no step differs between the episodes; empty if one does.

    A constant reward is no problem by itself: if each step costs the same, the return depends on
    how soon the episode ends. The returns are equal only if all episodes have the same rewards
    step by step, and the additional steps of longer episodes have the reward 0.

    Parameters
    ----------
    episodes : sequence of Episode
        At least one.

    """
    longest = max(episodes, key=len).rewards
    tolerance = _ROUNDING * np.abs(longest).max()
    for episode in episodes:
        begin, rest = longest[: len(episode)], longest[len(episode) :]
        with np.errstate(over='ignore'):
            differs = np.abs(episode.rewards - begin) > tolerance
        if differs.any() or (np.abs(rest) > tolerance).any():
            return ''
    is_constant = np.ptp(longest) <= tolerance
    what = f'every reward is {longest[0]:g}' if is_constant else 'the rewards repeat exactly'
    return (
        f'{what}, in all {counted(len(episodes), "episode")}: no return differs between the '
        'episodes, so nothing can be selected; define a reward that differs, by `reward` in the '
        'robot file or in the reward messages'
    )
