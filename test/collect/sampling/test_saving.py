# SPDX-License-Identifier: Apache-2.0

"""Saving: when topics are off, and that no step is made of an episode that lacks one."""

import itertools
from dataclasses import replace
from random import Random
from types import SimpleNamespace as Message

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from selections import selection, sensor

from cmifs_ros.collect.robot_file.reader import RobotFileError, parse_robot_file
from cmifs_ros.collect.sampling.sampler import Sampler
from cmifs_ros.collect.sampling.saving import Saving

FILE = """
step: {topic: /odom}
channels:
  x: /odom.x
  imu: "/imu.data[0:2]"
  scan: /scan.data
  map: {path: /map.data, max_age: .inf}
  battery: /battery.data
values: {distance: /battery.distance}
reward: "before(distance) - distance"
episode: {steps: 5}
saving: {after: 2, explore_every: 4, explore_episodes: 3}
"""
ROBOT = parse_robot_file(FILE)
SENSORS = {'x': ('x',), 'imu': ('imu[0]', 'imu[1]'), 'scan': ('scan',), 'map': ('map',),
           'battery': ('battery',)}  # fmt: skip


def selected(number, dispensable, *names, **more):
    """Return a selection of some sensors, of which others are dispensable."""
    sensors = [
        replace(
            sensor(name, pvalue=0.5), channels=channels, is_selected=name in names,
            status='dispensable' if name in dispensable else 'undecided',
        )
        for name, channels in SENSORS.items()
    ]  # fmt: skip
    return selection(*sorted(sensors, key=lambda s: not s.is_selected), number=number, **more)


EVENTS = st.lists(
    st.one_of(
        st.sampled_from(['whole', 'whole', 'whole', 'broken', 'explore']),
        st.tuples(
            st.frozensets(st.sampled_from(['imu', 'scan', 'map', 'battery']), min_size=2),
            st.sampled_from(['', '', '', '', 'the data have changed']),
            st.sampled_from([0, 0, 0, 0, 7]),
        ),
    ),
    max_size=60,
)


@settings(max_examples=300, deadline=None)
@given(EVENTS)
def test_topics_are_off_only_while_the_last_selections_agree_and_come_back_in_time(events):
    saving, newest, since_on, since_off = Saving(ROBOT), [], 0, 0
    for number, event in enumerate(events):
        before = saving.off
        if event == 'explore':
            saving.explore('asked')
            assert not saving.off
            newest, since_on = [], 0
        elif isinstance(event, str):
            saving.end_episode(event == 'whole')
            if before:
                since_off += 1
                assert (saving.off == before) == (since_off < 4)
            else:
                since_on += event == 'whole'
        else:
            dispensable, doubt, outdated = event
            # A doubt is told by the selection in use, which comes again with its number.
            newest = [] if doubt else [*([] if outdated else newest), dispensable]
            one = selected(number, dispensable, 'x', doubt=doubt, outdated=outdated)
            saving.select(one)
            saving.select(one)  # The same again counts once.
        agreed = frozenset.intersection(*newest[-2:]) if len(newest) >= 2 else frozenset()
        # The map is latched, and the battery tells the reward.
        may_be_off = {f'/{name}' for name in agreed & {'imu', 'scan'}}
        assert saving.off <= may_be_off
        if not before and saving.off:
            assert saving.off == may_be_off
            assert since_on >= 3
            since_off = 0
        if before and not saving.off:
            since_on = 0
        if not before and isinstance(event, str) and event != 'explore':
            assert bool(saving.off) == (bool(may_be_off) and since_on >= 3)


def test_the_cycle_in_words():
    saving = Saving(ROBOT)
    said = [saving.in_words()]
    for number in (1, 2):
        saving.select(selected(number, {'imu', 'scan'}, 'x'))
        said.append(saving.in_words())
    for _ in range(3):
        saving.end_episode(is_whole=True)
    said.append(saving.in_words())
    for _ in range(4):
        saving.end_episode(is_whole=False)
    said.append(saving.in_words())
    saving.select(selected(3, {'imu'}, 'x'))
    saving.select(selected(4, {'scan'}, 'x'))
    said.append(saving.in_words())
    saving.select(selected(5, {'scan'}, 'x', 'imu'))
    said.append(saving.in_words())
    assert said == [
        'all topics are on: same selection 0 of 2 times',
        'all topics are on: same selection 1 of 2 times',
        'all topics are on: 0 of 3 complete episodes',
        'switched off: /imu, /scan; on again after 4 episodes',
        'all topics are on (after 4 episodes without them): 0 of 3 complete episodes',
        'all topics are on (after 4 episodes without them): none can go',
        'all topics are on (the selection has changed): same selection 1 of 2 times',
    ]


def test_why_earlier_selections_no_longer_count_is_named_though_all_topics_are_on():
    saving = Saving(ROBOT)
    for number in (1, 2):
        saving.select(selected(number, {'imu', 'scan'}, 'x'))
    saving.select(selected(2, {'imu', 'scan'}, 'x', doubt='the data have changed: x'))
    doubted = saving.in_words()
    saving.select(selected(3, {'imu', 'scan'}, 'x', outdated=9))
    outdated = saving.in_words()
    saving.explore('asked')
    assert [doubted, outdated, saving.in_words()] == [
        'all topics are on (the data have changed: x): same selection 0 of 2 times',
        'all topics are on (the task has changed): same selection 1 of 2 times',
        'all topics are on (asked): same selection 0 of 2 times',
    ]


