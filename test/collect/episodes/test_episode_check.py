# SPDX-License-Identifier: Apache-2.0

"""What is said of episodes without ends, with too many ends, and of too few."""

from collections import Counter

import pytest

from cmifs_ros.collect.episodes.episode_check import (
    Condition,
    problems_of_ends,
    problems_of_episodes,
)

FEW = 'expected at least 20, better 50'


@pytest.mark.parametrize(
    ('lengths', 'num_cut', 'num_open_steps', 'said'),
    [
        ([9] * 20, 0, 8, []),
        ([9] * 19, 0, 8, [FEW]),
        (
            [1000] * 2,
            2,
            300,
            [
                'no end in 1000 steps, where 2 of 2 complete episodes were cut: define',
                f'2 complete episodes; {FEW}',
            ],
        ),
        ([9] * 40 + [1000], 1, 0, ['1 of 41 complete episodes']),
        ([], 0, 900, ['no end in 900 steps: define', f'0 complete episodes; {FEW}']),
        ([], 0, 0, [FEW]),
        ([1] * 30 + [9] * 20, 0, 0, ['a single step in 30 of 50 complete episodes']),
        ([1] * 20 + [9] * 20, 0, 0, []),
    ],
)
def test_what_is_wrong_is_told_with_its_cause_first(lengths, num_cut, num_open_steps, said):
    problems = problems_of_episodes(lengths, num_cut, num_open_steps)
    assert len(problems) == len(said)
    for problem, part in zip(problems, said, strict=True):
        assert part in problem


@pytest.mark.parametrize(
    ('is_of_messages', 'counts', 'said'),
    [
        (False, {True: 3, False: 900}, ''),
        (False, {False: 900, None: 3}, 'true in none of 900 steps'),
        (False, {True: 900, None: 3}, 'true in all 900 steps, so no episode begins'),
        (False, {None: 900}, 'never known, because a value that it uses was missing'),
        (False, {}, ''),
        (True, {True: 9}, ''),
        (True, {False: 90}, 'true in none of 90 messages'),
        (True, {}, 'never true, because no message came'),
    ],
)
def test_conditions_that_never_or_always_hold_are_named(is_of_messages, counts, said):
    looks = {Condition('terminated: x > 3', is_of_messages): Counter(counts)}
    assert problems_of_ends(looks) == ([f'`terminated: x > 3` was {said}'] if said else [])
