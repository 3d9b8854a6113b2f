# SPDX-License-Identifier: Apache-2.0

"""A bag gives the episodes of a running node, also of message types that the bag alone knows."""

from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip('rosbags', reason='rosbags is not here')
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from streams import ROBOTS, STATUS, arrivals, as_message, collected, streams

from cmifs_ros.collect.bag import episodes_of_bag
from cmifs_ros.collect.robot_file.reader import parse_robot_file

STORE = get_typestore(Stores.ROS2_JAZZY)
for kind, field in (('Value', 'float64 data'), ('Rays', 'float64[] data')):
    definition = f'std_msgs/Header header\n{field}'
    STORE.register(get_types_from_msg(definition, f'nobody_has_msgs/msg/{kind}'))
KINDS = {
    '/odom': 'nobody_has_msgs/msg/Value',
    '/pay': 'nobody_has_msgs/msg/Value',
    '/turn': 'nobody_has_msgs/msg/Value',
    '/scan': 'nobody_has_msgs/msg/Rays',
    '/radio': 'std_msgs/msg/Float64',
    '/goal': 'std_msgs/msg/Float64',
    STATUS: 'action_msgs/msg/GoalStatusArray',
}


def serialized(topic, sent):
    types, message = STORE.types, as_message(topic, sent)
    time = types['builtin_interfaces/msg/Time']
    if topic == STATUS:
        entries = []
        for entry in message.status_list:
            goal = types['unique_identifier_msgs/msg/UUID'](
                np.array(entry.goal_info.goal_id.uuid, np.uint8)
            )
            info = types['action_msgs/msg/GoalInfo'](goal, time(0, 0))
            entries.append(types['action_msgs/msg/GoalStatus'](info, entry.status))
        fields = [entries]
    else:
        fields = [np.array(message.data) if topic == '/scan' else message.data]
    if sent.stamp is not None:
        stamp = message.header.stamp
        fields.insert(0, types['std_msgs/msg/Header'](time(stamp.sec, stamp.nanosec), ''))
    return STORE.serialize_cdr(types[KINDS[topic]](*fields), KINDS[topic])


def write(path, arrived, topics, storage):
    with Writer(path, version=9, storage_plugin=storage) as writer:
        connections = {t: writer.add_connection(t, KINDS[t], typestore=STORE) for t in topics}
        for recorded, topic, sent in arrived:
            writer.write(connections[topic], recorded, serialized(topic, sent))


# A recorder's own clock, by which bags are ordered, is not set back in these.
@settings(max_examples=15, deadline=None)
@given(
    streams(is_set_back=False), st.sampled_from(ROBOTS), st.integers(0, 2**32),
    st.sampled_from(StoragePlugin),
)  # fmt: skip
def test_a_bag_gives_the_episodes_of_the_node(tmp_path_factory, sent, robot, seed, storage):
    random = Random(seed)
    path = tmp_path_factory.mktemp('bags') / 'bag'
    live = collected(robot, arrivals(sent, robot.topics, random))
    in_time = [a for a in arrivals(sent, robot.topics, random) if id(a[2]) not in live.late]
    write(path, in_time, robot.topics, storage)
    bag = episodes_of_bag(path, robot)
    assert [
        (e.states.tobytes(), e.rewards.tobytes(), e.actions.tobytes()) for e in bag.episodes
    ] == live.episodes
    assert bag.action_names == ('turn', 'drive')
    assert bag.num_read + len(live.late) == live.received
    assert not any(what.startswith('late') for what in bag.dropped)


@pytest.mark.parametrize('has_clock', [True, False])
def test_a_bag_that_has_the_simulated_clock_is_read_by_it(tmp_path, has_clock):
    robot = parse_robot_file(
        'step: {topic: /odom}\nchannels: {x: /odom.data, radio: /radio.data}\n'
        'reward: x\nepisode: {steps: 4}\n'
    )
    types, kinds = STORE.types, KINDS | {'/clock': 'rosgraph_msgs/msg/Clock'}
    time = types['builtin_interfaces/msg/Time']
    topics = ['/odom', '/radio', *(['/clock'] if has_clock else [])]
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {t: writer.add_connection(t, kinds[t], typestore=STORE) for t in topics}
        for i in range(20):
            stamp = time(50 + i // 10, i % 10 * 10**8)
            sent = {
                '/clock': types[kinds['/clock']](stamp),
                '/radio': types[kinds['/radio']](float(i)),
                '/odom': types[kinds['/odom']](types['std_msgs/msg/Header'](stamp, ''), 2.0 * i),
            }
            for number, topic in enumerate(t for t in sent if t in topics):
                # Ten times faster than the robot's own time, and years later.
                recorded = 1_700_000_000 * 10**9 + i * 10**7 + number
                writer.write(
                    connections[topic], recorded, STORE.serialize_cdr(sent[topic], kinds[topic])
                )
    bag = episodes_of_bag(tmp_path / 'bag', robot)
    if has_clock:
        # What the last of four steps reaches is no step.
        assert [e.states.tolist() for e in bag.episodes] == [
            [[2.0 * i, float(i)] for i in range(begin, begin + 4)] for begin in (0, 5, 10, 15)
        ][: len(bag.episodes)]
        assert len(bag.episodes) >= 3
        assert bag.num_read == 40
    else:
        assert not bag.episodes
        assert any('wrong messages of /radio, such as: ' in cause for cause in bag.dropped)
