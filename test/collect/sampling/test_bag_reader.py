# SPDX-License-Identifier: Apache-2.0

"""Bags as people record them: what is asked for is read, whatever else is in the file."""

import sqlite3

import numpy as np
import pytest

pytest.importorskip('rosbags', reason='rosbags is not here')
pytest.importorskip('mcap', reason='mcap is not here')
from bags import ROBOT, write_bag
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer

from cmifs_ros.collect.bag import episodes_of_bag
from cmifs_ros.collect.observed_bag import robot_file_of_bag
from cmifs_ros.collect.robot_file import parse_robot_file
from cmifs_ros.collect.sampling.bag_reader import BagError, messages_of, open_bag

SRV = '=' * 80 + '\nSRV: a/srv/B_Event\nint64 a\n---\nint64 sum\n'
#: Channels beside the robot's: type, encoding and text of the schema, how messages are written.
FOREIGN = {
    '/events': ('a/srv/B_Event', 'ros2msg', SRV.encode(), 'cdr'),
    '/bare_events': ('a/srv/C_Event', 'ros2msg', b'', 'cdr'),
    '/note': ('note', 'jsonschema', b'{"type": "object"}', 'json'),
    '/proto': ('foxglove.Log', 'protobuf', b'\x0a\xff\xfe\x80', 'protobuf'),
    '/part': ('my_msgs/msg/Mine', 'ros2msg', b'other_msgs/Part part\n', 'cdr'),
}
ROBOT = parse_robot_file(ROBOT)


@pytest.fixture(scope='module')
def recorded(tmp_path_factory):
    """Return the messages of a bag, as MCAP records, and its episodes as bytes."""
    path = tmp_path_factory.mktemp('bags') / 'bag'
    write_bag(path, 200)
    with next(path.glob('*.mcap')).open('rb') as file:
        records = list(make_reader(file).iter_messages())
    return records, content(path)


def content(path):
    return bytes_of(episodes_of_bag(path, ROBOT).episodes)


def bytes_of(episodes):
    return [(episode.states.tobytes(), episode.rewards.tobytes()) for episode in episodes]


def rewritten(path, records, foreign=(), **options):
    with path.open('wb') as target:
        writer = Writer(target, **({'chunk_size': 2000} | options))
        writer.start('ros2')
        channels = {}
        for topic in foreign:
            kind, encoding, text, form = FOREIGN[topic]
            schema = writer.register_schema(kind, encoding, text)
            channel = writer.register_channel(topic, form, schema)
            writer.add_message(channel, 100 * 10**9, b'\0\1\0\0\1\2\3\4', 100 * 10**9)
        for schema, channel, message in records:
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, number, channel.metadata
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time
            )
        writer.finish()
    return path


@pytest.mark.parametrize(
    'options',
    [
        {'compression': CompressionType.LZ4},
        {'compression': CompressionType.NONE},
        {'use_chunking': False},
        {'index_types': IndexType.ALL & ~IndexType.MESSAGE},
        {'index_types': IndexType.ALL & ~IndexType.MESSAGE, 'use_statistics': False},
        {'index_types': IndexType.ALL & ~IndexType.CHUNK},
        {'index_types': IndexType.NONE, 'use_statistics': False, 'use_summary_offsets': False,
         'repeat_channels': False, 'repeat_schemas': False},
        {'repeat_channels': False},
        {'repeat_schemas': False},
        {'use_statistics': False},
    ],
)  # fmt: skip
@pytest.mark.parametrize('order', ['in order', 'mixed'])
def test_however_an_mcap_file_is_written_it_holds_the_same(tmp_path, recorded, options, order):
    records, expected = recorded
    if order == 'mixed':  # Of two threads that write: all chunks overlap, or no message is in turn.
        records = records[::2] + records[1::2]
    path = rewritten(tmp_path / 'bag.mcap', records, **options)
    with open_bag(path) as reader:
        assert {topic: reader.topics[topic].msgcount for topic in ('/pose', '/scan')} == {
            '/pose': 200, '/scan': 20
        }  # fmt: skip
        assert reader.duration == 199 * 10**8 + 1000
    assert content(path) == expected


