# SPDX-License-Identifier: Apache-2.0

"""Check, before selecting, that episodes end properly and are numerous enough."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from cmifs_ros.core.statuses import FEWEST_EPISODES
from cmifs_ros.core.words import counted

_SAY_ENDS = (
    'define when an episode ends: `episode` in the robot file (`steps: 25` gives windows of 25 '
    'steps), or `terminated` and `truncated` in the reward messages'
)


class Condition(NamedTuple):
    """A condition of the robot file that ends episodes.

    `is_of_messages`: it is evaluated for messages; otherwise for the values at each step.
    """

    text: str
    is_of_messages: bool


def problems_of_ends(looks: Mapping[Condition, Counter[bool | None]]) -> list[str]:
    """Return sentences about conditions that were never true, always true, or never known.

    Parameters
    ----------
    looks : mapping of Condition to collections.Counter
        How often each was true, false and unknown (None).

    """
    problems = []
    for condition, counts in looks.items():
        what = 'message' if condition.is_of_messages else 'step'
        known = counts[True] + counts[False]
        if not known and condition.is_of_messages:
            problem = 'never true, because no message came'
        elif not known and counts[None]:
            problem = 'never known, because a value that it uses was missing'
        elif known and not counts[True]:
            problem = f'true in none of {counted(known, what)}'
        elif known and not counts[False] and not condition.is_of_messages:
            problem = f'true in all {counted(known, what)}, so no episode begins'
        else:
            continue
        problems.append(f'`{condition.text}` was {problem}')
    return problems


def problems_of_episodes(lengths: Sequence[int], num_cut: int, num_open_steps: int) -> list[str]:
    """Return problems of the episodes as sentences with a remedy, causes first.

    Parameters
    ----------
    lengths : sequence of int
        Number of steps of each complete episode.
    num_cut : int
        Number of episodes that were cut at the greatest length.
    num_open_steps : int
        Number of steps since the last end.

    """
    problems = []
    count = len(lengths)
    whole = counted(count, 'complete episode')
    if num_cut:
        problems.append(
            f'no end in {counted(max(lengths), "step")}, where {num_cut} of {whole} were cut: '
            f'{_SAY_ENDS}'
        )
    elif num_open_steps > sum(lengths):
        problems.append(f'no end in {counted(num_open_steps, "step")}: {_SAY_ENDS}')
    num_single = sum(length == 1 for length in lengths)
    if num_single > count / 2:
        problems.append(
            f'a single step in {num_single} of {whole}: steps are as long as episodes, or the end '
            'condition seems to hold at every step; a topic that ends episodes must publish only '
            'when one ends'
        )
    if count < FEWEST_EPISODES:
        problems.append(
            f'{whole}; expected at least {FEWEST_EPISODES}, better 50: fewer give too little '
            'evidence. Episodes that lack a step, or were not recorded from beginning to end, do '
            'not count'
        )
    return problems
