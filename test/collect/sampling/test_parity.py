"""The same messages give the same episodes in whichever order the topics' messages arrive.

A running node and a bag differ in that order alone, and in when a message without a stamp was
received or recorded.
"""

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from streams import ROBOTS, arrivals, as_message, streams

from cmifs_ros.collect.episodes.pairing import EpisodeAssembler
from cmifs_ros.collect.sampling.sampler import Sampler


def collected(robot, arrived):
    """Return steps, episodes and what was left out."""
    sampler, assembler = Sampler(robot), EpisodeAssembler(1000)
    steps, episodes = [], []
    for received, topic, sent in arrived:
        steps += sampler.add(topic, as_message(topic, sent), received)
    steps += sampler.flush()
    for step in steps:
        episodes += assembler.add_state(step.stamp, list(robot.channel_names), step.state)
        episodes += assembler.add_reward(step.stamp, step.sample)
    counts = sampler.received, sampler.late, +sampler.wrong, sampler.missing
    return steps, [(e.states.tobytes(), e.rewards.tobytes()) for e in episodes], counts


@settings(max_examples=200, deadline=None)
@given(streams(), st.sampled_from(ROBOTS), st.integers(0, 2**32))
def test_node_and_bag_give_the_same_episodes(sent, robot, seed):
    random = Random(seed)
    live, bag = (arrivals(sent, robot.topics, random) for _ in range(2))
    assert collected(robot, live) == collected(robot, bag)


@pytest.mark.parametrize('robot', ROBOTS)
def test_there_are_episodes_late_and_wrong_messages_and_gaps_to_compare(robot):
    found = []

    @settings(max_examples=30, deadline=None, derandomize=True, database=None)
    @given(streams(), st.integers(0, 99))
    def collect(sent, seed):
        found.append(collected(robot, arrivals(sent, robot.topics, Random(seed))))

    collect()
    assert sum(len(episodes) for _, episodes, _ in found) > 30
    for which in range(4):
        assert sum(sum(counts[which].values()) for _, _, counts in found) > 30
