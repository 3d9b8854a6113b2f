# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from cmifs_ros.core import Episode
from cmifs_ros.core.episode import as_episodes


def episode(steps=3, channels=2, value=0.0):
    return Episode(np.full((steps, channels), value), np.zeros(steps))


@pytest.mark.parametrize(
    ('states', 'rewards', 'message'),
    [
        ([[1.0, 2.0]], [1.0, 2.0], r'rewards has shape \(2,\); expected \(1,\)'),
        ([1.0, 2.0], [1.0, 2.0], r'states has shape \(2,\)'),
        (np.zeros((0, 3)), [], r'states has shape \(0, 3\)'),
        ([[1.0, np.nan]], [1.0], r'states\[0, 1\] is nan'),
        ([[1.0], [2.0]], [1.0, np.inf], r'rewards\[1\] is inf'),
    ],
)
def test_bad_episode_is_refused_by_name(states, rewards, message):
    with pytest.raises(ValueError, match=message):
        Episode(states, rewards)


def test_episode_is_independent_of_the_arrays_it_was_made_of_and_read_only():
    states = np.zeros((2, 1))
    made = Episode(states, np.zeros(2))
    states[0] = 9
    assert made.states[0, 0] == 0
    with pytest.raises(ValueError, match='read-only'):
        made.states[0] = 1


@pytest.mark.parametrize(('source', 'kept'), [(None, ''), ('cell', 'cell'), (2, '2')])
def test_a_source_is_a_text_and_none_is_no_source(source, kept):
    assert Episode(np.zeros((2, 1)), np.zeros(2), source=source).source == kept


def test_pair_of_arrays_is_a_list_of_episodes():
    states = np.arange(24.0).reshape(2, 3, 4)
    rewards = np.arange(6.0).reshape(2, 3)
    episodes = as_episodes((states, rewards))
    assert [len(e) for e in episodes] == [3, 3]
    np.testing.assert_array_equal(episodes[1].states, states[1])
    np.testing.assert_array_equal(episodes[1].rewards, rewards[1])


@pytest.mark.parametrize(
    ('data', 'message'),
    [
        ([], 'there are 0 episodes'),
        ([episode(channels=2), episode(channels=3)], 'episode 1 has 3 channels; expected 2'),
        ([np.zeros((3, 2))], 'episode 0 is a ndarray'),
        ((np.zeros((2, 3, 4)), np.zeros((2, 4))), r'\(2, 3, 4\), \(2, 4\)'),
    ],
)
def test_bad_episodes_are_refused_by_name(data, message):
    with pytest.raises(ValueError, match=message):
        as_episodes(data)
