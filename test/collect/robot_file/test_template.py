# SPDX-License-Identifier: Apache-2.0

"""The first robot file: uninformative fields are commented out with why, and can be uncommented."""

import re
from math import inf, nan
from types import SimpleNamespace as Message

import pytest

from cmifs_ros.collect.observed_bag import robot_file_of_bag
from cmifs_ros.collect.robot_file.observed_fields import ObservedTopic, TypeField
from cmifs_ros.collect.robot_file.reader import parse_robot_file
from cmifs_ros.collect.robot_file.template import robot_file_of_topics

FIELDS = {'charge': 'number', 'kind': 'number', 'on': 'number', 'cells': 'numbers'}


def line_of(name, values):
    """Return the line of one of the fields that had these values."""
    heard = ObservedTopic('/b', 'B', lambda kind: [TypeField(*item) for item in FIELDS.items()],
                          seconds=1.0)  # fmt: skip
    for value in values:
        heard.count += 1
        fields = {'charge': 0.5, 'kind': 7, 'on': True, 'cells': [1.0]} | {name: value}
        heard.look(Message(**fields))
    text = robot_file_of_topics('a robot', [heard])
    (line,) = (line for line in text.splitlines() if re.match(f' +(# )?b_{name}:', line))
    uncommented = re.sub('(?m)^  # ', '  ', text)
    assert len(parse_robot_file(f'{uncommented}reward: "1"\n').sources) == len(FIELDS)
    return line


@pytest.mark.parametrize(
    ('name', 'values', 'expected'),
    [
        ('charge', [nan, nan], '  # b_charge: "/b.charge"  # always NaN here'),
        ('charge', [inf, inf], '  # b_charge: "/b.charge"  # always inf here'),
        ('charge', [0.0, nan, 0.0], '  # b_charge: "/b.charge"  # never changed: 0'),
        ('charge', [nan, 1.0, 2.0], '  b_charge: "/b.charge"'),
        ('on', [False, False, True], '  b_on: "/b.on"'),
        ('cells', [[1.0, 2.0], [1.0, 2.0]], '  # b_cells: "/b.cells[0:2]"  # never changed: 1, 2'),
        ('cells', [[1.0, 2.0], [1.0], [1.5, 2.0]], '  b_cells: "/b.cells[0:2]"'),
        ('cells', [[1.0, nan], [2.0, nan]], '  # b_cells: "/b.cells[0:2]"  # always NaN here: [1]'),
        ('kind', range(3), '  b_kind: "/b.kind"  # if 0, 1, 2 are categories: '
         '{path: "/b.kind", one_hot: [0, 1, 2]}'),
        ('kind', range(9), '  b_kind: "/b.kind"'),
        ('kind', range(2), '  b_kind: "/b.kind"'),
    ],
)  # fmt: skip
def test_the_line_of_a_channel_says_what_its_values_did(name, values, expected):
    assert line_of(name, values) == expected


def text_of(kinds, *said):
    """Return the robot file of topics that said messages, each with topic and type."""
    topics = {}
    for topic, kind, message in said:
        heard = topics.setdefault(
            topic,
            ObservedTopic(
                topic, kind, lambda k: [TypeField(*i) for i in kinds[k].items()], seconds=1.0
            ),
        )
        heard.count += 1
        heard.look(message)
    text = robot_file_of_topics('a robot', topics.values())
    parse_robot_file(re.sub('(?m)^  # ', '  ', text) + 'reward: "1"\n')
    return text


KINDS = {
    'Array': {'status': 'Status[]'},
    'Status': {'level': 'number', 'name': 'text', 'message': 'text', 'values': 'KeyValue[]'},
    'KeyValue': {'key': 'text', 'value': 'text'},
    'Dynamic': {'joint_names': '', 'interface_values': 'Interface[]'},
    'Interface': {'interface_names': '', 'values': 'numbers'},
    'Tree': {'transforms': 'Frame[]'},
    'Frame': {'child_frame_id': 'text', 'transform': 'Transform'},
    'Transform': {'x': 'number'},
    'Boxes': {'boxes': 'Box[]'},
    'Box': {'score': 'number'},
    'String': {'data': 'text'},
    'Range': {'range': 'number', 'max_range': 'number'},
    'Odd': {'max': 'number', 'hypot': 'number', 'step': 'number', 'lambda': 'number'},
    'Battery': {'voltage': 'number'},
}


