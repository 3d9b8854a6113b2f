# SPDX-License-Identifier: Apache-2.0

"""Field paths: what they find in messages and what they refuse."""

from types import SimpleNamespace

import numpy as np
import pytest

from cmifs_ros.collect.robot_file.field_path import MissingFieldError, parse_field_path


def test_fields_slices_and_names():
    arm = SimpleNamespace(name=['a', 'b', 'c'], position=np.array([1.0, 2.0, 3.0]))
    assert parse_field_path('/arm.position{c,a}').values_in(arm) == [3, 1]
    assert parse_field_path('/arm.position[0:3:2]').values_in(arm) == [1, 3]
    assert parse_field_path('/arm.position[0:3:2]').suffixes == ('[0]', '[2]')
    assert parse_field_path('/arm.position[1]').values_in(arm) == [2]
    assert parse_field_path('/ns/arm.position[1]').suffixes == ('',)


def test_one_name_in_braces_is_one_number():
    arm = SimpleNamespace(name=['a', 'b'], position=[1.0, 2.0])
    path = parse_field_path('/arm.position{b}')
    assert (path.values_in(arm), path.suffixes) == ([2], ('',))


def message(**fields):
    return SimpleNamespace(**fields)


DYNAMIC = message(
    joint_names=['hip', 'left knee'],
    interface_values=[
        message(interface_names=['position', 'effort'], values=np.array([1.0, 2.0])),
        message(interface_names=['effort'], values=np.array([3.0])),
    ],
)
TREE = message(
    transforms=[
        message(child_frame_id=frame, transform=message(translation=message(x=x)))
        for frame, x in (('base', 1.0), ('gripper', 2.0))
    ]
)
PLAN = message(joint_names=['a', 'b'], points=[message(positions=[1.0, 2.0])])
HEALTH = message(
    status=[message(name='left motor', level=b'\x01', values=[message(key='Heat (C)', value='41')])]
)


@pytest.mark.parametrize(
    ('path', 'within', 'values'),
    [
        ('.interface_values{hip}.values{effort}', DYNAMIC, [2]),
        ('.interface_values{left knee}.values{effort}', DYNAMIC, [3]),
        ('.interface_values[0].values{effort,position}', DYNAMIC, [2, 1]),
        ('.interface_values{neck}.values{effort}', DYNAMIC, []),
        ('.transforms{gripper}.transform.translation.x', TREE, [2]),
        ('.transforms[0].transform.translation.x', TREE, [1]),
        ('.transforms{wrist}.transform.translation.x', TREE, []),
        ('.points[0].positions{b}', PLAN, [2]),
        ('.status{left motor}.values{Heat (C)}.value', HEALTH, [41]),
        ('.status{left motor}.level', HEALTH, [1]),
    ],
)
def test_messages_in_an_array_are_taken_by_name_key_frame_or_index(path, within, values):
    assert parse_field_path(f'/t{path}').numbers_in(within) == values


def test_an_index_that_an_array_lacks_is_said():
    with pytest.raises(MissingFieldError, match='/t has 1 value; expected more than 1'):
        parse_field_path('/t.points[1].positions{b}').numbers_in(PLAN)


SCAN = SimpleNamespace(ranges=np.ones(3), text='dropped', level=2, frame=SimpleNamespace(x=1, y=2))


@pytest.mark.parametrize(
    ('path', 'said'),
    [
        ('.ranges', '/scan.ranges is an array of 3 values; expected [0] for one entry'),
        (
            '.text',
            "/scan.text is the text 'dropped'; expected a number; if it is one of a few words",
        ),
        ('.text[0]', "/scan.text is the text 'dropped'; expected an array for [0]"),
        ('.level{a,b}', '/scan.level is a number; expected an array for {a,b}'),
        ('.level{a}.x', '/scan.level is a number; expected an array for {a}'),
        ('.frame', '/scan.frame is a SimpleNamespace of x, y; expected a number: name a field'),
        ('.frame.z', "/scan has no field 'z'; expected one of x, y"),
    ],
)
def test_what_is_no_number_is_said_with_a_remedy(path, said):
    with pytest.raises(MissingFieldError) as error:
        parse_field_path(f'/scan{path}').numbers_in(SCAN)
    assert str(error.value).startswith(said)


@pytest.mark.parametrize('path', ['/arm.speed', '/arm.position[3]', '/arm.position{d}'])
def test_what_a_message_lacks_is_said(path):
    arm = SimpleNamespace(name=['a'], position=[1.0])
    with pytest.raises(MissingFieldError, match='/arm has'):
        parse_field_path(path).values_in(arm)


@pytest.mark.parametrize(
    'path',
    ['', '/a' + '.b' * 1000, '/a.b[0:1000000]', '/a.b[0:]', '/a.b[5:2]', '/a.b[0:9:0]', '/a.b{}',
     '/a.b{x,x}', '/a.__class__', '/a.b[-1]', '/a.b[99999999999999999999]', '/a.b()',
     '/a.b{x}.', '/a.b{}.c', '/a.b{x{y}}.c'],
)  # fmt: skip
def test_what_is_no_path_is_refused_in_words(path):
    with pytest.raises(ValueError, match=r'expected|at most|repeated'):
        parse_field_path(path)
