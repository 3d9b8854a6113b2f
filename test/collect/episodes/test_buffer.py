# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from cmifs_ros.collect.episodes.buffer import EpisodeBuffer
from cmifs_ros.core import Episode


def episode(steps=3, channels=2, value=0.0):
    return Episode(np.full((steps, channels), value), np.zeros(steps))


def test_buffer_keeps_the_newest_and_snapshots_do_not_change():
    buffer = EpisodeBuffer(max_episodes=2)
    for value in range(3):
        buffer.append(episode(value=value))
    snapshot = buffer.snapshot()
    assert [e.states[0, 0] for e in snapshot] == [1, 2]
    assert (len(buffer), buffer.num_steps) == (2, 6)
    assert buffer.nbytes == 2 * (3 * 2 + 3) * 8
    buffer.forget([*snapshot[:1], episode(value=9)])
    assert [e.states[0, 0] for e in buffer.snapshot()] == [2]
    assert (buffer.num_steps, buffer.nbytes) == (3, (3 * 2 + 3) * 8)
    buffer.append(snapshot[0])  # It may come again.
    buffer.max_episodes = 1
    assert [e.states[0, 0] for e in buffer.snapshot()] == [1]
    buffer.clear()
    assert len(buffer) == 0
    assert (buffer.renewals, buffer.num_clears) == (0, 1)
    assert len(snapshot) == 2


def test_buffer_refuses_other_channels_and_sizes_and_keeps_what_it_has():
    buffer = EpisodeBuffer(max_episodes=2)
    buffer.append(episode(channels=2))
    with pytest.raises(ValueError, match='the episode has 3 channels; expected 2'):
        buffer.append(episode(channels=3))
    with pytest.raises(ValueError, match='max_episodes is 0'):
        buffer.max_episodes = 0
    assert len(buffer) == 1


def test_buffer_is_bounded_in_memory_too():
    size = episode().nbytes
    buffer = EpisodeBuffer(max_episodes=9, max_bytes=2 * size + 1)
    for value in range(4):
        buffer.append(episode(value=value))
    assert [e.states[0, 0] for e in buffer.snapshot()] == [2, 3]
    assert (buffer.nbytes, buffer.num_steps) == (2 * size, 6)
    with pytest.raises(ValueError, match=f'expected at most {2 * size + 1}'):
        buffer.append(Episode(np.zeros((100, 2)), np.zeros(100)))
    assert len(buffer) == 2
    buffer.max_bytes = size
    assert [e.states[0, 0] for e in buffer.snapshot()] == [3]
    with pytest.raises(ValueError, match='max_bytes is 0'):
        buffer.max_bytes = 0


@pytest.mark.parametrize('bounds', [{'max_episodes': 8}, {'max_bytes': 8 * episode().nbytes + 1}])
def test_a_doubling_and_a_replacement_are_a_renewal_whatever_bounds_the_buffer(bounds):
    buffer = EpisodeBuffer(**{'max_episodes': 1000} | bounds)
    found = []
    for value in range(40):
        buffer.append(episode(value=value))
        assert not buffer.append(episode(value=value))  # A copy renews nothing.
        found.append(buffer.renewals)
    expected = [np.log2(n) if n <= 8 else 3 + (n - 8) / 8 for n in range(1, 41)]
    np.testing.assert_allclose(found, expected)
    buffer.forget(buffer.snapshot()[:4])
    assert buffer.renewals == 2  # as of the four that are left
    buffer.clear()
    assert buffer.renewals == 0


def test_episodes_that_make_room_for_a_large_one_count_and_so_do_those_that_replace_them():
    small, large = episode(steps=1), episode(steps=6, value=99)
    buffer = EpisodeBuffer(max_episodes=1000, max_bytes=8 * small.nbytes)
    for value in range(8):
        buffer.append(episode(steps=1, value=value))
    buffer.append(large)
    assert len(buffer) == 3
    assert buffer.renewals == pytest.approx(3 + 6 / 8)
    buffer.max_bytes = 10**6
    buffer.append(episode(value=9))
    assert buffer.renewals == pytest.approx(3 + 6 / 8 + np.log2(4 / 3))


def test_the_same_episode_again_is_counted_and_not_kept_while_it_is_held():
    buffer = EpisodeBuffer(max_episodes=2)
    assert buffer.append(episode(value=1))
    assert not buffer.append(episode(value=1))
    assert (len(buffer), buffer.num_repeated, buffer.num_steps) == (1, 1, 3)
    assert buffer.append(episode(value=2))
    assert buffer.append(episode(value=3))
    assert buffer.append(episode(value=1))
    assert buffer.num_repeated == 1


def test_the_same_states_and_rewards_by_other_actions_are_another_episode():
    buffer = EpisodeBuffer()
    for actions, is_new in ((None, True), ([0, 1, 0], True), ([0, 1, 1], True), ([0, 1, 0], False)):
        assert buffer.append(Episode(np.ones((3, 2)), np.zeros(3), actions)) == is_new
    assert buffer.nbytes == (3 * (2 * 3 + 3) + 2 * 3) * 8
