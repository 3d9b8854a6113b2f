# SPDX-License-Identifier: Apache-2.0

"""The newest values for control: of the selected channels alone, and at once."""

from math import inf, nan
from types import SimpleNamespace as Message

import pytest

from cmifs_ros.collect.robot_file.reader import parse_robot_file
from cmifs_ros.collect.sampling.newest_values import NewestValues

SECOND = 1_000_000_000
ROBOT = parse_robot_file("""
step: {topic: /a}
channels:
  a: /a.data
  pair: {path: "/pair.data[0:2]", max_age: 2}
  map: {path: /map.data, max_age: .inf}
  mode: {path: /mode.data, one_hot: [0, 1]}
reward: a
""")
NAMES = ['a', 'pair[0]', 'pair[1]', 'map', 'mode.0', 'mode.1']


@pytest.fixture
def newest():
    return NewestValues(ROBOT)


def take(newest, seconds=0.0, **values):
    for topic, value in values.items():
        newest.take(f'/{topic}', Message(data=value), int(seconds * SECOND))


def state(newest, seconds=0.0):
    found = newest.state(int(seconds * SECOND))
    return None if found is None else found.tolist()


def test_before_a_selection_it_has_all_channels_in_the_order_of_the_file(newest):
    take(newest, mode=1, pair=[2.0, 3.0], a=1.0, map=4.0)
    assert newest.names == NAMES
    assert state(newest) == [1, 2, 3, 4, 0, 1]
    take(newest, a=5.0)
    assert state(newest)[0] == 5
    assert newest.missing == {}


def test_channels_that_are_not_selected_matter_nothing(newest):
    newest.select({'pair[1]', 'a'}, ['a', 'pair[1]'])
    take(newest, a=1.0, pair=[nan, 3.0])
    assert state(newest) == [1, 3]
    assert newest.missing == {}


def test_it_knows_whether_channels_have_messages_that_are_still_valid(newest):
    newest.select({'a'}, ['a'])
    take(newest, a=1.0)
    take(newest, pair=[2.0, 3.0])
    assert newest.has(['a', 'pair[1]'], 0)
    assert newest.has(['pair[1]'], 2 * SECOND)
    assert not newest.has(['a', 'pair[1]'], 2 * SECOND)  # a is older than its max_age of 1 s.
    assert not newest.has(['mode.0'], 0)
    assert not newest.has(['map'], 0)  # It never expires, but has not spoken.
    take(newest, map=1.0)
    assert newest.has(['map'], 500 * SECOND)


def test_a_full_layout_has_nan_for_what_is_not_selected(newest):
    newest.select({'pair[1]'}, NAMES)
    take(newest, a=1.0, pair=[2.0, 3.0])
    assert state(newest) == pytest.approx([nan, nan, 3, nan, nan, nan], nan_ok=True)
    assert newest.missing == {}


def test_there_is_no_state_until_each_channel_has_spoken_or_a_second_after_the_first(newest):
    assert state(newest) is None
    assert state(newest, 100) is None
    assert newest.missing == dict.fromkeys(['a', 'pair', 'map', 'mode'], 'no message yet')
    take(newest, 100, a=1.0, mode=1)
    assert state(newest, 100) is None
    take(newest, 101, a=2.0, pair=[2.0, 3.0])
    assert state(newest, 101) is None
    assert newest.missing == {'map': 'no message yet'}
    newest.select({'a', 'pair[1]'}, ['a', 'pair[1]'])
    assert state(newest, 101) == [2, 3]
    newest.select({'a', 'map'}, ['a', 'map'])
    assert state(newest, 101) == pytest.approx([2, nan], nan_ok=True)  # It does not stop again.


def test_what_is_gone_is_nan_with_its_cause_and_comes_back(newest):
    take(newest, a=1.0, pair=[2.0, 3.0], mode=0)
    assert state(newest) is None
    assert state(newest, 1.1) == pytest.approx([nan, 2, 3, nan, nan, nan], nan_ok=True)
    silent = 'silent for more than its max_age, 1 s'
    assert newest.missing == {'a': silent, 'map': 'no message yet', 'mode': silent}
    take(newest, 2.5, a=4.0, map=5.0, mode=7)
    assert state(newest, 2.5) == pytest.approx([4, nan, nan, 5, nan, nan], nan_ok=True)
    assert newest.missing == {'pair': 'silent for more than its max_age, 2 s', 'mode': 'it is nan'}
    take(newest, 2.5, a=inf, pair=[1.0, 2.0])
    assert state(newest, 2.5)[:3] == pytest.approx([nan, 1, 2], nan_ok=True)
    assert newest.missing['a'] == 'it is inf'


