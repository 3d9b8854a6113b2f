# SPDX-License-Identifier: Apache-2.0

"""PX4's log, written here byte by byte as its format says."""

import struct

import numpy as np
import pytest

pytest.importorskip('pyulog', reason='pyulog is not here')

from cmifs_ros.collect.recorded_episodes import RecordingError
from cmifs_ros.collect.recording import (
    episodes_of_recording,
    recordings_in,
    robot_file_of_recording,
)
from cmifs_ros.collect.robot_file.reader import parse_robot_file

ROBOT = """
step: {topic: /pose}
channels:
  yaw: {path: /pose.q, as: yaw}
  speed: "/pose.v[0:3]"
  left: {path: /esc.esc_0.rpm}
  right: {path: /esc_1.esc_1.rpm}
reward: "right"
episode: {steps: 5}
"""
COUNT = 60


def message(kind, content):
    return struct.pack('<HB', len(content), ord(kind)) + content


def write(path):
    """Write poses at 10 Hz and two instances of motors just before; return what they were."""
    rng = np.random.default_rng(0)
    turns = rng.uniform(-3, 3, COUNT)
    speeds, rpms = rng.normal(size=(COUNT, 3)), rng.normal(size=(2, COUNT, 2))
    parts = [b'ULog\x01\x125\x01', struct.pack('<Q', 0), message('B', bytes(40))]
    for text in ('pose:uint64_t timestamp;float[4] q;float[3] v;', 'rotor:float rpm;',
                 'esc:uint64_t timestamp;rotor[2] esc;'):  # fmt: skip
        parts.append(message('F', text.encode()))
    for number, (instance, name) in enumerate([(0, b'pose'), (0, b'esc'), (1, b'esc')]):
        parts.append(message('A', struct.pack('<BH', instance, number) + name))
    for i in range(COUNT):
        time = 5_000_000 + i * 100_000
        for instance in (0, 1):
            rotors = struct.pack('<HQ2f', 1 + instance, time - 10, *rpms[instance, i])
            parts.append(message('D', rotors))
        turn = np.cos(turns[i] / 2), 0.0, 0.0, np.sin(turns[i] / 2)
        parts.append(message('D', struct.pack('<HQ4f3f', 0, time, *turn, *speeds[i])))
    path.write_bytes(b''.join(parts))
    return turns, speeds, rpms


def test_topics_instances_arrays_and_quaternions(tmp_path):
    turns, speeds, rpms = write(tmp_path / 'flight.ulg')
    robot = parse_robot_file(ROBOT)
    found = episodes_of_recording(tmp_path / 'flight.ulg', robot)
    assert not found.dropped
    assert len(found.episodes) == 10
    for number, episode in enumerate(found.episodes):
        begin = 6 * number  # Steps 0 to 4 and what the last one reaches.
        rows = slice(begin, begin + 5)
        left, right = rpms[0, rows, 0], rpms[1, rows, 1]
        expected = [np.sin(turns[rows]), np.cos(turns[rows]), *speeds[rows].T, left, right]
        np.testing.assert_allclose(episode.states, np.column_stack(expected), atol=1e-6)
        rewards = rpms[1, begin + 1 : begin + 6, 1]
        np.testing.assert_allclose(episode.rewards, rewards, atol=1e-6)
    assert found.stamps[0][0] == 5 * 10**9
    assert recordings_in(tmp_path, robot) == [tmp_path / 'flight.ulg']


def test_the_first_robot_file_names_all_fields(tmp_path):
    write(tmp_path / 'flight.ulg')
    text = robot_file_of_recording(tmp_path / 'flight.ulg')
    for path in ('{path: "/pose.q", as: yaw}', '"/pose.v[0:3]"', '"/esc_1.esc_1.rpm"'):
        assert path in text


def test_a_log_needs_a_robot_file_and_to_be_one(tmp_path):
    write(tmp_path / 'flight.ulg')
    with pytest.raises(RecordingError, match=r'holds messages; expected a robot file'):
        episodes_of_recording(tmp_path / 'flight.ulg')
    (tmp_path / 'torn.ulg').write_bytes(b'ULog')
    with pytest.raises(RecordingError, match='cannot be read as ULog'):
        episodes_of_recording(tmp_path / 'torn.ulg', parse_robot_file(ROBOT))
