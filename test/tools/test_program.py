# SPDX-License-Identifier: Apache-2.0

"""Every installed command ends with a sentence or in silence, whenever it is told to."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not here')
from ament_index_python.packages import get_package_prefix
from processes import group

COMMANDS = 'demo', 'downstream', 'selector_node', 'simulator_node'


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('loaded', ['_rclpy_pybind11', 'librcl_logging'])
@pytest.mark.parametrize('command', COMMANDS)
def test_a_signal_during_the_start_ends_it_without_a_traceback(tmp_path, command, loaded, number):
    output = tmp_path / 'output'
    with output.open('w') as file:
        process = subprocess.Popen(
            [Path(get_package_prefix('cmifs_ros'), 'lib', 'cmifs_ros', command)],
            cwd=tmp_path,
            env=os.environ | {'ROS_DOMAIN_ID': str(1 + os.getpid() % 100)},
            stdout=file,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    maps = Path(f'/proc/{process.pid}/maps')
    try:
        deadline = time.monotonic() + 30
        while loaded not in maps.read_text():
            assert time.monotonic() < deadline
        os.killpg(process.pid, number)
        begin = time.monotonic()
        process.wait(20)
        assert time.monotonic() < begin + 4  # 2 s, and room for a busy machine
    finally:
        for pid in group(process.pid):
            os.kill(pid, signal.SIGKILL)
        process.wait()
    assert 'Traceback' not in output.read_text()


HANGING = """
import ctypes
from cmifs_ros.ros import run_node, simulator_node

# As Fast DDS waits for the mutex of a killed process: with the interpreter lock held.
simulator_node.SimulatorNode.destroy_node = lambda self: ctypes.PyDLL(None).pause()
run_node.run_node('simulator_node', 'SimulatorNode')
"""


def test_a_middleware_that_hangs_at_the_end_does_not_keep_a_node_from_ending(tmp_path):
    output = tmp_path / 'output'
    with output.open('w') as file:
        process = subprocess.Popen(
            [sys.executable, '-c', HANGING],
            env=os.environ | {'ROS_DOMAIN_ID': str(1 + os.getpid() % 100)},
            stdout=file,
            stderr=subprocess.STDOUT,
        )
    try:
        deadline = time.monotonic() + 60
        while '[simulator]' not in output.read_text():
            assert time.monotonic() < deadline
            time.sleep(0.05)
        process.send_signal(signal.SIGTERM)
        assert process.wait(60) == -signal.SIGALRM
    finally:
        process.kill()
        process.wait()


@pytest.mark.parametrize(
    ('node', 'parameter', 'said'),
    [
        ('selector_node', 'method:=none', "method is 'none'; expected one of"),
        ('sampler_node', 'robot_file:=none', 'none cannot be read (No such file or directory)'),
        ('simulator_node', 'scenario:=none', "scenario is 'none'; expected one of"),
    ],
)
def test_the_module_of_a_node_runs_it_as_the_executable_does(node, parameter, said):
    done = subprocess.run(
        [sys.executable, '-m', f'cmifs_ros.ros.{node}', '--ros-args', '-p', parameter],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert said in done.stderr
    assert 'Traceback' not in done.stderr
