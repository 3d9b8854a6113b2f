# SPDX-License-Identifier: Apache-2.0

"""Several bags: a step counts once, whatever recorded it, and what is doubtful is told."""

from dataclasses import replace

import numpy as np
import pytest

from cmifs_ros.collect.outline import outline_of, trace_of
from cmifs_ros.collect.pooling import episodes_of_share, pooled
from cmifs_ros.collect.recorded_episodes import RecordedEpisodes, RecordingError
from cmifs_ros.core import Episode

SECOND = 10**9


def drive(seed=0, num_steps=400):
    """Return states that take their time, of a drive of 10 steps a second."""
    return np.cumsum(np.random.default_rng(seed).normal(size=(num_steps, 3)), axis=0)


def recorded(states, begin=0, window=25, names=('x', 'y', 'z')):
    """Return a bag of windows of a drive, whose first step is at `begin` of 0.1 s each."""
    stamps = (begin + np.arange(len(states))) * SECOND // 10
    cuts = range(window, len(states) + 1, window)
    parts = [slice(cut - window, cut) for cut in cuts]
    episodes = [Episode(states[part], np.ones(window)) for part in parts]
    stamps = [stamps[part] for part in parts]
    return RecordedEpisodes(names, episodes, len(states), stamps=stamps)


def pool_of(bags, by='none', asked=None):
    """Return the pool of bags, and its episodes; note which bags are asked for their trace."""

    def trace(number):
        if asked is not None:
            asked.append(number)
        return trace_of(bags[number][1])

    pool = pooled([(path, outline_of(bag)) for path, bag in bags], trace, by)
    episodes = [e for s in pool.shares for e in episodes_of_share(bags[s.recording][1], s)]
    assert pool.lengths.tolist() == [len(episode) for episode in episodes]
    for (number, i), episode in zip(pool.origins, episodes, strict=True):
        np.testing.assert_array_equal(bags[number][1].episodes[i].states, episode.states)
    return pool, episodes


def steps_of(episodes):
    return [tuple(state) for episode in episodes for state in episode.states]


def test_a_second_recorder_that_began_later_adds_only_what_the_first_lacks():
    states = drive()
    first, second = recorded(states[:300]), recorded(states[53:], 53)
    pool, episodes = pool_of([('a', first), ('b', second)])
    assert len(set(steps_of(episodes))) == len(steps_of(episodes))
    # The first has 300 steps; of the second's windows, from 53 on, those from 303 on are new.
    assert len(episodes) == 12 + 3
    assert pool.origins == [(0, i) for i in range(12)] + [(1, 10), (1, 11), (1, 12)]
    assert pool.notes == [
        'b repeats 247 steps of a',
        'b: 10 of 13 episodes left out, because they were recorded twice',
    ]


def test_windows_that_overlap_are_thinned_until_they_do_not():
    states = drive()
    bags = [(str(b), recorded(states[b : b + 50], b, 50)) for b in range(0, 351, 25)]
    _, episodes = pool_of(bags)
    assert len(set(steps_of(episodes))) == len(steps_of(episodes)) == 400


@pytest.mark.parametrize('share', [0.02, 0.2])
def test_recorders_that_see_messages_without_stamps_in_another_order_are_found_too(share):
    """Some of their steps have another value, and all their stamps differ a little."""
    states, rng = drive(), np.random.default_rng(1)
    again = states.copy()
    again[rng.random(len(again)) < share, 0] += 1.0
    second = recorded(again)
    jitter = [stamps + rng.integers(-(10**7), 10**7, len(stamps)) for stamps in second.stamps]
    second.stamps[:] = jitter
    _, episodes = pool_of([('a', recorded(states)), ('b', second)])
    assert len(episodes) <= 16 + share * 25


