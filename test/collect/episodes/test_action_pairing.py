# SPDX-License-Identifier: Apache-2.0

"""Actions join the steps of their stamps, whichever comes first, and none is waited for in vain."""

from array import array
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cmifs_ros.collect.episodes.builder import RewardSample
from cmifs_ros.collect.episodes.pairing import EpisodeAssembler

LENGTHS = (3, 1, 4)


class Feed:
    """An assembler, and what it makes of the steps of three episodes; state and action are t."""

    def __init__(self, **options):
        self.assembler, self.episodes, self.begin = EpisodeAssembler(100), [], 0
        for name, value in options.items():
            setattr(self.assembler.actions, name, value)

    def state(self, t):
        self.episodes += self.assembler.add_state(self.begin + t, ['x'], array('d', [t]))

    def reward(self, t):
        ends = [sum(LENGTHS[: i + 1]) for i in range(len(LENGTHS))]
        sample = RewardSample(float(t), t in ends, False, sum(t > end for end in ends))
        self.episodes += self.assembler.add_reward(self.begin + t, sample)

    def action(self, t, names=('drive', 'turn')):
        values = {'drive': t, 'turn': -t}
        stamp, values = self.begin + t, [values[n] for n in names]
        self.episodes += self.assembler.actions.add_action(stamp, names, values)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32))
def test_actions_are_those_of_the_states_in_whichever_order_the_topics_come(seed):
    random, feed = Random(seed), Feed()
    feed.assembler.actions.are_published = lambda: True
    kinds = [kind for kind in (feed.state, feed.reward, feed.action) for _ in range(sum(LENGTHS))]
    random.shuffle(kinds)  # Each topic is in order by itself.
    times = {kind: iter(range(1, sum(LENGTHS) + 1)) for kind in set(kinds)}
    for kind in kinds:
        kind(next(times[kind]))
    assert [len(e) for e in feed.episodes] == list(LENGTHS)
    for episode in feed.episodes:
        np.testing.assert_array_equal(episode.actions, episode.states * [1, -1])
    assert feed.assembler.actions.names == ('drive', 'turn')
    assert feed.assembler.actions.num_without == 0


def test_the_order_of_the_values_may_change():
    feed = Feed()
    for t in (1, 2, 3):
        feed.state(t)
        feed.action(t, ('drive', 'turn') if t < 3 else ('turn', 'drive'))
        feed.reward(t)
    np.testing.assert_array_equal(feed.episodes[0].actions, [[1, -1], [2, -2], [3, -3]])


def test_without_actions_nothing_waits():
    feed = Feed()
    for t in range(1, 9):
        feed.state(t)
        feed.reward(t)
    assert [e.actions.shape for e in feed.episodes] == [(n, 0) for n in LENGTHS]
    assert not feed.assembler.dropped_messages


def test_an_episode_that_lacks_an_action_does_without_and_the_others_do_not():
    feed = Feed()
    for t in range(1, 9):
        feed.state(t)
        if t != 6:
            feed.action(t)
        feed.reward(t)
    assert [e.actions.shape for e in feed.episodes] == [(3, 2), (1, 2), (4, 0)]
    actions = feed.assembler.actions
    assert (actions.num_without, actions.num_waiting) == (1, 0)
    assert feed.assembler.builder.num_partly_acting == 1


def test_actions_that_are_announced_and_never_come_are_not_waited_for_for_ever():
    feed = Feed(are_published=lambda: True)
    for t in range(1, 9):
        feed.state(t)
        feed.reward(t)
    assert not feed.episodes
    assert feed.assembler.num_pending == 8
    for now in range(6):
        feed.episodes += feed.assembler.actions.look(100.0 + now)
        assert not feed.episodes
    feed.episodes += feed.assembler.actions.look(106.0)  # Nothing has moved for some seconds.
    assert [len(e) for e in feed.episodes] == list(LENGTHS)
    for t in range(9, 19):
        feed.state(t)
        feed.reward(t)
    assert feed.assembler.num_pending == 0


def test_no_more_steps_wait_than_there_is_room_for():
    feed = Feed(are_published=lambda: True)
    for t in range(1, 2001):
        feed.state(t)
        feed.reward(t)
        assert feed.assembler.num_pending <= 1000
    assert feed.assembler.num_pending == 0


def test_actions_within_the_tolerance_join():
    feed = Feed(tolerance=2)
    feed.assembler.stamp_tolerance = 2
    for t in (10, 20, 30):
        feed.assembler.add_state(t, ['x'], array('d', [t]))
        feed.assembler.actions.add_action(t + 2, ['turn'], [t])
        sample = RewardSample(0.0, t == 30, False)
        feed.episodes += feed.assembler.add_reward(t, sample)
    np.testing.assert_array_equal(feed.episodes[0].actions, [[10], [20], [30]])


def test_after_time_was_set_back_actions_join_again():
    feed = Feed()
    feed.assembler.actions.are_published = lambda: True
    for feed.begin in (100, 50):
        for t in range(1, 6):
            feed.state(t)
            feed.reward(t)
            feed.action(t)
    assert [len(e) for e in feed.episodes] == [3, 1, 3, 1]
    for episode in feed.episodes:
        np.testing.assert_array_equal(episode.actions, episode.states * [1, -1])


@pytest.mark.parametrize(
    ('names', 'values', 'cause'),
    [
        ([], [], 'malformed_action'),
        (['turn'], [1.0, 2.0], 'malformed_action'),
        (['turn', 'turn'], [1.0, 2.0], 'malformed_action'),
        (['drive', 'turn'], [1.0, float('nan')], 'malformed_action'),
        (['arm'], [1.0], 'wrong_actions'),
    ],
)
def test_actions_of_no_use_are_dropped_and_told(names, values, cause):
    feed = Feed()
    if cause == 'wrong_actions':
        feed.action(1)
    feed.assembler.actions.add_action(2, names, values)
    assert feed.assembler.dropped_messages == {cause: 1}
    assert 'an action' in feed.assembler.last_drops[cause]
