# SPDX-License-Identifier: Apache-2.0

"""The paths of a robot file against the types of the topics."""

import re

import pytest

from cmifs_ros.collect.robot_file.observed_fields import TypeField
from cmifs_ros.collect.robot_file.path_check import problems_of_paths
from cmifs_ros.collect.robot_file.reader import parse_robot_file

TYPES = {
    'a/msg/Temp': {'data': 'number', 'header': 'a/msg/Header'},
    'a/msg/Header': {'frame_id': 'text', 'stamp': 'a/msg/Time'},
    'a/msg/Time': {'sec': 'number'},
    'a/msg/Text': {'data': 'text'},
    'a/msg/Scan': {'ranges': 'numbers', 'range_max': 'number', 'data': ''},
    'a/msg/Quaternion': dict.fromkeys('xyzw', 'number'),
    'a/msg/Sweep': {'ranges': 'numbers'}
    | dict.fromkeys(('angle_min', 'angle_increment', 'range_min', 'range_max'), 'number'),
    'a/msg/Pose': {'orientation': 'a/msg/Quaternion', 'position': 'a/msg/Temp'},
    'a/msg/Tree': {'status': 'a/msg/Text[]', 'name': ''},
}
TOPICS = {
    '/temp': 'a/msg/Temp', '/text': 'a/msg/Text', '/scan': 'a/msg/Scan', '/pose': 'a/msg/Pose',
    '/tree': 'a/msg/Tree', '/sweep': 'a/msg/Sweep',
}  # fmt: skip


def problems(channel='/temp.data', value='/temp.data', reward='1', end='v == 1'):
    robot = parse_robot_file(
        f'step: {{rate: 1}}\nchannels: {{c: {channel}, d: /unknown.data}}\nvalues: {{v: {value}}}\n'
        f'reward: "{reward}"\nepisode: {{terminated: "{end}"}}\n'
    )

    def fields_of(kind):
        return [TypeField(*field) for field in TYPES[kind].items()]

    return problems_of_paths(robot, TOPICS, fields_of)


@pytest.mark.parametrize(
    'right',
    [
        {},
        {'channel': '{path: "/scan.ranges[0:9:3]", inf: range_max}'},
        {'channel': '"/scan.ranges{a,b}"'},
        {'channel': '"/scan.data[0]"'},
        {'channel': '{path: /pose.orientation, as: yaw}'},
        {'channel': '{path: /sweep, as: scan}'},
        {'channel': '{path: /text.data, one_hot: [a, b]}'},
        {'channel': '"/tree.status{left}.data"'},
        {'channel': '"/tree.status[0].data"'},
        {'value': '/text.data', 'end': "v == 'done'"},
        {'reward': '/temp.data', 'end': '/text'},
    ],
)
def test_what_fits_is_not_complained_of(right):
    assert problems(**right) == []


@pytest.mark.parametrize(
    ('wrong', 'said'),
    [
        ({'channel': '/temp.dat'},
         "c: /temp has no field 'dat' (did you mean 'data'?); expected one of data, header"),
        ({'channel': '/temp.header.seq'}, "c: /temp.header has no field 'seq'; expected one of"),
        ({'channel': '/temp.header.stamp'}, 'c: /temp.header.stamp is a Time of sec; expected a n'),
        ({'channel': '/temp.data.x'},
         "c: /temp.data is a number, which has no field 'x'; remove .x"),
        ({'channel': '/scan.ranges.x'},
         "c: /scan.ranges is an array, which has no field 'x'; remove .x"),
        ({'channel': '"/temp.data[0]"'}, 'c: /temp.data is a number; expected an array for [0]'),
        ({'channel': '"/temp.data{a}"'}, 'c: /temp.data is a number; expected an array for {a}'),
        ({'channel': '"/temp.data{a}.x"'}, 'c: /temp.data is a number; expected an array for {a}'),
        ({'channel': '/scan.ranges'}, 'c: /scan.ranges is an array; expected an entry of it, such'),
        ({'channel': '{path: "/scan.ranges[0]", inf: max}'}, "c: /scan has no field 'max'"),
        ({'channel': '{path: /scan, as: scan}'},
         '/scan is a Scan of ranges, range_max, data; expected a sensor_msgs/LaserScan for'),
        ({'channel': '{path: /pose.position, as: yaw}'}, 'expected a quaternion of w, x, y, z'),
        ({'channel': '/tree.status.data'}, 'c: /tree.status is an array of a/msg/Text; expected'),
        ({'end': "v == 'done'"}, "v: /temp.data is a number; expected a text, because it is comp"),
        ({'end': '/text.data'},
         'episode.terminated: /text.data is a text; define it under values, as in status: '
         "/text.data, and compare it: status == 'done'"),
        ({'reward': '/text.dat'}, "reward: /text has no field 'dat' (did you mean 'data'?)"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_named_with_a_remedy(wrong, said):
    (problem,) = problems(**wrong)
    assert re.search(re.escape(said), problem), problem
