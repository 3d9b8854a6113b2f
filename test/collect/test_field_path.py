"""Field paths: what they find in messages and what they refuse."""

from types import SimpleNamespace

import numpy as np
import pytest

from cmifs_ros.collect.field_path import MissingFieldError, parse_field_path


def test_fields_slices_and_names():
    arm = SimpleNamespace(name=['a', 'b', 'c'], position=np.array([1.0, 2.0, 3.0]))
    assert parse_field_path('/arm.position{c,a}').read(arm) == [3, 1]
    assert parse_field_path('/arm.position[0:3:2]').read(arm) == [1, 3]
    assert parse_field_path('/arm.position[0:3:2]').suffixes == ('[0]', '[2]')
    assert parse_field_path('/arm.position[1]').read(arm) == [2]
    assert parse_field_path('/ns/arm.position[1]').suffixes == ('',)


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
