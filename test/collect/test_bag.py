# SPDX-License-Identifier: Apache-2.0

"""Bags as robots record them: resets of a simulation, slow pipelines, sensors that fail."""

import numpy as np
import pytest

pytest.importorskip('rosbags', reason='rosbags is not here')
from bags import STORE
from rosbags.rosbag2 import StoragePlugin, Writer

from cmifs_ros.collect.bag import episodes_of_bag
from cmifs_ros.collect.observed_bag import robot_file_of_bag
from cmifs_ros.collect.robot_file.reader import parse_robot_file
from cmifs_ros.collect.sampling.bag_reader import BagError
from cmifs_ros.collect.traffic import rates_of

SECOND = 10**9
POINT, CLOCK = 'geometry_msgs/msg/PointStamped', 'rosgraph_msgs/msg/Clock'


def time_of(nanoseconds):
    return STORE.types['builtin_interfaces/msg/Time'](*divmod(nanoseconds, SECOND))


def point(stamp, x, y=0.0):
    header = STORE.types['std_msgs/msg/Header'](time_of(stamp), '')
    return STORE.types[POINT](header, STORE.types['geometry_msgs/msg/Point'](float(x), y, 0.0))


def write(path, messages):
    """Write (recorded, topic, message)."""
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {}
        for recorded, topic, message in sorted(messages, key=lambda m: m[0]):
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic], recorded, STORE.serialize_cdr(message, kind))
    return path


RESET = parse_robot_file(
    'step: {topic: /speed}\nchannels: {slip: /speed.point.x}\nvalues: {done: /done.point.x}\n'
    'reward: 0 - slip\nepisode: {terminated: done}\n'
)


