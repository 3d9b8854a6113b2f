# SPDX-License-Identifier: Apache-2.0

"""What happens between two steps, summarised; NumPy is the oracle."""

from types import SimpleNamespace as Message

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmifs_ros.collect.robot_file import RobotFileError, parse_robot_file
from cmifs_ros.collect.sampling.moments import SECOND
from cmifs_ros.collect.sampling.sampler import Sampler

FILE = """
step: {topic: /step}
channels:
  shake: {path: /shake.data, over: [mean, rms, min, max, std, count]}
  top: {path: "/pair.data[0:2]", over: max, max_age: 9}
values: {bumps: {path: /bump.data, over: count}}
reward: bumps
"""


def steps_of(windows, file=FILE):
    """Return the steps of a sampler that is sent a step's messages before each step, in 0.1 s."""
    sampler, steps = Sampler(parse_robot_file(file), None), []
    for number, messages in enumerate(windows, 1):
        time = number * SECOND // 10
        for i, (topic, value) in enumerate([*messages, ('/step', 0.0)]):
            at = time - (len(messages) - i) * 1000
            steps += sampler.add(topic, Message(data=value), at)
    return steps + sampler.flush(), sampler


numbers = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=6)


@given(st.lists(st.tuples(numbers, st.integers(0, 3)), min_size=2, max_size=6))
def test_each_step_has_the_summary_of_what_came_since_the_one_before(windows):
    messages = [
        [('/shake', v) for v in shakes]
        + [('/pair', np.array([v, -v])) for v in shakes]
        + [('/bump', 1.0)] * bumps
        for shakes, bumps in windows
    ]
    steps, _ = steps_of(messages)
    assert len(steps) == len(windows) - 1
    for step, (shakes, _), (_, bumps) in zip(steps, windows, windows[1:], strict=False):
        values = np.array(shakes)
        expected = [
            values.mean(), np.sqrt((values**2).mean()), values.min(), values.max(), values.std(),
            len(values), values.max(), -values.min(),
        ]  # fmt: skip
        np.testing.assert_allclose(step.state, expected, atol=1e-6, rtol=1e-6)
        assert step.sample.reward == bumps


def test_where_nothing_came_the_newest_value_holds_until_its_max_age():
    first = [('/shake', 2.0), ('/shake', -4.0), ('/pair', np.array([1.0, 2.0]))]
    steps, sampler = steps_of([first] + [[]] * 20)
    assert list(steps[0].state) == [-1, pytest.approx(10**0.5), -4, 2, 3, 2, 1, 2]
    assert {tuple(step.state) for step in steps[1:]} == {(-4, 4, -4, -4, 0, 0, 1, 2)}
    assert len(steps) == 10
    (said,) = sampler.missing.in_words(sampler.missing.counts)
    assert said == 'shake: silent for more than its max_age, 1 s'


def test_values_that_are_not_finite_are_left_out_unless_all_are():
    nan = float('nan')
    pair = ('/pair', np.array([1.0, 2.0]))
    steps, sampler = steps_of(
        [[('/shake', 1.0), ('/shake', nan), ('/shake', 3.0), pair], [('/shake', nan)], [], []]
    )
    assert [list(step.state[:6]) for step in steps] == [[2, pytest.approx(5**0.5), 1, 3, 1, 2]]
    assert sampler.missing.counts == {('shake', 'it is NaN'): 3}


def test_a_summary_of_its_own_name_or_a_group_of_several():
    robot = parse_robot_file(FILE)
    assert robot.channel_names[:2] == ('shake.mean', 'shake.rms')
    assert robot.channel_names[-2:] == ('top[0]', 'top[1]')
    assert robot.groups['shake'] == robot.channel_names[:6]


@pytest.mark.parametrize(
    ('entry', 'said'),
    [
        ('{path: /a.data, over: median}', "a.over is 'median'; expected one or some of mean, rms"),
        ('{path: /a.data, over: []}', 'a.over is []; expected one or some of mean'),
        ('{path: /a.data, over: [max, max]}', 'a.over is [max, max]; expected one or some of mean'),
        ('{path: /a.q, as: yaw, over: max}', 'a has over; expected numbers, without as'),
        ('{path: "/a.r[0:3]", over: [min, max]}', 'for several summaries a single value'),
    ],
)
def test_mistakes(entry, said):
    with pytest.raises(RobotFileError, match='line 2') as error:
        parse_robot_file(f'step: {{rate: 1}}\nchannels: {{a: {entry}}}\nreward: "1"\n')
    assert said in str(error.value)