def test_foreign_topics_are_named_and_the_rest_is_read(tmp_path, recorded):
    records, expected = recorded
    path = rewritten(tmp_path / 'bag.mcap', records, FOREIGN)
    bag = episodes_of_bag(path, ROBOT)
    assert bytes_of(bag.episodes) == expected
    assert set(bag.unreadable) == FOREIGN.keys() - {'/part'}
    assert bag.unreadable['/note'] == 'its messages are json; expected cdr or ros1'
    assert bag.unreadable['/events'].startswith('its type a/srv/B_Event cannot be read: ')
    text = robot_file_of_bag(path)
    assert '"/pose.pose.position.x"' in text
    assert '# /proto: its messages are protobuf; expected cdr or ros1\n' in text
    assert '# /part: my_msgs/msg/Mine cannot be decoded: ' in text


def test_a_foreign_topic_that_is_asked_for_is_an_error(tmp_path, recorded):
    path = rewritten(tmp_path / 'bag.mcap', recorded[0], FOREIGN)
    robot = parse_robot_file(
        'step: {topic: /pose}\nchannels: {a: /note.a}\nreward: a\nepisode: {steps: 5}\n'
    )
    with pytest.raises(BagError, match='/note cannot be read: its messages are json; expected cdr'):
        episodes_of_bag(path, robot)


def test_a_foreign_definition_in_db3_is_named_too(tmp_path):
    write_bag(tmp_path / 'bag', 42, 'db3')
    expected = content(tmp_path / 'bag')
    with sqlite3.connect(next((tmp_path / 'bag').glob('*.db3'))) as database:
        database.execute(
            "UPDATE message_definitions SET encoding = 'unknown', "
            "encoded_message_definition = 'x' WHERE topic_type LIKE '%LaserScan'"
        )
    assert content(tmp_path / 'bag') == expected
    assert '/scan' in episodes_of_bag(tmp_path / 'bag', ROBOT).unreadable


@pytest.mark.parametrize('share', [0.5, 0.9, 0.995])
def test_a_file_that_was_cut_off_is_told(tmp_path, recorded, share):
    path = rewritten(tmp_path / 'bag.mcap', recorded[0])
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    with pytest.raises(BagError, match=r'does not end like an MCAP file; .* `mcap recover`'):
        episodes_of_bag(path, ROBOT)


def test_a_bag_of_ros_1_holds_the_same(tmp_path, recorded):
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    types = store.types
    write_bag(tmp_path / 'bag', 200)
    with open_bag(tmp_path / 'bag') as reader, Writer1(tmp_path / 'one.bag') as writer:
        named = {'/pose', '/noise', '/pay'}
        topics = {
            topic: writer.add_connection(topic, reader.topics[topic].msgtype, typestore=store)
            for topic in named
        }
        for topic, message, time in messages_of(reader, tmp_path, named):
            if topic == '/pose':
                head, point = message.header, message.pose.position
                stamp = types['builtin_interfaces/msg/Time'](head.stamp.sec, head.stamp.nanosec)
                pose = types['geometry_msgs/msg/Pose'](
                    types['geometry_msgs/msg/Point'](point.x, point.y, point.z),
                    types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0),
                )
                sent = types['geometry_msgs/msg/PoseStamped'](
                    types['std_msgs/msg/Header'](0, stamp, 'map'), pose
                )
            else:
                sent = types['std_msgs/msg/Float64'](message.data)
            writer.write(topics[topic], time, store.serialize_ros1(sent, sent.__msgtype__))
    assert content(tmp_path / 'one.bag') == recorded[1]
    with open_bag(tmp_path / 'one.bag') as reader:
        assert reader.topics['/pose'].msgcount == 200
        assert reader.duration == 199 * 10**8 + 1000


def test_a_definition_in_idl_of_several_types_is_understood(tmp_path, recorded):
    structs = {'Whole': 'a::msg::Part part', 'Part': 'double x'}
    text = ''.join(
        '=' * 80 + f'\nIDL: a/msg/{name}\nmodule a {{ module msg {{ struct {name} {{ {fields}; }}; '
        '}; };\n'
        for name, fields in structs.items()
    )
    path = tmp_path / 'bag.mcap'
    with path.open('wb') as target:
        writer = Writer(target)
        writer.start('ros2')
        schema = writer.register_schema('a/msg/Whole', 'ros2idl', text.encode())
        channel = writer.register_channel('/t', 'cdr', schema)
        writer.add_message(channel, 5, b'\0\1\0\0' + np.float64(2.5).tobytes(), 5)
        writer.finish()
    with open_bag(path) as reader:
        assert reader.unreadable == {}
        ((topic, message, time),) = messages_of(reader, path, {'/t'})
    assert (topic, message.part.x, time) == ('/t', 2.5, 5)