def status(name, level, heat, hardware=''):
    values = [Message(key='Heat (C)', value=str(heat)), Message(key='state', value='on')]
    return Message(name=name, level=level, message='', hardware_id=hardware, values=values)


def test_messages_in_arrays_are_listed_by_name_key_frame_or_place():
    text = text_of(
        KINDS,
        ('/diagnostics', 'Array', Message(status=[status('left motor', 0, 40)])),
        ('/diagnostics', 'Array', Message(status=[status('right', 0, 9)])),
        ('/diagnostics', 'Array', Message(status=[status('sampler: steps', 0, 1, 'cmifs_ros')])),
        ('/diagnostics', 'Array', Message(status=[status('left motor', 1, 41)])),
        *(('/arm', 'Dynamic', Message(joint_names=['hip', 'knee'], interface_values=[
            Message(interface_names=['position', 'effort'], values=[i, 0.5]),
            Message(interface_names=['effort'], values=[-i])])) for i in range(2)),
        *(('/tf', 'Tree', Message(transforms=[Message(
            child_frame_id=f'f{i % 2}', transform=Message(x=i))])) for i in range(4)),
        *(('/seen', 'Boxes', Message(boxes=[Message(score=i)] * n)) for i, n in enumerate((0, 9))),
    )  # fmt: skip
    lines = text.splitlines()
    heat = '"/diagnostics.status{left motor}.values{Heat (C)}.value"'
    assert f'  diagnostics_left_motor_Heat_C: {heat}' in lines
    assert any('# diagnostics_right' in line and '# never changed: 9' in line for line in lines)
    assert 'sampler' not in text
    assert '  arm_hip_values: "/arm.interface_values{hip}.values{position,effort}"' in lines
    assert '  arm_knee_values: "/arm.interface_values{knee}.values{effort}"' in lines
    assert '  tf_f1_transform_x: "/tf.transforms{f1}.transform.x"' in lines
    assert text.count('"/seen.boxes[') == 4


def test_what_a_text_says_is_shown_as_categories():
    said = [('/mode', 'String', Message(data=word)) for word in ('idle', 'lifting', 'idle')]
    said += [('/name', 'String', Message(data='robot 1')), ('/heat', 'String', Message(data='4'))]
    said += [('/log', 'String', Message(data=f'{{"{i}": 1}}')) for i in range(99)]
    lines = text_of(KINDS, *said).splitlines()
    assert (
        '  # mode: {path: "/mode.data", one_hot: [idle, lifting]}  # text; values seen'
    ) in lines
    assert "# /name is text: 'robot 1'" in lines
    assert any(line.startswith('# /log is text: \'{"0": 1}\', ') for line in lines)
    assert any('heat: ' in line and 'never changed: 4' in line for line in lines)


def test_commands_are_proposed_as_actions_and_are_no_sensors():
    kinds = KINDS | {'Twist': {'linear': 'Transform', 'angular': 'Transform'}}
    twists = [Message(linear=Message(x=i), angular=Message(x=0.0)) for i in (0.1, 0.2)]
    said = [(topic, 'Twist', twist) for topic in ('/base/cmd_vel', '/vel') for twist in twists]
    said += [(topic, 'Battery', Message(voltage=i)) for i in range(2)
             for topic in ('/goal_distance', '/arm/commands', '/goal')]  # fmt: skip
    text = text_of(kinds, *said)
    channels, _, actions = text.partition('\n# actions:\n')
    actions = actions.partition('\n\n')[0].splitlines()
    assert re.findall(r'"/([\w/]+)\.', channels) == ['goal_distance', 'vel', 'vel']
    assert actions == [
        '#   arm_commands_voltage: "/arm/commands.voltage"',
        '#   cmd_vel_linear_x: "/base/cmd_vel.linear.x"',
        '#   # cmd_vel_angular_x: "/base/cmd_vel.angular.x"  # never changed: 0',
        '#   goal_voltage: "/goal.voltage"',
    ]
    robot = parse_robot_file(re.sub('(?m)^# (actions:$|  )', r'\1', text) + 'reward: "1"\n')
    assert robot.action_names == ('arm_commands_voltage', 'cmd_vel_linear_x', 'goal_voltage')
    # Where no command was heard, there is an example.
    assert '# actions:\n#   drive: ' in text_of(KINDS, ('/w', 'Battery', Message(voltage=1)))


