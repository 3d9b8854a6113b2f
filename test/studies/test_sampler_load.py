# SPDX-License-Identifier: Apache-2.0

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not here')


def test_the_load_is_published_and_nearly_all_of_it_received():
    process = subprocess.run(
        [sys.executable, '-m', 'studies.robot.load', '--seconds', '2'],
        env=os.environ | {'ROS_DOMAIN_ID': '101'},  # No other test has it.
        cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False, timeout=200,
    )  # fmt: skip
    assert process.returncode == 0, process.stdout + process.stderr
    rows = re.findall(r'^\| (.+?) \| (\d+)% \| (\d+) \| (-?\d+) \|$', process.stdout, re.M)
    assert [row[0] for row in rows] == ['subscribes', 'subscribes, raw', 'sampler_node']
    for _, share, sent, lost in rows:
        assert int(share) > 0
        assert int(sent) == 2 * (50 + 20 + 400 + 500)
        assert 0 <= int(lost) < 0.1 * int(sent)
    row = r'^\| ([^|]+?) \| (-?[0-9.]+) \| -?[0-9.]+ \|$'
    ages = dict(re.findall(row, process.stdout, re.M))
    selected = 'selected_state of the sampler'
    assert list(ages) == ['bare relay of /odom', selected, 'the sampler adds']
    assert float(ages[selected]) > 0
