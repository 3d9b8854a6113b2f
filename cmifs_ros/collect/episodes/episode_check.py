"""Whether episodes end as they should and are enough to select by, before anything is computed."""

from __future__ import annotations

from collections.abc import Sequence

from cmifs_ros.core.words import counted

#: Below this number hardly any sensor can be told from chance; as the selector's min_episodes.
FEW = 20
_SAY_ENDS = (
    'say what ends an episode, by `episode` in the robot file (`steps: 25` makes windows of 25 '
    'steps) or by `terminated` and `truncated` in the messages of the rewards'
)


def problems_of_episodes(lengths: Sequence[int], num_cut: int, num_open_steps: int) -> list[str]:
    """Return what is wrong with the episodes, in sentences with a remedy: causes come first.

    Parameters
    ----------
    lengths : sequence of int
        The steps of each whole episode.
    num_cut : int
        How many of them were closed at the greatest length.
    num_open_steps : int
        Steps since the last end.

    """
    problems = []
    count = len(lengths)
    whole = counted(count, 'whole episode')
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
            f'a single step in {num_single} of {whole}: what ends one seems to be so at each step; '
            'an end by a topic needs one that speaks at ends only'
        )
    if count < FEW:
        problems.append(
            f'{whole}; expected at least {FEW}, better 50: by fewer, few sensors are told from '
            'chance. One that lacks a step, or was not recorded from begin to end, does not count'
        )
    return problems
