# SPDX-License-Identifier: Apache-2.0

"""A package on the path, with the metadata that an installer writes, brings an encoder."""

import pickle
from types import SimpleNamespace as Message

import pytest

from cmifs_ros.collect.robot_file import RobotFileError, parse_robot_file
from cmifs_ros.collect.robot_file.field_path import MissingFieldError
from cmifs_ros.collect.robot_file.observed_fields import TypeField
from cmifs_ros.collect.robot_file.path_check import problems_of_paths

CODE = """
from cmifs_ros.collect.encoders import Encoder

class Halves(Encoder):
    needed = (('width', 'data'),)
    expected = 'an image'
    suffixes = ('.left', '.right')

    def encode(self, message):
        half = message.width // 2
        if half == 0:
            raise RuntimeError('too narrow')
        found = sum(message.data[:half]), sum(message.data[half:])
        return found[: message.width - 1]

class Total(Halves):
    is_large = False
    suffixes = ('',)

    def encode(self, message):
        return [sum(message.data)]

class Loose(Halves):
    suffixes = ('_left', '_right')

def number():
    return 3

def broken():
    raise OSError('no weights')
"""
ENTRIES = """
[cmifs_ros.encoders]
halves = {code}:Halves
total = {code}:Total
loose = {code}:Loose
number = {code}:number
broken = {code}:broken
nowhere = {code}_that_is_not_here:Halves
image = {code}:Halves

[another.group]
other = {code}:Halves
"""


def install(folder, monkeypatch, package, code, entries):
    """Lay out a distribution with one module as pip does."""
    (folder / f'{code}.py').write_text(CODE)
    about = folder / f'{package}-1.0.dist-info'
    about.mkdir()
    (about / 'METADATA').write_text(f'Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n')
    (about / 'entry_points.txt').write_text(entries)
    monkeypatch.syspath_prepend(folder)


@pytest.fixture
def package(tmp_path, monkeypatch):
    install(tmp_path, monkeypatch, 'eyes', 'eyes_code', ENTRIES.format(code='eyes_code'))


def robot_with(kind):
    return parse_robot_file(
        f'step: {{rate: 10}}\nchannels:\n  eye: {{path: /eye, as: {kind}}}\nreward: "1"\n'
    )


def image(*pixels):
    return Message(width=len(pixels), data=list(pixels))


def test_an_encoder_of_another_package_gives_the_channels(package):
    robot = robot_with('halves')
    assert robot.channel_names == ('eye.left', 'eye.right')
    assert robot.groups == {'eye': ('eye.left', 'eye.right')}
    (source,) = robot.sources
    assert source.readings(image(1, 2, 3, 4)) == [3.0, 7.0]
    # Recordings may be read in other processes.
    assert pickle.loads(pickle.dumps(source)).readings(image(1, 2, 3)) == [1.0, 5.0]
    assert robot.large_topics == {'/eye'}
    assert robot_with('total').channel_names == ('eye',)
    assert robot_with('total').large_topics == frozenset()


def test_no_package_replaces_an_encoder_of_our_own(package):
    assert len(robot_with('image').channel_names) == 15


@pytest.mark.parametrize(
    ('message', 'said'),
    [
        (image(1), r'/eye: as: halves fails \(RuntimeError: too narrow\)'),
        (image(1, 2), '/eye: as: halves gives 1 value; expected 2'),
        (Message(ranges=[1.0]), 'expected an image for as: halves'),
    ],
)
def test_a_message_that_it_refuses_is_a_wrong_message(package, message, said):
    with pytest.raises(MissingFieldError, match=said):
        robot_with('halves').sources[0].readings(message)


def test_the_type_of_a_topic_is_checked_before_reading(package):
    robot, kinds = robot_with('halves'), {'/eye': 'sensor_msgs/msg/LaserScan'}
    (problem,) = problems_of_paths(robot, kinds, lambda kind: [TypeField('ranges', 'numbers')])
    assert 'expected an image for as: halves' in problem


@pytest.mark.parametrize(
    ('kind', 'said'),
    [
        ('other', "eye.as is 'other'; expected yaw, image, scan, cloud, broken, halves, image, "),
        ('eyes_code:Halves', "eye.as is 'eyes_code:Halves'; expected yaw, "),
        ('[halves]', 'eye.as is a list; expected yaw, '),
        ('number', 'eyes_code:number of eyes, which gives a int; expected an Encoder'),
        ('broken', r'eyes_code:broken of eyes, which fails \(OSError: no weights\)'),
        ('nowhere', r'which fails \(ModuleNotFoundError: No module named'),
        ('loose', r"the suffixes \['_left', '_right'\]; expected two or more such as"),
        ('halves, sectors: 3', 'eye has sectors; expected it with as: scan or as: cloud only'),
    ],
)
def test_what_cannot_be_used_is_one_mistake_with_its_line(package, kind, said):
    with pytest.raises(RobotFileError, match=f'^line 3: .*{said}') as error:
        robot_with(kind)
    assert '\n' not in str(error.value)


def test_two_packages_with_one_name_are_refused(package, tmp_path, monkeypatch):
    folder = tmp_path / 'more'
    folder.mkdir()
    install(folder, monkeypatch, 'lids', 'lids_code', ENTRIES.format(code='lids_code'))
    with pytest.raises(RobotFileError, match=r'both .*:Halves of .* and .*:Halves of .*uninstall'):
        robot_with('halves')
