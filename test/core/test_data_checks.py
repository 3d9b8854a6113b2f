# SPDX-License-Identifier: Apache-2.0

"""What data cannot show is said, and sound data are not complained of."""

import warnings

import numpy as np
import pytest

from cmifs_ros.core import ConditionalMISelector, Episode
from cmifs_ros.core.data_checks import problems_of_pooling
from cmifs_ros.core.drift import independent_episodes


def told(episodes, target='return', **options):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        selector = ConditionalMISelector(target=target).fit(episodes, **options)
    assert [str(w.message) for w in caught] == selector.warnings_
    return ' '.join(selector.warnings_)


def episodes_of(levels, seed=0, num_steps=10):
    rng = np.random.default_rng(seed)
    return [
        Episode(rng.normal(size=(num_steps, 2)), level + 0.3 * rng.normal(size=num_steps))
        for level in levels
    ]


def test_sound_data_are_not_complained_of():
    levels = np.random.default_rng(0).normal(size=40)
    assert told(episodes_of(levels)) == ''


def test_a_return_that_follows_the_order_is_told_unless_the_order_means_nothing():
    episodes = episodes_of(np.repeat([1.0, 0.0], 20))
    assert 'the return follows the order of the episodes' in told(episodes)
    assert '40 episodes resemble their neighbours' in told(episodes)
    assert told(episodes).count('--order none') == 1
    assert told(episodes, ordered=False) == ''


def test_a_reward_that_makes_up_most_of_the_variance_is_told():
    episodes = episodes_of(np.random.default_rng(1).normal(size=40))
    rewards = episodes[17].rewards.copy()
    rewards[3] = -1e4
    episodes[17] = Episode(episodes[17].states, rewards)
    assert '1 reward of -10000 in episode 17 makes up 100% of the variance' in told(episodes)


@pytest.mark.parametrize(
    ('target', 'held', 'kinds', 'is_told'),
    [
        ('action', 4, None, True),
        ('action', 4, 2, True),
        ('action', 1, None, False),
        ('action', 1, 2, False),  # Half of the steps repeat the previous action by chance.
        ('return', 4, None, False),  # The action is given.
    ],
)
def test_commands_of_several_steps_are_told_where_the_action_is_the_target(
    target, held, kinds, is_told
):
    rng = np.random.default_rng(4)
    draw = rng.normal if kinds is None else lambda size: rng.integers(kinds, size=size)
    episodes = [
        Episode(
            rng.normal(size=(12, 2)),
            rng.normal(size=12),
            np.repeat(draw(size=12 // held), held)[:, None],
        )
        for _ in range(30)
    ]
    said = told(episodes, target=target, action_names=['speed'])
    assert ('the action follows from the previous one (speed: ' in said) == is_told


@pytest.mark.parametrize(
    ('is_skilled', 'target', 'said'),
    [
        (True, 'return', 'they predict 100% of turn'),
        (False, 'return', ''),  # The gyro shows the previous action, however it was chosen.
        (True, 'action', ''),
        (False, 'action', 'the action follows from the previous one (turn: '),
    ],
)
def test_a_sensor_that_shows_the_previous_action_is_told_from_a_controller_that_looks(
    is_skilled, target, said
):
    rng = np.random.default_rng(5)
    episodes = []
    for _ in range(40):
        slow = rng.normal(size=(26, 2))  # Autoregressions of order 1: the slope, and a whim.
        for t in range(1, len(slow)):
            slow[t] = 0.93 * slow[t - 1] + np.sqrt(1 - 0.93**2) * slow[t]
        slope, whim = slow.T
        turn = np.tanh(2 * slope) if is_skilled else whim
        gyro = turn[:-1] + 0.05 * rng.normal(size=25)
        states = np.column_stack([slope[1:], gyro])
        episodes.append(Episode(states, -turn[1:] * slope[1:], turn[1:, None]))
    found = told(episodes, target=target, names=['slope', 'gyro'], action_names=['turn'])
    assert said in found if said else found == ''


def test_windows_that_overlap_are_told():
    rng = np.random.default_rng(2)
    states, rewards = rng.normal(size=(500, 2)), rng.normal(size=500)
    halves = [Episode(states[i : i + 20], rewards[i : i + 20]) for i in range(0, 480, 10)]
    assert 'are in two episodes' in told(halves)
    whole = [Episode(states[i : i + 20], rewards[i : i + 20]) for i in range(0, 480, 20)]
    assert 'two episodes' not in told(whole)


@pytest.mark.parametrize('robots_differ', [True, False])
def test_a_channel_that_differs_between_robots_as_the_return_does_is_named(robots_differ):
    rng = np.random.default_rng(3)
    zeros, levels = rng.normal(size=(2, 5)) * robots_differ
    episodes = [
        Episode(
            np.column_stack([zeros[i // 8] + 0.1 * rng.normal(size=10), rng.normal(size=10)]),
            levels[i // 8] + rng.normal() + rng.normal(size=10),
            source=f'robot_{i // 8}',
        )
        for i in range(40)
    ]
    said = told(episodes, names=['gyro', 'slip'])
    assert ('between the 5 sources' in said and 'gyro' in said) == robots_differ
    assert 'slip' not in said
    unnamed = [Episode(e.states, e.rewards) for e in episodes]
    assert 'sources' not in told(unnamed, names=['gyro', 'slip'])

    def told_of_bags(episodes):
        seen = ConditionalMISelector().thin(episodes)
        return problems_of_pooling(seen, np.arange(40) // 8, ['gyro', 'slip'])

    (said,) = told_of_bags(unnamed) or ('',)
    assert ('between the 5 recordings' in said and 'gyro' in said) == robots_differ
    assert told_of_bags(episodes) == []


@pytest.mark.parametrize('share', [0.0, 0.8])
def test_episodes_that_resemble_their_neighbours_are_worth_fewer(share):
    # An autoregression of order 1 has the integrated autocorrelation time (1 + a) / (1 - a).
    rng = np.random.default_rng(3)
    levels = rng.normal(size=3000)
    for i in range(1, len(levels)):
        levels[i] = share * levels[i - 1] + np.sqrt(1 - share**2) * levels[i]
    expected = len(levels) * (1 - share) / (1 + share)
    assert independent_episodes(levels) == pytest.approx(expected, rel=0.3)
