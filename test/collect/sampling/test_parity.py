# SPDX-License-Identifier: Apache-2.0

"""The same messages give the same episodes, live and recorded, in whichever order they arrive.

A running node and a bag differ in that order, and in when a message without a stamp was received
or recorded. What comes too late for the node is counted by it, and is all that the bag has more.
"""

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from streams import ROBOTS, arrivals, collected, streams


@settings(max_examples=200, deadline=None)
@given(streams(), st.sampled_from(ROBOTS), st.integers(0, 2**32))
def test_node_and_bag_give_the_same_episodes(sent, robot, seed):
    random = Random(seed)
    live = collected(robot, arrivals(sent, robot.topics, random))
    in_time = [a for a in arrivals(sent, robot.topics, random) if id(a[2]) not in live.late]
    bag = collected(robot, in_time, max_lateness=None)
    assert live.episodes == bag.episodes
    assert live.steps == bag.steps
    assert live.missing == bag.missing


@settings(max_examples=100, deadline=None)
@given(streams(), st.sampled_from(ROBOTS), st.integers(0, 2**32))
def test_in_a_bag_nothing_is_late_whatever_the_order(sent, robot, seed):
    random = Random(seed)
    one, other = (
        collected(robot, arrivals(sent, robot.topics, random), max_lateness=None) for _ in range(2)
    )
    assert one == other
    assert not one.late


@pytest.mark.parametrize('robot', ROBOTS)
def test_there_are_episodes_late_and_wrong_messages_and_gaps_to_compare(robot):
    found = []

    @settings(max_examples=30, deadline=None, derandomize=True, database=None)
    @given(streams(), st.integers(0, 99))
    def collect(sent, seed):
        found.append(collected(robot, arrivals(sent, robot.topics, Random(seed))))

    collect()
    assert sum(len(run.episodes) for run in found) > 30
    assert sum(len(run.late) for run in found) > 10
    # Some do come too late, but few.
    assert sum(len(run.late) for run in found) < 0.02 * sum(run.received for run in found)
    assert sum(run.wrong for run in found) > 30
    assert sum(run.missing.total() for run in found) > 30
