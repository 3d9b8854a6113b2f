# SPDX-License-Identifier: Apache-2.0

"""States with gaps, readings out of range and other channels."""

from array import array
from collections import Counter
from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmifs_ros.collect.episodes.state_reader import StateReader

NAMES = ['x', 'beam']


@pytest.fixture
def drops():
    return []


@pytest.fixture
def reader(drops):
    reader = StateReader(lambda *drop: drops.append(drop))
    reader.channel_names = tuple(NAMES)
    return reader


def read(reader, *values):
    found = reader.state_of(NAMES, array('d', values))
    return None if found is None else found.tolist()


def test_out_of_range_is_the_greatest_or_least_value_so_far(reader, drops):
    assert read(reader, 0, inf) is None  # Nothing is known of the beam.
    assert read(reader, 1, 2) == [1, 2]
    assert read(reader, 2, 5) == [2, 5]
    assert read(reader, inf, inf) == [2, 5]
    assert read(reader, -inf, -inf) == [0, 2]
    (drop,) = drops
    assert drop[0] == 'not_finite'
    assert 'channel beam is inf, as 100.0% of its values so far (inf_value' in drop[1]
    reader.inf_value = 30.0
    assert read(reader, 3, inf) == [3, 30]


def test_each_beam_may_begin_out_of_range(reader):
    assert read(reader, inf, 4) is None
    assert read(reader, 3, inf) == [3, 4]


def test_a_gap_is_named_with_its_share_and_bridged_as_long_as_allowed(reader, drops):
    for step in range(3):
        assert read(reader, step, step) == [step, step]
    assert read(reader, 3, nan) is None
    assert drops[-1][1].startswith('channel beam is nan, as 25.0% of its values so far')
    reader.max_hold_steps = 2
    assert read(reader, 4, 7) == [4, 7]
    assert [read(reader, step, nan) for step in (5, 6, 7)] == [[5, 7], [6, 7], None]
    assert read(reader, 8, 8) == [8, 8]
    assert read(reader, 9, nan) == [9, 8]
    assert reader.gaps == Counter(beam=5)
    assert reader.num_states == 10


def test_states_of_other_channels_are_told_apart_from_those_that_take_turns(reader):
    assert read(reader, 1, 2) == [1, 2]
    for _ in range(3):
        assert reader.state_of(['gripper'], array('d', [1])) is None
    assert (reader.foreign, reader.num_switches) == (['gripper'], 1)
    assert read(reader, 1, 2) == [1, 2]
    assert reader.foreign == []
    assert reader.state_of(['gripper'], array('d', [1])) is None
    assert reader.num_switches == 2
    reader.clear()
    reader.channel_names = ('gripper',)
    assert reader.state_of(['gripper'], array('d', [1])).tolist() == [1]


@given(
    st.lists(st.tuples(*[st.floats(-10, 10) | st.sampled_from([nan, inf, -inf])] * 2), max_size=20),
    st.integers(0, 3),
)
def test_what_comes_out_is_finite_and_keeps_what_was_finite(states, max_hold_steps):
    reader = StateReader(lambda *drop: None)
    reader.channel_names = tuple(NAMES)
    reader.max_hold_steps = max_hold_steps
    for values in states:
        found = read(reader, *values)
        if found is None:
            assert any(value in (inf, -inf) or value != value for value in values)  # noqa: PLR0124
            continue
        for before, after in zip(values, found, strict=True):
            assert -10 <= after <= 10
            assert after == before or not -10 <= before <= 10