def test_what_goes_after_the_episode_is_named():
    saving = Saving(ROBOT)
    for _ in range(9):
        saving.end_episode(is_whole=True)
    for number in (1, 2):
        saving.select(selected(number, {'imu', 'scan'}, 'x'))
    assert saving.in_words() == 'all topics are on; off after this episode: /imu, /scan'
    saving.end_episode(is_whole=True)
    assert saving.in_words() == 'switched off: /imu, /scan; on again after 4 episodes'


def test_a_channel_that_is_selected_keeps_its_topic_though_it_is_dispensable():
    saving = Saving(ROBOT)
    for number in (1, 2):
        saving.select(selected(number, {'imu', 'scan'}, 'x', 'scan'))
    for _ in range(3):
        saving.end_episode(is_whole=True)
    assert saving.off == {'/imu'}


def test_without_the_key_nothing_is_switched_off():
    saving = Saving(parse_robot_file(FILE.partition('saving')[0]))
    for number in range(1, 9):
        saving.select(selected(number, {'imu', 'scan'}, 'x'))
        saving.end_episode(is_whole=True)
        assert not saving.off


@pytest.mark.parametrize(
    ('wrong', 'said'),
    [
        ('saving: {after: 0}', "line 12: saving.after is '0'; expected a whole number from 1"),
        ('saving: {after: 2.5}', "saving.after is '2.5'; expected a whole number from 1"),
        ('saving: {every: 5}', "saving has 'every'; expected after, explore_every"),
        ('saving: true', "saving is 'true'; expected a mapping"),
    ],
)
def test_mistakes_in_the_file(wrong, said):
    with pytest.raises(RobotFileError, match=said):
        parse_robot_file(FILE.partition('saving')[0] + wrong)


def test_saving_needs_to_know_where_episodes_end():
    with pytest.raises(RobotFileError, match='saving needs episode'):
        parse_robot_file(FILE.replace('episode: {steps: 5}', ''))


STREAM = """
step: %s
channels:
  x: /odom.data
  scan: {path: "/scan.data[0:2]", max_age: 0.4}
  radio: {path: /radio.data, max_age: 0.5}
values: {distance: {path: /goal.data, max_age: .inf}}
reward: x
episode: {terminated: "distance < 0.1", steps: 7}
saving: {after: 1, explore_every: 2, explore_episodes: 1}
"""
#: What a selection says of the robot of `STREAM`.
STANDS = selection(
    sensor('x', is_selected=True, pvalue=0.01, status='confirmed'),
    replace(
        sensor('scan', pvalue=0.9), channels=('scan[0]', 'scan[1]'), status='dispensable'
    ),
    sensor('radio', pvalue=0.9, status='dispensable'),
    number=1,
)  # fmt: skip


def grouped(steps):
    """Return the steps by episode, without the numbers of the episodes."""
    found = {}
    for step in steps:
        found.setdefault(step.sample.episode, []).append(
            (step.stamp, step.state.tobytes(), step.sample._replace(episode=0))
        )
    return list(found.values())


def messages(seed, count):
    """Yield nanoseconds, topic and message: one of each topic a step, some lost."""
    random = Random(seed)
    for i in range(count):
        for topic in ('/goal', '/scan', '/radio', '/odom'):
            value = random.random()
            if topic == '/odom' or random.random() > 0.05:
                data = [value, value] if topic == '/scan' else value
                yield 10**12 + i * 10**8, topic, Message(data=data)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from(['{rate: 10}', '{topic: /odom}']), st.booleans())
def test_what_is_learned_from_while_saving_is_a_part_of_all_episodes(seed, clock, is_asked):
    robot = parse_robot_file(STREAM % clock)
    plain, saving, random = Sampler(robot), Sampler(robot), Random(seed)
    saving.saving.select(STANDS)
    every, some, num_saved, number = [], [], 0, 1
    for time, topic, message in messages(seed, 300):
        every += plain.add(topic, message, time)
        if topic in saving.saving.off:
            num_saved += 1
        else:
            some += saving.add(topic, message, time)
        if is_asked and random.random() < 0.01:
            saving.saving.explore('asked')
            number += 1
            saving.saving.select(replace(STANDS, number=number))
    every, some = grouped(every + plain.flush()), grouped(some + saving.flush())
    # The last one is open still.
    assert all(episode in every for episode in some[:-1])
    assert any(episode[: len(some[-1])] == some[-1] for episode in every)
    assert 0 < len(some) < len(every)
    assert num_saved > 50


def test_an_episode_during_which_a_topic_comes_back_is_not_learned_from():
    robot = parse_robot_file(STREAM % '{topic: /odom}')
    sampler, steps, times = Sampler(robot), [], itertools.count()
    sampler.saving.select(STANDS)

    def drive(count, *topics):
        for i in itertools.islice(times, count):
            for topic in ('/goal', '/odom', *topics):
                data = [i, i] if topic == '/scan' else 1 + i
                steps.extend(sampler.add(topic, Message(data=data), 10**12 + i * 10**8))

    while not sampler.saving.off:
        drive(1, '/scan', '/radio')
    assert len(steps) == 7  # a complete episode
    drive(3)
    sampler.saving.explore('asked')
    drive(40, '/scan')  # The radio is silent still.
    assert set(sampler.away) == {'/radio'}
    assert len(steps) == 7
    back = next(times)
    drive(60, '/scan', '/radio')
    assert len(steps) > 7
    assert steps[7].stamp > 10**12 + back * 10**8
    assert not sampler.missing.counts
    assert not sampler.ends.lost
