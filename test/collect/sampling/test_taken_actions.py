# SPDX-License-Identifier: Apache-2.0

"""The action of a step is what was commanded from its state on, until the next one."""

from types import SimpleNamespace as Message

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cmifs_ros.collect.robot_file.reader import parse_robot_file
from cmifs_ros.collect.sampling.moments import SECOND
from cmifs_ros.collect.sampling.sampler import Sampler

FILE = """
step: %s
channels: {x: {path: /x.data, max_age: .inf}}
actions: {turn: {path: /turn.data, max_age: 0.25}}
reward: x
episode: {terminated: "x < 0"}
"""
MS = SECOND // 1000


def steps_of(text, messages):
    """Return the steps of (topic, milliseconds, value) and the sampler."""
    sampler, steps = Sampler(parse_robot_file(text), None), []
    for topic, time, value in messages:
        stamp = Message(sec=time // 1000, nanosec=time % 1000 * MS)
        steps += sampler.add(topic, Message(data=value, header=Message(stamp=stamp)), 0)
    return steps + sampler.flush(), sampler


def action_by_hand(commands, begin, end):
    """Return the command of a step, None if there is none that still holds."""
    within = [value for time, value in commands if begin <= time < end]
    before = [value for time, value in commands if begin - 250 <= time < begin]
    return (within or before or [None])[-1]


@settings(max_examples=100, deadline=None)
@given(
    st.sets(st.integers(0, 60), max_size=40), st.randoms(use_true_random=False),
    st.sampled_from(['{topic: /x}', '{rate: 10}']),
)  # fmt: skip
def test_the_newest_command_from_the_state_on_counts_else_the_one_before(times, random, clock):
    # A state each 100 ms; commands at multiples of 50 ms, before, with and after the states.
    begin = 1000
    commands = [(begin + 50 * time, float(time)) for time in sorted(times)]
    states = [(begin + 100 * k, float(k + 1)) for k in range(31)]
    messages = [('/turn', *m) for m in commands] + [('/x', *m) for m in states]
    random.shuffle(messages)
    messages.sort(key=lambda message: message[1])  # Of equal stamps either may come first.
    steps, sampler = steps_of(FILE % clock, messages)
    found = {step.stamp // MS: step.action.tolist() for step in steps}
    expected = {
        time: [action]
        for time, _ in states[:-1]
        if (action := action_by_hand(commands, time, time + 100)) is not None
    }
    assert found == expected
    lacking = sampler.missing.in_words(sampler.missing.counts)
    assert sum(lacking.values()) == 30 - len(expected)


def test_a_step_without_its_action_breaks_the_episode_and_is_told():
    messages = [('/x', 1000 + 100 * k, 1.0) for k in range(9)] + [('/turn', 1000, 5.0)]
    steps, sampler = steps_of(FILE % '{topic: /x}', sorted(messages, key=lambda m: m[1]))
    assert [s.stamp // MS for s in steps] == [1000, 1100, 1200]
    assert sampler.missing.in_words(sampler.missing.counts) == {
        'turn: silent for more than its max_age, 0.25 s': 5
    }


def test_actions_are_written_like_channels():
    text = """
step: {topic: /x}
channels: {x: {path: /x.data, max_age: .inf}}
actions:
  mode: {path: /mode.data, one_hot: [0, 1, 2], max_age: .inf}
  effort: {path: /effort.data, over: [mean, max], max_age: .inf}
reward: x
episode: {steps: 3}
"""
    messages = [('/x', 1000 + 100 * k, 1.0) for k in range(5)]
    messages += [('/mode', 1010, 2), ('/mode', 1110, 0)]
    # A message at the time of a state is of the step that begins there.
    messages += [('/effort', 1000, 1.0), ('/effort', 1050, 3.0), ('/effort', 1100, 8.0)]
    steps, _ = steps_of(text, messages)
    robot = parse_robot_file(text)
    assert robot.action_names == ('mode.0', 'mode.1', 'mode.2', 'effort.mean', 'effort.max')
    assert robot.channel_names == ('x',)
    assert robot.topics_for([]) == ('/x', '/mode', '/effort')
    np.testing.assert_array_equal(
        [step.action for step in steps],
        [[0, 0, 1, 2, 3], [1, 0, 0, 8, 8], [1, 0, 0, 8, 8]],
    )


def test_a_reward_may_name_the_action_of_its_step():
    text = FILE.replace('reward: x', 'reward: "-abs(turn)"') % '{topic: /x}'
    messages = [('/x', 1000 + 100 * k, 1.0) for k in range(4)]
    messages += [('/turn', 1020 + 100 * k, -2.0 - k) for k in range(3)]
    steps, _ = steps_of(text, messages)
    assert [step.sample.reward for step in steps] == [-2, -3, -4]


def test_without_a_reward_steps_are_paid_nothing_where_the_action_is_the_target():
    text = FILE.replace('reward: x', 'target: action') % '{topic: /x}'
    messages = [('/x', 1000, 1.0), ('/turn', 1020, 5.0), ('/x', 1100, 1.0)]
    steps, _ = steps_of(text, messages)
    assert [(step.sample.reward, step.action.tolist()) for step in steps] == [(0.0, [5.0])]


@pytest.mark.parametrize('is_announced', [True, False])
def test_the_last_step_before_a_silence_has_its_command(is_announced):
    text = FILE.replace('"x < 0"', '/end') % '{topic: /x}'
    messages = [('/turn', 1010, 1.0), ('/x', 1000, 1.0), ('/x', 1100, 1.0), ('/turn', 1150, 2.0)]
    messages += [('/end', 1160, 1.0)] if is_announced else []
    steps, _ = steps_of(text, messages)
    assert [step.action.tolist() for step in steps] == [[1.0], [2.0]][: 1 + is_announced]
