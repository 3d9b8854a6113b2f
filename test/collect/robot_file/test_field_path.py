"""Field paths: what they find in messages and what they refuse."""

from types import SimpleNamespace

import numpy as np
import pytest

from cmifs_ros.collect.robot_file.field_path import MissingFieldError, parse_field_path


def test_fields_slices_and_names():
    arm = SimpleNamespace(name=['a', 'b', 'c'], position=np.array([1.0, 2.0, 3.0]))
    assert parse_field_path('/arm.position{c,a}').read(arm) == [3, 1]
    assert parse_field_path('/arm.position[0:3:2]').read(arm) == [1, 3]
    assert parse_field_path('/arm.position[0:3:2]').suffixes == ('[0]', '[2]')
    assert parse_field_path('/arm.position[1]').read(arm) == [2]
    assert parse_field_path('/ns/arm.position[1]').suffixes == ('',)


def test_one_name_in_braces_is_one_number():
    arm = SimpleNamespace(name=['a', 'b'], position=[1.0, 2.0])
    path = parse_field_path('/arm.position{b}')
    assert (path.read(arm), path.suffixes) == ([2], ('',))


SCAN = SimpleNamespace(ranges=np.ones(3), text='dropped', level=2, frame=SimpleNamespace(x=1, y=2))


@pytest.mark.parametrize(
    ('path', 'said'),
    [
        ('.ranges', '/scan.ranges is an array of 3 values; expected [0] for one entry'),
        ('.text', "/scan.text is the text 'dropped'; expected a number; of a few words"),
        ('.text[0]', "/scan.text is the text 'dropped'; expected an array for [0]"),
        ('.level{a,b}', '/scan.level is a number; expected an array for {a,b}'),
        ('.level{a}.x', '/scan.level is a number; expected an array for {a}'),
        ('.frame', '/scan.frame is a SimpleNamespace of x, y; expected a number: name a field'),
        ('.frame.z', "/scan has no field 'z'; expected one of x, y"),
    ],
)
def test_what_is_no_number_is_said_with_a_remedy(path, said):
    with pytest.raises(MissingFieldError) as error:
        parse_field_path(f'/scan{path}').numbers(SCAN)
    assert str(error.value).startswith(said)


@pytest.mark.parametrize('path', ['/arm.speed', '/arm.position[3]', '/arm.position{d}'])
def test_what_a_message_lacks_is_said(path):
    arm = SimpleNamespace(name=['a'], position=[1.0])
    with pytest.raises(MissingFieldError, match='/arm has'):
        parse_field_path(path).read(arm)


@pytest.mark.parametrize(
    'path',
    ['', '/a' + '.b' * 1000, '/a.b[0:1000000]', '/a.b[0:]', '/a.b[5:2]', '/a.b[0:9:0]', '/a.b{}',
     '/a.b{x,x}', '/a.__class__', '/a.b[-1]', '/a.b[99999999999999999999]', '/a.b()',
     '/a.b{x}.', '/a.b{}.c', '/a.b{x{y}}.c'],
)  # fmt: skip
def test_what_is_no_path_is_refused_in_words(path):
    with pytest.raises(ValueError, match=r'expected|at most|repeated'):
        parse_field_path(path)