def test_a_message_without_the_field_changes_nothing(newest):
    take(newest, a=1.0, pair=[2.0, 3.0])
    take(newest, a='text', pair=[1.0])
    newest.take('/a', Message(), 0)
    newest.select(NAMES[:3], NAMES[:3])
    assert state(newest) == [1, 2, 3]


def test_what_was_latched_before_it_was_selected_counts(newest):
    newest.select({'a'}, ['a'])
    take(newest, a=1.0, map=4.0)
    newest.select({'a', 'map'}, ['a', 'map'])
    assert state(newest, 0.5) == [1, 4]
    assert state(newest, 500) == pytest.approx([nan, 4], nan_ok=True)


PARTS = parse_robot_file("""
step: {topic: /a}
channels:
  a: /a.data
  arm: "/joints.position{shoulder,elbow}"
  hand: {path: "/joints.position{grip}", max_age: 3}
  map: {path: "/tf.transforms{map}.x", max_age: .inf, over: [mean, count]}
  base: "/tf.transforms{base}.x"
  second: "/tf.transforms[1].x"
reward: a
""")


def joints(**values):
    return Message(name=list(values), position=list(values.values()))


def frames(**values):
    return Message(transforms=[Message(child_frame_id=name, x=x) for name, x in values.items()])


@pytest.mark.parametrize('before', [['a'], PARTS.channel_names])
def test_where_several_nodes_fill_a_topic_each_channel_has_its_own_newest_value(before):
    newest = NewestValues(PARTS)
    newest.select(before, before)
    newest.take('/a', Message(data=1.0), 0)
    newest.take('/tf', frames(map=6.0, base=8.0), 0)
    newest.take('/tf', frames(map=7.0), SECOND)
    newest.take('/joints', joints(shoulder=2.0, elbow=3.0), SECOND)
    assert newest.has(['arm.elbow', 'map.mean', 'base', 'second'], SECOND)
    assert not newest.has(['hand'], SECOND)
    newest.take('/joints', joints(grip=4.0, other=0.0), 2 * SECOND)
    newest.take('/tf', frames(other=0.0), 2 * SECOND)
    newest.take('/a', Message(data=5.0), 2 * SECOND)
    assert newest.has(['arm.elbow', 'hand', 'map.mean'], 2 * SECOND)
    for gone in ('base', 'second'):  # They spoke two seconds ago.
        assert not newest.has([gone], 2 * SECOND)
    names = ['a', 'arm.shoulder', 'arm.elbow', 'hand', 'map.mean', 'base', 'second']
    newest.select(names, names)
    assert state(newest, 2) == pytest.approx(
        [5, 2, 3, 4, 7.0 if before == ['a'] else 6.5, nan, nan], nan_ok=True
    )
    assert set(newest.missing) == {'base', 'second'}


def test_where_the_clock_is_set_back_what_was_received_before_counts_from_then_on(newest):
    newest.select({'a', 'map'}, ['a', 'map'])
    take(newest, 100.0, a=1.0, map=4.0)
    assert state(newest, 100.0) == [1, 4]
    assert state(newest, 3.0) == [1, 4]
    assert state(newest, 4.5) == pytest.approx([nan, 4], nan_ok=True)
    take(newest, 4.6, a=2.0)
    assert state(newest, 4.6) == [2, 4]
    assert newest.has(['a'], int(5.6 * SECOND))
    assert not newest.has(['a'], int(5.7 * SECOND))
    assert newest.has(['map'], 2 * SECOND)  # Set back again; a stays as old as it was.
    assert not newest.has(['a'], 2 * SECOND)


def test_a_summary_is_of_what_came_since_the_newest_state():
    robot = parse_robot_file("""
step: {topic: /a}
channels:
  shake: {path: /shake.data, over: [mean, max, count]}
  hits: {path: /hits.data, over: count}
reward: "0"
""")
    newest = NewestValues(robot)
    take(newest, shake=1.0, hits=0.0)
    take(newest, shake=3.0, hits=0.0)
    assert newest.names == ['shake.mean', 'shake.max', 'shake.count', 'hits']
    assert state(newest) == [2, 3, 2, 2]
    assert state(newest, 0.5) == [3, 3, 0, 0]  # The newest message still holds.
    newest.select({'shake.max', 'hits'}, ['shake.max', 'hits'])
    take(newest, 0.6, shake=nan)
    assert state(newest, 0.6) == pytest.approx([nan, 0], nan_ok=True)
    assert newest.missing == {'shake': 'it is NaN'}
    assert state(newest, 5.0) == pytest.approx([nan, 0], nan_ok=True)
    assert newest.missing == {'shake': 'silent for more than its max_age, 1 s'}
