# SPDX-License-Identifier: Apache-2.0

"""make_robot_file: from the running robot it writes what it writes from that robot's bag."""

import itertools
import os
import re
import subprocess
from pathlib import Path

import pytest

pytest.importorskip('rosbags', reason='rosbags is not here')

from action_msgs.msg import GoalStatusArray
from ament_index_python.packages import get_package_prefix
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_action_status_default
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image, JointState, LaserScan
from std_msgs.msg import Bool, Float32, String

from cmifs_ros.collect.observed_bag import robot_file_of_bag
from cmifs_ros.collect.robot_file.reader import parse_robot_file
from studies.robot.recorder import Recorder

BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
MESSAGES = {
    '/odom': (Odometry(), 10),
    '/scan': (LaserScan(ranges=[1.0] * 360), BEST_EFFORT),
    '/camera': (Image(height=4, width=4, encoding='mono8', step=4, data=[1] * 16), BEST_EFFORT),
    '/joint_states': (JointState(name=['hip', 'knee'], position=[1.0, 2.0]), 10),
    '/said': (String(data='hello'), 10),
    '/bumper': (Bool(), 10),
    '/my/radio': (Float32(), 10),
    '/go/_action/status': (GoalStatusArray(), qos_profile_action_status_default),
    '/diagnostics': (DiagnosticArray(), 10),
}


def command(domain, *options):
    path = Path(get_package_prefix('cmifs_ros'), 'lib', 'cmifs_ros', 'make_robot_file')
    return subprocess.Popen(
        [path, *options], env=os.environ | {'ROS_DOMAIN_ID': str(domain)}, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def test_the_running_robot_gives_what_its_bag_gives(robot, domain, tmp_path):
    topics = {topic: (type(message), qos) for topic, (message, qos) in MESSAGES.items()}
    topics['/clock'] = Clock, 10
    recorder = Recorder(robot.node, tmp_path / 'bag', topics)
    for topic, (message, qos) in MESSAGES.items():
        publisher = robot.node.create_publisher(type(message), topic, qos)
        robot.node.create_timer(0.1, lambda p=publisher, m=message: p.publish(m))
    clock, simulated = robot.node.create_publisher(Clock, '/clock', 10), itertools.count(0, 10**7)
    robot.node.create_timer(  # Ten times slower than real time.
        0.1, lambda: clock.publish(Clock(clock=Time(nanoseconds=next(simulated)).to_msg()))
    )
    robot.until(lambda: recorder.num_messages > 20 * len(topics))
    process = command(domain, '--seconds', '4')
    robot.until(lambda: process.poll() is not None)
    recorder.close()
    live, said = process.communicate()
    assert process.returncode == 0, said
    # The test's node has publishers of its own, that never speak.
    live = [line for line in live.splitlines() if not line.endswith('has no messages')]
    bag = robot_file_of_bag(tmp_path / 'bag').splitlines()
    assert live[0].startswith('# Written by make_robot_file from the running robot.')
    # A busy machine is heard more slowly than it was recorded.
    rates = '# Seen: ', 'step: '
    assert [line for line in live[1:] if not line.startswith(rates)] == [
        line for line in bag[1:] if not line.startswith(rates)
    ]
    assert 'use_sim_time:=true' in '\n'.join(live)
    (fastest,) = re.findall(r'(?m)^# Seen: .* ([\d.]+) Hz \(\S+\)\.$', '\n'.join(live))
    assert 50 < float(fastest) < 200  # 100 Hz by /clock, less than 11 Hz in real time
    text = re.sub('(?m)^  # ', '  ', '\n'.join(live))  # Nothing of this robot ever changes.
    made = parse_robot_file(f'{text}\nreward: "1"\n')
    assert {source.path.topic for source in made.sources} == {
        '/odom', '/scan', '/joint_states', '/bumper', '/my/radio', '/camera'
    }  # fmt: skip
    assert 'camera: {path: "/camera", as: image}' in text
    assert '{action: /go}' in text


def test_without_a_robot_it_says_so(domain):
    process = command(domain, '--seconds', '1')
    _, said = process.communicate(timeout=30)
    assert process.returncode == 1
    assert 'no message was heard in 1 s; is the robot running' in said
    assert 'Traceback' not in said