def test_an_infinite_range_is_the_greatest():
    said = [('/sonar', 'Range', Message(range=r, max_range=4.0)) for r in (1.0, inf)]
    assert '  sonar_range: {path: "/sonar.range", inf: max_range}' in text_of(KINDS, *said)


def test_no_channel_has_a_name_that_expressions_use():
    said = [
        (topic, 'Odd', Message(**dict.fromkeys(KINDS['Odd'], i)))
        for topic in ('/max', '/robot') for i in range(2)
    ]  # fmt: skip
    names = re.findall(r'(?m)^  (\w+): ', text_of(KINDS, *said))
    assert len(names) == len(set(names)) == 8
    assert not {'max', 'hypot', 'step', 'lambda'} & set(names)


def test_names_that_say_little_have_their_topic_before_them():
    said = [(t, 'Battery', Message(voltage=i)) for i in range(2) for t in ('/a/cell', '/b/cell')]
    said += [('/base/power', 'Battery', Message(voltage=i)) for i in range(2)]
    said += [(t, 'Battery', Message(voltage=i)) for i in range(2) for t in ('/bms/data',)]
    said += [('/water/level', 'Number', Message(data=i)) for i in range(2)]
    names = re.findall(r'(?m)^  (\w+): ', text_of(KINDS | {'Number': {'data': 'number'}}, *said))
    assert names == [
        'a_cell_voltage', 'b_cell_voltage', 'power_voltage', 'bms_data_voltage', 'level'
    ]  # fmt: skip


def test_a_rate_is_proposed_that_the_fastest_topic_has():
    def lines(**counts):
        said = [(f'/{topic}', 'Battery', Message(voltage=i))
                for topic, count in counts.items() for i in range(count)]  # fmt: skip
        return text_of(KINDS, *said).splitlines()

    found = lines(slow=2, fast=60, once=1)  # in one second
    assert '# Seen: 2 Hz (/slow) to 60 Hz (/fast).' in found
    assert 'step: {rate: 10.0}' in found
    assert 'step: {rate: 5.0}' in lines(slow=2, fast=5)
    assert 'step: {rate: 10.0}' in lines(fast=9)  # Counts begin and end at random.
    assert 'step: {rate: 10.0}' in lines(once=1)


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
    assert '\n  hit: "/hit.data"\n' in text
    assert '"/t.temperature"  # never changed: 20, in 1000 of 3000 messages' in text


def image_of(value, encoding='mono8'):
    return Message(height=1, width=2, encoding=encoding, is_bigendian=0, step=2,
                   data=bytes([value, 0]))  # fmt: skip


def scan_of(length):
    return Message(angle_min=0.0, angle_increment=0.1, range_min=0.1, range_max=9.0,
                   ranges=[1.0 + length / 10] * length)  # fmt: skip


def test_images_and_scans_are_sensors_as_a_whole():
    image, scan = 'sensor_msgs/msg/Image', 'sensor_msgs/msg/LaserScan'
    numbers = ('angle_min', 'angle_increment', 'range_min', 'range_max')
    kinds = {image: {}, scan: {**dict.fromkeys(numbers, 'number'), 'ranges': 'numbers'}}
    said = [
        (topic, image, image_of(i))
        for i in range(3)
        for topic in ('/camera/image_raw', '/arm/wrist/image_raw', '/arm/wrist/compressed')
    ]
    said += [('/raw/image', image, image_of(i, 'bayer_rggb8')) for i in range(3)]
    said += [('/still/image', image, image_of(7)) for i in range(3)]
    said += [('/sweep', scan, scan_of(i)) for i in (30, 30, 31, 29, 30)]
    said += [('/blind', scan, scan_of(0)), ('/blind', scan, scan_of(0))]
    lines = text_of(kinds, *said).splitlines()
    assert '  camera: {path: "/camera/image_raw", as: image}' in lines
    assert '  arm_wrist: {path: "/arm/wrist/compressed", as: image}' in lines
    assert '  arm_wrist_2: {path: "/arm/wrist/image_raw", as: image}' in lines
    assert any(
        line.startswith('  # raw: {path: "/raw/image", as: image}  # /raw/image has the encoding ')
        for line in lines
    )
    assert any('# still: {path: "/still/image", as: image}  # never' in line for line in lines)
    assert '  sweep: {path: "/sweep", as: scan}' in lines
    assert not any('/sweep.' in line for line in lines)
    assert '  # blind: {path: "/blind", as: scan}  # never changed: 9' in lines
