"""Whether the rewards leave anything to explain, before anything is selected by them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cmifs_ros.core import Episode
from cmifs_ros.core.words import counted

#: Rewards that differ by less than this share of the greatest do so by rounding.
_ROUNDING = 1e-9


def problem_of_rewards(episodes: Sequence[Episode]) -> str:
    """Return why no step's return differs between the episodes, or nothing if one does.

    A reward that never differs is no problem by itself: where each step costs the same, the return
    tells how soon the episode ends. So all episodes have to be paid alike, step by step, and what
    one lasts longer than another has to pay nothing.

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
    what = (
        f'every reward is {longest[0]:g}' if is_constant else 'the rewards are the same each time'
    )
    return (
        f'{what}, in all {counted(len(episodes), "episode")}: no return differs, and there is '
        'nothing to select by; say what pays, by `reward` in the robot file or in the messages of '
        'the rewards'
    )
