# SPDX-License-Identifier: Apache-2.0

import os
import re
import signal
import subprocess
import time
from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not here')
from ament_index_python.packages import get_package_prefix
from processes import group


@pytest.fixture
def demo(tmp_path):
    """Start the installed demo, small, in a process group of its own."""
    running = []

    def start(*arguments):
        path = Path(get_package_prefix('cmifs_ros'), 'lib', 'cmifs_ros', 'demo')
        with (tmp_path / 'output').open('w') as output:
            process = subprocess.Popen(
                [path, '--episodes', '20', '--num-features', '2', '--rate', '400', *arguments],
                cwd=tmp_path,
                env={k: v for k, v in os.environ.items() if k != 'ROS_DOMAIN_ID'},
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        running.append(process)
        return process

    yield start
    for process in running:
        for pid in group(process.pid):
            os.kill(pid, signal.SIGKILL)
        process.wait()


def test_the_demo_shows_evidence_and_received_states_and_saves_a_picture(demo, tmp_path):
    process = demo()
    assert process.wait(60) == 0, (tmp_path / 'output').read_text()
    output = (tmp_path / 'output').read_text()
    ranked = re.findall(
        r'^ +(\d+) +(\w+) +-?\d+\.\d% +(?:below|\d+\.\d% to) \d+\.\d% +'
        r'(?:confirmed|undecided|dispensable) +[\d.e-]+(?:  .*)?$', output, re.M,
    )  # fmt: skip
    assert [int(rank) for rank, _ in ranked] == list(range(1, len(ranked) + 1))
    assert re.search(
        rf'^keep these:\n  {ranked[0][1]}: adds .*\n  {ranked[1][1]}: adds', output, re.M
    )
    assert f'selected {ranked[0][1]}, {ranked[1][1]}: 2 of 14 sensors' in output
    assert re.search(r'^  before  x=\d+ y=\d+ battery=\d+ noise_4=-?\d+', output, re.M)
    assert len(re.findall(r'^  after   \w+=-?\d+ \w+=-?\d+$', output, re.M)) == 3
    picture = Path(re.search(r'picture: (.*)', output)[1])
    assert picture.read_bytes().startswith(b'\x89PNG')
    assert max(len(line) for line in output.splitlines() if str(tmp_path) not in line) <= 80
    assert group(process.pid) == []


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_interrupting_the_demo_leaves_no_process_behind(demo, tmp_path, number):
    process = demo()
    deadline = time.monotonic() + 20
    while len(group(process.pid)) < 4:  # the demo and its three processes
        assert time.monotonic() < deadline
        time.sleep(0.1)
    if number == signal.SIGINT:
        os.killpg(process.pid, number)  # as a terminal does
    else:
        process.terminate()
    assert process.wait(10) == 128 + number
    assert group(process.pid) == []
    assert 'Traceback' not in (tmp_path / 'output').read_text()


def test_bad_arguments_are_one_clear_sentence(demo, tmp_path):
    assert demo('--episodes', '1').wait(20) == 2
    assert "got '1'; expected a whole number from 2" in (tmp_path / 'output').read_text()
