# SPDX-License-Identifier: Apache-2.0

"""The command `cmifs`, which pip installs, and `python3 -m cmifs_ros`: without ROS."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from cmifs_ros.tools import program

ROOT = Path(__file__).parents[2]


def run(*arguments):
    """Return the exit code, and what was printed."""
    # Not even where ROS is may it be imported.
    code = (
        "import sys; sys.modules['rclpy'] = None; sys.argv[0] = 'cmifs'; import cmifs_ros.__main__"
    )
    done = subprocess.run(
        [sys.executable, '-c', code, *arguments],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert 'Traceback' not in done.stderr
    return done.returncode, done.stdout + done.stderr


@pytest.mark.parametrize('arguments', [(), ('--help',)])
def test_help_lists_the_commands(arguments):
    code, said = run(*arguments)
    assert code == 0
    assert re.findall(r'^  ([a-z-]+) {2,}[A-Z]', said, re.M) == list(program.COMMANDS)


def test_a_command_that_there_is_not_is_refused():
    code, said = run('show')
    assert code == 2
    assert "invalid choice: 'show'" in said


@pytest.mark.parametrize('command', ['select', 'robot-file', 'demo'])
def test_each_command_has_help_of_its_own(command):
    code, said = run(command, '--help')
    assert code == 0
    assert said.startswith(f'usage: cmifs {command} ')


@pytest.mark.parametrize('command', ['watch', 'robot-file'])
def test_a_command_that_needs_ros_says_so(command):
    code, said = run(command)
    assert code == 1
    assert said == f'cmifs {command}: this needs ROS 2, but finds no rclpy: source ROS 2\n'


def test_an_error_names_the_command():
    code, said = run('select', 'nothing')
    assert code == 1
    assert said.startswith('cmifs select: nothing does not exist; expected a bag')


def test_the_demo_needs_no_ros(tmp_path):
    picture = tmp_path / 'new' / 'picture.png'
    code, said = run('demo', '--episodes', '40', '--num-features', '2', '--out', str(picture))
    assert code == 0, said
    assert re.search(r'^ +1  x +\d', said, re.M)
    assert 'selected x, y: 2 of 14 sensors\n2 of the 2 that matter in this world' in said
    assert picture.read_bytes().startswith(b'\x89PNG')
    assert max(len(line) for line in said.splitlines() if str(tmp_path) not in line) <= 80


@pytest.mark.parametrize('arguments', [('select', '--help'), ('demo', '--episodes', '12')])
def test_where_nobody_reads_its_output_it_ends_in_silence(tmp_path, arguments):
    environment = {k: v for k, v in os.environ.items() if k != 'PYTHONUNBUFFERED'}
    process = subprocess.Popen(
        [sys.executable, '-m', 'cmifs_ros', *arguments],
        cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    process.stdout.close()
    assert process.stderr.read() == b''
    process.stderr.close()
    assert process.wait(60) == 128 + signal.SIGPIPE


@pytest.mark.parametrize(
    ('build', 'expected'),
    [
        (['dist_info', '--output-dir'], {'cmifs'}),
        (['egg_info', '--egg-base'], {
            'demo', 'downstream', 'make_robot_file', 'sampler_node', 'select_from_bag',
            'selector_node', 'simulator_node', 'watch',
        }),
    ],
)  # fmt: skip
def test_a_wheel_puts_one_command_onto_the_path_and_colcon_what_ros2_run_finds(
    tmp_path, build, expected
):
    subprocess.run(
        [sys.executable, 'setup.py', '-q', *build, str(tmp_path)],
        cwd=ROOT, check=True, capture_output=True,
    )  # fmt: skip
    (points,) = tmp_path.rglob('entry_points.txt')
    assert set(re.findall(r'^(\w+) = cmifs_ros', points.read_text(), re.M)) == expected
