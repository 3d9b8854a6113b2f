# SPDX-License-Identifier: Apache-2.0

"""Which channels are one sensor, by their names."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmifs_ros.collect.robot_file.reader import parse_robot_file
from cmifs_ros.collect.sensor_groups import groups_by_name


@pytest.mark.parametrize(
    ('names', 'expected'),
    [
        (['x', 'y', 's1'], {}),
        (['scan[0]', 'x', 'scan[30]'], {'scan': ('scan[0]', 'scan[30]')}),
        (['eye[0,0]', 'eye[0,1]', 'eye[,]'], {'eye': ('eye[0,0]', 'eye[0,1]')}),
        (['yaw.cos', 'yaw.sin'], {'yaw': ('yaw.cos', 'yaw.sin')}),
        (['arm.left[0]', 'arm.left[1]', 'arm.x'], {'arm.left': ('arm.left[0]', 'arm.left[1]')}),
        (['imu.z', 'scan[0]'], {}),
        (['a', 'a.x', 'a.y'], {}),
        (['.x', '.y', '[0]', '[1]', 'a.', 'b.', 'c[]', 'c[x]'], {}),
    ],
)
def test_what_the_names_tell(names, expected):
    assert groups_by_name(names) == expected


@given(st.lists(st.text('ab.[],01\n', min_size=1, max_size=6), unique=True))
def test_groups_are_disjoint_and_of_several_channels_that_begin_with_their_stem(names):
    groups = groups_by_name(names)
    members = [name for group in groups.values() for name in group]
    assert len(members) == len(set(members))
    assert set(members) <= set(names)
    assert not groups.keys() & set(names)
    for stem, group in groups.items():
        assert len(group) > 1
        assert all(name.startswith(stem) and name != stem for name in group)


def test_a_robot_file_has_the_groups_that_the_live_selector_finds():
    robot = parse_robot_file(
        'step: {rate: 10}\nreward: "1"\nchannels:\n  x: /o.x\n  one: "/s.r[0:1]"\n'
        '  yaw: {path: /o.q, as: yaw}\n  scan: "/s.r[0:90:45]"\n  arm: "/j.position{a,b}"\n'
    )
    assert robot.groups == {
        'yaw': ('yaw.sin', 'yaw.cos'),
        'scan': ('scan[0]', 'scan[45]'),
        'arm': ('arm.a', 'arm.b'),
    }
