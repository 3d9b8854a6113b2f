# SPDX-License-Identifier: Apache-2.0

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

for package in ('rclpy', 'irsim', 'rosbags'):
    pytest.importorskip(package, reason=f'{package} is not here')


def test_live_and_from_the_bag_episodes_and_selection_are_the_same():
    process = subprocess.run(
        [sys.executable, '-m', 'studies.robot', '--goals', '2', '--speed', '2'],
        env=os.environ | {'ROS_DOMAIN_ID': '101'},  # No other test has it.
        cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert process.returncode == 0, process.stdout + process.stderr
    assert 'the same 2 episodes live and from the bag, byte for byte' in process.stdout
    assert 'the same selection live and from the bag: ' in process.stdout
    late = re.findall(r'sampler: (/\S+): (\d+) messages, (\d+) late, (\d+) wrong', process.stdout)
    assert {topic for topic, *_ in late} == {
        '/odom', '/scan', '/other/scan', '/imu', '/battery_state', '/temperature', '/radio',
        '/go_to/_action/status',
    }  # fmt: skip
    assert all(int(count) > 0 for _, count, *_ in late)
