"""The first robot file: what tells nothing is commented out with why, and can be uncommented."""

import re
from math import inf, nan
from types import SimpleNamespace as Message

import pytest

from cmifs_ros.collect.robot_file.reader import parse_robot_file
from cmifs_ros.collect.robot_file.template import (
    Heard,
    TypeField,
    robot_file_of_bag,
    robot_file_of_topics,
)  # fmt: skip

FIELDS = {'charge': 'number', 'kind': 'number', 'on': 'number', 'cells': 'numbers'}


def line_of(name, values):
    """Return the line of one of the fields that had these values."""
    heard = Heard('/b', 'B', lambda kind: [TypeField(*item) for item in FIELDS.items()])
    for value in values:
        heard.count += 1
        fields = {'charge': 0.5, 'kind': 7, 'on': True, 'cells': [1.0]} | {name: value}
        heard.look(Message(**fields))
    text = robot_file_of_topics('a robot', [heard], 1.0)
    (line,) = (line for line in text.splitlines() if re.match(f' +(# )?{name}:', line))
    uncommented = re.sub('(?m)^  # ', '  ', text)
    assert len(parse_robot_file(f'{uncommented}reward: "1"\n').sources) == len(FIELDS)
    return line


@pytest.mark.parametrize(
    ('name', 'values', 'expected'),
    [
        ('charge', [nan, nan], '  # charge: "/b.charge"  # always NaN here'),
        ('charge', [inf, inf], '  # charge: "/b.charge"  # always inf here'),
        ('charge', [0.0, nan, 0.0], '  # charge: "/b.charge"  # never changed: 0'),
        ('charge', [nan, 1.0, 2.0], '  charge: "/b.charge"'),
        ('on', [False, False, True], '  on: "/b.on"'),
        ('cells', [[1.0, 2.0], [1.0, 2.0]], '  # cells: "/b.cells[0:2]"  # never changed: 1, 2'),
        ('cells', [[1.0, 2.0], [1.0], [1.5, 2.0]], '  cells: "/b.cells[0:2]"'),
        ('cells', [[1.0, nan], [2.0, nan]], '  # cells: "/b.cells[0:2]"  # always NaN here: [1]'),
        ('kind', range(3), '  kind: "/b.kind"  # if 0, 1, 2 are kinds: '
         '{path: "/b.kind", one_hot: [0, 1, 2]}'),
        ('kind', range(9), '  kind: "/b.kind"'),
        ('kind', range(2), '  kind: "/b.kind"'),
    ],
)  # fmt: skip
def test_the_line_of_a_channel_says_what_its_values_did(name, values, expected):
    assert line_of(name, values) == expected


def test_of_a_bag_a_rare_event_is_seen_and_what_was_not_looked_at_is_told(tmp_path):
    pytest.importorskip('rosbags', reason='rosbags is not here')
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    stamp = store.types['builtin_interfaces/msg/Time'](1, 0)
    header = store.types['std_msgs/msg/Header'](stamp, 'a frame with a long name' * 3)
    still = store.types['sensor_msgs/msg/Temperature'](header, 20.0, 0.0)
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:

        def topic(name, kind):
            connection = writer.add_connection(name, kind, typestore=store)
            return lambda i, message: writer.write(
                connection, i * 10**7, store.serialize_cdr(message, kind)
            )

        hit, heat = topic('/hit', 'std_msgs/msg/Bool'), topic('/t', 'sensor_msgs/msg/Temperature')
        for i in range(3000):
            hit(i, store.types['std_msgs/msg/Bool'](i == 1234))
            heat(i, still)
    text = robot_file_of_bag(tmp_path / 'bag')
    assert '\n  hit_data: "/hit.data"\n' in text
    assert '"/t.temperature"  # never changed: 20, in 1000 of 3000 messages' in text
