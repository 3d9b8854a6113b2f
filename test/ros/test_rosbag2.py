# SPDX-License-Identifier: Apache-2.0

"""Bags by the types that ROS 2 has installed, and by rosbag2_py: the same as by rosbags."""

import sys
from functools import partial

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not here')
pytest.importorskip('rosbags', reason='rosbags is not here')
from bags import ROBOT_OF_ALL, STORE, write_bag
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_types_from_msg

from cmifs_ros.collect.bag import episodes_of_bag
from cmifs_ros.collect.observed_bag import robot_file_of_bag
from cmifs_ros.collect.robot_file.reader import parse_robot_file
from cmifs_ros.collect.sampling.bag_reader import (
    BagError,
    messages_of,
    open_bag,
    opened,
    storages_of,
)
from cmifs_ros.ros import rosbag2
from cmifs_ros.tools.bags import bag_opener

#: The installed types with the files as rosbags' package reads them; and all by rosbag2_py.
OPENERS = {
    'installed types': partial(opened, storages=storages_of, types=rosbag2.InstalledTypes),
    'rosbag2_py': rosbag2.open_bag,
}


@pytest.fixture(params=OPENERS)
def opener(request):
    if request.param == 'rosbag2_py':
        pytest.importorskip('rosbag2_py', reason='rosbag2_py is not here')
    return OPENERS[request.param]


def content_of(recorded):
    parts = [(e.states.tobytes(), e.rewards.tobytes(), s.tobytes())
             for e, s in zip(recorded.episodes, recorded.stamps, strict=True)]  # fmt: skip
    return parts, recorded.num_read, recorded.traffic, dict(recorded.dropped)


@pytest.mark.parametrize(
    ('storage', 'compression'),
    [('mcap', None), ('db3', None), ('db3', 'FILE'), ('mcap', 'MESSAGE')],
)
def test_the_episodes_are_those_of_rosbags(tmp_path, opener, storage, compression):
    path = tmp_path / 'bag'
    write_bag(path, storage=storage, compression=compression)
    robot = parse_robot_file(ROBOT_OF_ALL)
    found = episodes_of_bag(path, robot, open_bag=opener)
    assert len(found.episodes) == 25
    assert content_of(found) == content_of(episodes_of_bag(path, robot))


def test_the_first_robot_file_is_that_of_rosbags(tmp_path, opener):
    write_bag(tmp_path / 'bag')
    text = robot_file_of_bag(tmp_path / 'bag', open_bag=opener)
    assert 'arm_position' in text
    assert text == robot_file_of_bag(tmp_path / 'bag')


def test_messages_are_in_the_order_of_time_and_only_of_the_topics_asked_for(tmp_path, opener):
    write_bag(tmp_path / 'bag')
    with opener(tmp_path / 'bag') as reader, open_bag(tmp_path / 'bag') as other:
        assert reader.topics.keys() == other.topics.keys()
        assert reader.duration == other.duration
        counts = {topic: info.msgcount for topic, info in reader.topics.items()}
        assert counts == {topic: info.msgcount for topic, info in other.topics.items()}
        found = [(t, m.data, time) for t, m, time in messages_of(reader, 'bag', ['/pay', '/noise'])]
        expected = [
            (t, m.data, time) for t, m, time in messages_of(other, 'bag', ['/pay', '/noise'])
        ]
    assert found == expected
    assert np.all(np.diff([time for _, _, time in found]) >= 0)


def test_a_type_that_is_not_installed_makes_its_topic_unreadable_and_no_other(tmp_path, opener):
    STORE.register(get_types_from_msg('float64 data', 'nobody_has_msgs/msg/Number'))
    number = STORE.types['nobody_has_msgs/msg/Number']
    float64 = STORE.types['std_msgs/msg/Float64']
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, kind in (('/odd', number), ('/x', float64)):
            name = kind.__msgtype__
            connection = writer.add_connection(topic, name, typestore=STORE)
            for i in range(7):
                data = STORE.serialize_cdr(kind(float(i)), name)
                writer.write(connection, i * 10**9, data)
    text = 'step: {topic: /x}\nchannels: {x: %s.data}\nreward: x\nepisode: {steps: 5}\n'
    found = episodes_of_bag(tmp_path / 'bag', parse_robot_file(text % '/x'), open_bag=opener)
    assert found.episodes[0].states.ravel().tolist() == [0, 1, 2, 3, 4]
    assert 'nobody_has_msgs/msg/Number is not installed here' in found.unreadable['/odd']
    with pytest.raises(BagError, match=r'/odd cannot be read: its type .* is not installed'):
        episodes_of_bag(tmp_path / 'bag', parse_robot_file(text % '/odd'), open_bag=opener)


@pytest.mark.parametrize(('rosbags', 'expected'), [(True, open_bag), (False, rosbag2.open_bag)])
def test_rosbag2_py_is_for_where_rosbags_is_not_installed(tmp_path, monkeypatch, rosbags, expected):
    (tmp_path / 'rosbag2_py.py').touch()
    monkeypatch.syspath_prepend(tmp_path)
    if not rosbags:
        monkeypatch.setitem(sys.modules, 'rosbags', None)
    assert bag_opener() is expected


def test_what_is_no_bag_is_one_sentence(tmp_path, opener):
    (tmp_path / 'bag').mkdir()
    with pytest.raises(BagError, match='cannot be read as a bag'), opener(tmp_path / 'bag'):
        pass
