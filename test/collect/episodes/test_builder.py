# SPDX-License-Identifier: Apache-2.0

"""Building of episodes by itself; what pairing and building do together is in test_pairing.py."""

from cmifs_ros.collect.episodes.builder import EpisodeBuilder, RewardSample


def feed(builder, episodes, lost=()):
    built = []
    for number, (length, is_terminated) in enumerate(episodes):
        for step in range(length):
            is_last = step == length - 1
            ends = is_last and is_terminated, is_last and not is_terminated
            if (number, step) not in lost:
                built += builder.add(
                    [step], RewardSample(1.0, *ends, number, step), 10 * number + step
                )
    return built


def test_episodes_are_counted_by_their_ends():
    builder = EpisodeBuilder(100)
    built = feed(builder, [(3, True), (3, False), (3, True), (4, True)], lost={(2, 1), (3, 0)})
    assert len(built) == 2
    assert builder.ends.ended == {'terminated': 3, 'truncated': 1}
    assert builder.ends.lost == {'terminated': {'step_gap': 1, 'joined_midway': 1}}


def test_time_that_is_set_back_between_two_episodes_drops_none():
    builder = EpisodeBuilder(100)
    assert len(feed(builder, [(3, True)])) == 1
    builder.set_back()
    assert len(feed(builder, [(3, True)])) == 1
    assert not builder.dropped
    feed(builder, [(3, True)], lost={(0, 2)})
    builder.set_back()
    assert builder.dropped == {'time_backwards': 1}