@pytest.mark.parametrize('count', [2, 3, 4])
def test_what_nodes_publish_in_turn_is_in_a_robot_file_however_long_the_bag(tmp_path, count):
    kinds = STORE.types
    messages = []
    for k in range(1000 * count):
        value = kinds['diagnostic_msgs/msg/KeyValue']('temperature', f'{k / 7:.2f}')
        status = kinds['diagnostic_msgs/msg/DiagnosticStatus'](
            0, f'node{k % count}', 'a message', 'its hardware', [value]
        )
        header = kinds['std_msgs/msg/Header'](time_of(k * SECOND // 100), '')
        array = kinds['diagnostic_msgs/msg/DiagnosticArray'](header, [status])
        messages.append((k * SECOND // 100, '/diagnostics', array))
    text = robot_file_of_bag(write(tmp_path / 'bag', messages))
    for number in range(count):
        assert f'"/diagnostics.status{{node{number}}}.values{{temperature}}.value"' in text
    assert robot_file_of_bag(tmp_path / 'bag') == text


@pytest.mark.parametrize('has_clock', [True, False])
@pytest.mark.parametrize('seconds', [3, 70])
def test_a_simulation_that_is_reset_after_each_episode(tmp_path, seconds, has_clock):
    messages, wall, count = [], 1_700_000_000 * SECOND, 10 * seconds
    for _ in range(5):
        for k in range(count + 1):
            stamp = k * SECOND // 10 + SECOND // 20
            if has_clock:
                messages.append((wall, '/clock', STORE.types[CLOCK](time_of(stamp))))
            messages.append((wall + 500, '/done', point(stamp, k == count - 1)))
            messages.append((wall + 1000, '/speed', point(stamp, k)))
            wall += SECOND // 10
    bag = episodes_of_bag(write(tmp_path / 'bag', messages), RESET)
    assert [e.states[:, 0].tolist() for e in bag.episodes] == [list(range(count - 1))] * 5
    assert not bag.dropped


SLOW_RATE = parse_robot_file(
    'step: {rate: 10.0}\nchannels: {speed: /speed.point.x,'
    ' heat: {path: /heat.point.x, max_age: 9.0}}\nreward: speed\nepisode: {steps: 20}\n'
)


@pytest.mark.parametrize('factor', [0.1, 1, 10])
def test_rates_are_those_of_the_robot_however_fast_its_simulation_runs(tmp_path, factor):
    messages, wall = [], 1_700_000_000 * SECOND
    for _ in range(2):  # The simulation is reset once.
        for k in range(601):
            wall += int(SECOND / 10 / factor)
            stamp = 5 * SECOND + k * SECOND // 10
            messages.append((wall, '/clock', STORE.types[CLOCK](time_of(stamp))))
            messages.append((wall + 1000, '/speed', point(stamp, k)))
            if k % 20 == 0:
                messages.append((wall + 500, '/heat', point(stamp, k)))
    path = write(tmp_path / 'bag', messages)
    rates = rates_of([episodes_of_bag(path, SLOW_RATE).traffic])
    assert rates['/speed'].messages == pytest.approx(10, rel=0.02)
    assert rates['/heat'].messages == pytest.approx(0.5, rel=0.05)
    text = robot_file_of_bag(path)
    assert '# Seen: 0.52 Hz (/heat) to 10 Hz (/speed).' in text
    assert 'heat_x: {path: "/heat.point.x", max_age: 6.0}' in text
    assert 'use_sim_time' in text


SLOW = parse_robot_file(
    'step: {rate: 10.0}\nchannels: {speed: /speed.point.x, seen: /seen.point.x}\n'
    'reward: speed\nepisode: {steps: 20}\n'
)


@pytest.mark.parametrize('late', [0.8, 12.0])
def test_what_a_slow_pipeline_publishes_belongs_to_the_time_of_its_stamp(tmp_path, late):
    messages, begin = [], 1_700_000_000 * SECOND
    for i in range(300):
        stamp = begin + i * SECOND // 10
        messages.append((stamp, '/speed', point(stamp, i)))
        messages.append((stamp + int((late + i % 3 / 20) * SECOND), '/seen', point(stamp, -i)))
    bag = episodes_of_bag(write(tmp_path / 'bag', messages), SLOW)
    assert len(bag.episodes) == 14
    for episode in bag.episodes:
        np.testing.assert_array_equal(episode.states[:, 0], -episode.states[:, 1])
    assert not bag.dropped


def test_losses_are_told_by_the_kind_of_end(tmp_path):
    robot = parse_robot_file(
        'step: {topic: /step}\nchannels: {a: /step.point.x, b: /step.point.y}\n'
        'values: {hit: /end.point.x, home: /end.point.y}\n'
        'reward: 0 - hit\nepisode: {terminated: hit, truncated: home}\n'
    )
    messages = []
    for i in range(200):
        stamp, fails, is_last = SECOND + i * SECOND // 10, i // 10 % 2, i % 10 == 9
        gap = float('nan') if fails and i % 10 == 5 else 1.0
        messages.append((stamp, '/step', point(stamp, i, gap)))
        messages.append(
            (stamp, '/end', point(stamp, is_last and fails, float(is_last and not fails)))
        )
    bag = episodes_of_bag(write(tmp_path / 'bag', messages), robot)
    assert len(bag.episodes) == 10
    said = (
        'episodes that ended by `terminated`: a step lacks b; none of 10 is left, but 10 of 10 '
        'that ended otherwise'
    )
    assert bag.dropped[said] == 10


def robot(**more):
    said = {'a': '/a.point.x', 'reward': 'a', 'episode': '{steps: 3}'} | more
    return parse_robot_file(
        f'step: {{topic: /a}}\nchannels: {{a: {said["a"]}, b: /b.point.x, c: /c.point.x}}\n'
        f'reward: {said["reward"]}\nepisode: {said["episode"]}\n'
    )


def late_topics(tmp_path):
    """Return a bag of 20 steps, of which /b begins at the third and /c at the fifth."""
    first = {'/a': 0, '/b': 2, '/c': 4}
    return write(
        tmp_path / 'bag',
        [
            (SECOND * (k + 9), topic, point(SECOND * (k + 9), k))
            for k in range(20)
            for topic in first
            if k >= first[topic]
        ],
    )


def test_the_beginning_of_a_bag_is_one_line_of_what_was_dropped(tmp_path):
    bag = episodes_of_bag(late_topics(tmp_path), robot())
    assert dict(bag.dropped) == {'steps at the beginning, before the first message of /c': 4}


def test_a_path_that_no_message_can_have_is_refused_before_reading(tmp_path):
    path = late_topics(tmp_path)

    def watch(messages, total):
        raise AssertionError('a message is read')

    with pytest.raises(BagError, match=r"(?m)^a: /a\.point has no field 'q'") as error:
        episodes_of_bag(path, robot(a='/a.point.q', reward='/b.point.q'), watch)
    assert len(str(error.value).splitlines()) == 3
    with pytest.raises(BagError, match=r'reward: /a\.header\.frame_id is a text'):
        episodes_of_bag(path, robot(reward='/a.header.frame_id'), watch)


def test_how_often_the_ends_were_true_is_known(tmp_path):
    bag = episodes_of_bag(late_topics(tmp_path), robot(episode='{terminated: a > -1}'))
    ((condition, counts),) = bag.ends.items()
    assert (condition.text, set(counts)) == ('terminated: a > -1', {True})
    assert (bag.episodes, bag.num_between) == ([], 16)
