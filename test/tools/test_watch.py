# SPDX-License-Identifier: Apache-2.0

"""`watch` in a real terminal, beside real nodes."""

import os
import re
import signal
import subprocess
import time
from pathlib import Path

import pexpect
import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not here')
from ament_index_python.packages import get_package_prefix
from saved_episodes import NAMES, SELECTION, episodes

from cmifs_ros.collect.episodes import file as episode_file
from cmifs_ros.collect.episodes.file_format import Saved

EXECUTABLES = Path(get_package_prefix('cmifs_ros'), 'lib', 'cmifs_ros')
COLUMNS, LINES = 80, 24
ROBOT = """
step: {rate: 10.0}
channels: {x: {path: /odom.pose.pose.position.x, type: nav_msgs/msg/Odometry}}
reward: "x"
episode: {steps: 5}
"""
ROBOT_OF_TWO = """
step: {rate: 10.0}
channels: {a: /a.data, b: /b.data}
reward: b
"""


def environment(number):
    return os.environ | {
        'ROS_DOMAIN_ID': str(1 + (os.getpid() + 7 * number) % 100),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'TERM': 'xterm-256color',
    }


@pytest.fixture
def watch():
    """Start the installed command in a terminal."""
    terminals = []

    def start(number, *arguments):
        terminal = pexpect.spawn(
            str(EXECUTABLES / 'watch'), list(arguments), env=environment(number),
            dimensions=(LINES, COLUMNS), timeout=300, encoding='utf-8',
        )  # fmt: skip
        terminals.append(terminal)
        return terminal

    yield start
    for terminal in terminals:
        terminal.close(force=True)


@pytest.fixture
def start(tmp_path):
    """Start a node."""
    running = []

    def start_(number, node, *settings, namespace='/'):
        parameters = [word for setting in settings for word in ('-p', setting)]
        with (tmp_path / node).open('w') as output:
            running.append(
                subprocess.Popen(
                    [EXECUTABLES / node, '--ros-args', '-r', f'__ns:={namespace}', *parameters],
                    env=environment(number), stdin=subprocess.DEVNULL, stdout=output,
                    stderr=subprocess.STDOUT,
                )
            )  # fmt: skip

    yield start_
    for process in running:
        process.terminate()
    for process in running:
        process.wait(10)


@pytest.fixture
def robot(start):
    """Start a selector and a simulator in a namespace."""

    def start_both(number, namespace):
        settings = ('min_episodes:=10', 'selection_period:=1.0', 'num_features:=2')
        start(number, 'selector_node', *settings, namespace=namespace)
        start(number, 'simulator_node', 'rate:=200.0', 'seed:=0', namespace=namespace)

    return start_both


def plain(text):
    """Return what the escape sequences of a terminal leave."""
    return re.sub(r'\x1b\[[0-9;?]*[A-Za-z]', '', text).replace('\r', '')


def run(number, *options):
    return subprocess.run(
        [EXECUTABLES / 'watch', *options], env=environment(number), capture_output=True, text=True,
        timeout=60, check=False,
    )  # fmt: skip


def test_the_live_view_shows_a_selection_as_it_comes_and_ends_on_ctrl_c(robot, watch):
    robot(0, '/robot1')
    terminal = watch(0, '--namespace', 'robot1')
    terminal.expect('/robot1/selector')
    terminal.expect('episodes')
    terminal.expect(r'ago \(timer\), from \d+')
    terminal.expect('95 % interval')
    terminal.expect('2  ')
    terminal.sendintr()
    terminal.expect(pexpect.EOF)
    terminal.close()
    assert terminal.exitstatus == 0
    assert 'Traceback' not in terminal.before
    # The alternate screen is left, and the last view stays on the ordinary one.
    last = plain(terminal.before.rpartition('\x1b[?1049l')[2])
    assert '/robot1/selector' in last
    assert re.search(r'^ +1 +\S+ .*\n +2 +\S+ ', last, re.M)
    assert max(map(len, last.splitlines())) <= COLUMNS
    assert len(last.rstrip().splitlines()) <= LINES


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_also_with_no_selector_there(watch, number):
    terminal = watch(1 + number)
    terminal.expect('no selector heard')
    terminal.kill(number)
    terminal.expect(pexpect.EOF)
    terminal.close()
    assert terminal.exitstatus == 0
    assert 'Traceback' not in terminal.before


def test_into_a_pipe_it_prints_one_view_and_ends(robot):
    robot(20, '/')
    result = run(20)
    assert result.returncode == 0, result.stderr
    assert result.stdout.count('/selector') == 1
    assert '\x1b' not in result.stdout
    unread = subprocess.Popen(
        [EXECUTABLES / 'watch'], env=environment(20), stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    unread.stdout.close()
    assert unread.stderr.read() == b''
    unread.stderr.close()
    assert unread.wait(60) == 128 + signal.SIGPIPE


def test_the_sampler_beside_the_selector_is_shown_and_not_taken_for_it(start, watch, tmp_path):
    (tmp_path / 'robot.yaml').write_text(ROBOT)
    start(40, 'sampler_node', f'robot_file:={tmp_path}/robot.yaml')
    terminal = watch(40)
    terminal.expect('no selector heard')
    terminal.expect('sampler.*/odom')  # alone, it is shown all the same
    start(40, 'selector_node')
    terminal.expect('/selector ')
    terminal.expect('/odom .*no message arrived')
    terminal.sendintr()
    terminal.expect(pexpect.EOF)
    terminal.close()
    assert terminal.exitstatus == 0
    assert 'Traceback' not in terminal.before


def test_beside_a_sampler_it_ends_with_the_topics_that_can_go_and_writes_a_report(start, tmp_path):
    saved = Saved(NAMES, episodes(), SELECTION, time.time())
    episode_file.write(tmp_path / 'episodes', saved)
    (tmp_path / 'robot.yaml').write_text(ROBOT_OF_TWO)
    start(60, 'selector_node', f'episodes_path:={tmp_path}/episodes', 'selection_period:=0.0')
    start(60, 'sampler_node', f'robot_file:={tmp_path}/robot.yaml')
    shown = run(60)
    assert shown.stdout.endswith("""
keep these:
  /b: b adds 12.5%
these can go:
  /a: a adds at most 22.8%; as long as b stays
undecided: nothing
"""), shown.stdout  # fmt: skip
    written = run(60, '--report', tmp_path / 'page')
    assert written.stdout == f'written: {tmp_path}/page/index.html\n'
    assert written.returncode == 0
    page = (tmp_path / 'page' / 'index.html').read_text()
    assert '<h1>Selected: b</h1>' in page
    assert '<li>/a: a adds at most' in page


def test_without_a_selection_there_is_no_report_but_a_reason(start, tmp_path):
    start(80, 'selector_node')
    done = run(80, '--report', tmp_path / 'page')
    assert (done.returncode, done.stdout) == (1, '')
    assert done.stderr == 'watch: no selection yet: 0 episodes of at least 20\n'
    assert not (tmp_path / 'page').exists()


def test_a_bad_namespace_is_one_clear_sentence():
    result = run(30, '--namespace', 'a b')
    assert result.returncode == 2
    assert result.stderr == "watch: --namespace is 'a b'; expected a name such as /robot1\n"