@pytest.mark.parametrize(('source', 'is_told'), [('none', True), ('bag', False), ('folder', True)])
def test_two_robots_at_the_same_time_are_kept_and_told_unless_they_are_told_apart(source, is_told):
    bags = [('fleet/a', recorded(drive(0))), ('fleet/b', recorded(drive(1)))]
    pool, episodes = pool_of(bags, source)
    assert len(episodes) == 32
    assert [('overlap in time' in note) for note in pool.notes] == [True] * is_told
    sources = [episode.source for episode in episodes]
    assert len(set(sources)) == (2 if source == 'bag' else 1)
    assert (sources[0] == '') == (source == 'none')


def test_bags_are_in_the_order_of_time_and_nothing_is_told_of_those_apart():
    states = drive()
    late, early = recorded(states[200:], 200), recorded(states[:200])
    pool, episodes = pool_of([('late', late), ('early', early)])
    assert steps_of(episodes) == [tuple(state) for state in states]
    assert pool.origins == [(1, i) for i in range(8)] + [(0, i) for i in range(8)]
    assert pool.notes == []
    assert pool.step_seconds == pytest.approx(0.1)


def test_bags_of_other_channels_are_refused():
    bags = [('a', recorded(drive())), ('b', recorded(drive(), 900, names=('x', 'y', 'w')))]
    said = 'b has other channels than a; expected the same: it lacks z and it also has w'
    with pytest.raises(RecordingError, match=said):
        pool_of(bags)
    bags[1] = 'b', recorded(drive(), 900, names=('y', 'x', 'z'))
    with pytest.raises(RecordingError, match='expected the same: their order differs'):
        pool_of(bags)


def test_without_episodes_nothing_is_known():
    pool, episodes = pool_of([('a', recorded(drive(num_steps=3)))])
    assert (episodes, pool.channel_names) == ([], ())
    assert np.isnan(pool.step_seconds)


def acting(bag, names=('turn',)):
    """Return the bag with an action at each step."""
    episodes = [replace(e, actions=np.ones((len(e), len(names)))) for e in bag.episodes]
    return replace(bag, episodes=episodes, action_names=names)


def test_bags_without_actions_are_left_out_where_most_have_some_else_all_do_without():
    many, few = recorded(drive(0, 100)), recorded(drive(1, 50), 1000)
    pool, episodes = pool_of([('b', few), ('a', acting(many))])
    assert (len(episodes), pool.action_names) == (4, ('turn',))
    assert pool.origins == [(1, i) for i in range(4)]
    assert pool.notes == ['4 of 6 episodes have an action at every step: the others are not used']
    pool, episodes = pool_of([('a', many), ('b', acting(few))])
    assert (len(episodes), len(pool.origins), pool.action_names) == (6, 6, ())
    assert {episode.actions.shape for episode in episodes} == {(25, 0)}
    assert pool.notes == ['2 of 6 episodes have an action at every step: actions are not used']


def test_bags_of_other_actions_are_refused():
    one, other = acting(recorded(drive(0, 50))), acting(recorded(drive(1, 50), 1000), ('drive',))
    said = 'b has other actions than a; expected the same: it lacks turn and it also has drive'
    with pytest.raises(RecordingError, match=said):
        pool_of([('a', one), ('b', other)])


def test_only_bags_that_overlap_in_time_are_compared_step_by_step():
    bags = [(name, recorded(drive(i), 1000 * i)) for i, name in enumerate('abcd')]
    bags.append(('e', recorded(drive(9), 2100)))
    asked = []
    pool_of(bags, 'bag', asked)
    assert sorted(asked) == [2, 4]


def test_copies_of_whole_episodes_are_told_whenever_they_were_recorded():
    first, later = recorded(drive(0, 100)), recorded(drive(0, 50), 5000)
    without_times = replace(first, stamps=None)
    pool, episodes = pool_of([('a', first), ('b', later), ('c', without_times)])
    assert len(episodes) == 4
    said = 'left out, because they were recorded twice, with all their values'
    assert pool.notes == [f'b: 2 of 2 episodes {said}', f'c: 4 of 4 episodes {said}']
