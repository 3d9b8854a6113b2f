# SPDX-License-Identifier: Apache-2.0

"""Which recording a path means, and what to install for it."""

import sys

import pytest

from cmifs_ros.collect.recorded_episodes import RecordingError
from cmifs_ros.collect.recording import (
    episodes_of_recording,
    recordings_in,
    robot_file_of_recording,
)
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
    (tmp_path / name).write_bytes(b'a')
    with pytest.raises(RecordingError, match=f'pip install {package}$'):
        episodes_of_recording(tmp_path / name, robot)


def test_a_folder_means_the_recordings_in_it(tmp_path):
    files = ['bag/metadata.yaml', 'bag/bag_0.mcap', 'bag/note.csv', 'torn/bag_0.db3',
             'runs/run_10.mcap', 'runs/run_2.bag', 'runs/day.mcap/metadata.yaml',
             'runs/day.mcap/day_0.mcap',
             'set/meta/info.json', 'set/data/chunk-000/file-000.parquet', 'demos/demo_10.hdf5',
             'demos/demo_2.hdf5', 'demos/readme.txt', 'drive/odom.csv',
             'drive/imu.parquet']  # fmt: skip
    for name in files:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()

    def found(folder, robot=None):
        return [str(path.relative_to(tmp_path)) for path in recordings_in(folder, robot)]

    others = ['bag', 'demos/demo_2.hdf5', 'demos/demo_10.hdf5']
    # Without its metadata, a folder of files is no bag: each file is a recording.
    runs = ['runs/day.mcap', 'runs/run_2.bag', 'runs/run_10.mcap']
    rest = [*runs, 'set', 'torn/bag_0.db3']
    assert found(tmp_path) == [*others, 'drive/imu.parquet', 'drive/odom.csv', *rest]
    assert found(tmp_path, ROBOT) == [*others, *rest]
    assert found(tmp_path / 'runs') == runs
    # By a robot file, its tables are the topics of one recording.
    assert found(tmp_path / 'drive', ROBOT) == ['drive']
    for name in ('bag', 'bag/bag_0.mcap', 'set', 'demos/demo_2.hdf5', 'drive/odom.csv'):
        assert found(tmp_path / name) == [name]


def test_loose_files_of_bags_are_read_one_by_one(tmp_path):
    pytest.importorskip('rosbags', reason='rosbags is not here')
    import bags

    (tmp_path / 'runs').mkdir()
    for number in range(2):
        bags.write_bag(tmp_path / f'bag_{number}', num_steps=31, seed=number)
        (file,) = (tmp_path / f'bag_{number}').glob('*.mcap')
        file.rename(tmp_path / 'runs' / f'run_{number}.mcap')
    robot, paths = parse_robot_file(bags.ROBOT), recordings_in(tmp_path / 'runs')
    assert [len(episodes_of_recording(path, robot).episodes) for path in paths] == [
        5,
        5,
    ]
    with pytest.raises(
        RecordingError, match=r'a folder of bags; expected one of them, such as .*/r'
    ):
        robot_file_of_recording(tmp_path / 'runs')
