# SPDX-License-Identifier: Apache-2.0

import re

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not here')

from studies.loop import closed_loop


def test_the_loop_runs_with_and_without_the_selector(tmp_path, capsys):
    path = tmp_path / 'new' / 'returns.png'
    options = ['--trials', '1', '--episodes', '200', '--rate', '300', '--out', str(path)]
    assert closed_loop.main(options) == 0
    output = capsys.readouterr().out
    assert len(re.findall(r'the last 50 episodes return \d', output)) == 2
    # The learner saw all channels first, and few of them when the selector had selected.
    seen = re.findall(r'^  sees (.*)$', output, re.M)
    few, many = sorted(len(names.split()) for names in seen[:2])
    assert 1 <= few < many == 14
    assert len(seen[-1].split()) == 14
    assert path.read_bytes().startswith(b'\x89PNG')
