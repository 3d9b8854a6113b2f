# SPDX-License-Identifier: Apache-2.0

"""Which recording a path means, and what to install for it."""

import sys

import pytest

from cmifs_ros.collect.recorded_episodes import RecordingError
from cmifs_ros.collect.recording import episodes_of_recording, recordings_in
from cmifs_ros.collect.robot_file.reader import parse_robot_file

ROBOT = parse_robot_file('step: {rate: 1}\nchannels: {x: /run.x}\nreward: x\nepisode: {steps: 5}\n')


@pytest.mark.parametrize(
    ('package', 'name', 'robot'),
    [
        ('pyarrow', 'run.csv', None),
        ('pyarrow', 'run.parquet', ROBOT),
        ('h5py', 'run.h5', None),
        ('pyulog', 'run.ulg', ROBOT),
    ],
)
def test_the_package_to_install_is_named(tmp_path, monkeypatch, package, name, robot):
    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / name).touch()
    with pytest.raises(RecordingError, match=f'pip install {package}$'):
        episodes_of_recording(tmp_path / name, robot)


def test_a_folder_means_the_recordings_in_it(tmp_path):
    files = ['bag/metadata.yaml', 'bag/bag_0.mcap', 'bag/note.csv', 'torn/bag_0.db3',
             'set/meta/info.json', 'set/data/chunk-000/file-000.parquet', 'demos/demo_10.hdf5',
             'demos/demo_2.hdf5', 'demos/readme.txt', 'drive/odom.csv',
             'drive/imu.parquet']  # fmt: skip
    for name in files:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()

    def found(folder, robot=None):
        return [str(path.relative_to(tmp_path)) for path in recordings_in(folder, robot)]

    others = ['bag', 'demos/demo_2.hdf5', 'demos/demo_10.hdf5']
    assert found(tmp_path) == [*others, 'drive/imu.parquet', 'drive/odom.csv', 'set', 'torn']
    assert found(tmp_path, ROBOT) == [*others, 'set', 'torn']
    # By a robot file, its tables are the topics of one recording.
    assert found(tmp_path / 'drive', ROBOT) == ['drive']
    for name in ('bag', 'bag/bag_0.mcap', 'torn', 'set', 'demos/demo_2.hdf5', 'drive/odom.csv'):
        assert found(tmp_path / name) == [name]
