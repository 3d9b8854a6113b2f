# SPDX-License-Identifier: Apache-2.0

"""Any robot: messages of its own types become episodes of the selector, by the robot file alone."""

import itertools
import json
import random
import signal
import time
from math import cos, hypot, sin

import pytest
from action_msgs.msg import GoalStatus, GoalStatusArray
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_action_status_default
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, LaserScan
from std_msgs.msg import Bool, Float32, Float64, String

from cmifs_ros.ros import conversions

FILE = """
step: {topic: /odom}
channels:
  x: /odom.pose.pose.position.x
  yaw: {path: /odom.pose.pose.orientation, as: yaw}
  scan: {path: "/scan.ranges[0:12:4]", inf: range_max}
  radio: {path: /radio.data, max_age: 5.0}
reward: "x - before(x) + 10 * succeeded"
episode: {action: /go}
discount: {half_life: 2.0}
"""
CHANNELS = ['x', 'yaw.sin', 'yaw.cos', 'scan[0]', 'scan[4]', 'scan[8]', 'radio']
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
OK, WARN, STALE = b'\x00', b'\x01', b'\x03'


@pytest.fixture
def robot_file(tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text(FILE)
    return path


class Drive:
    """A robot that moves ahead by itself, 100 steps a second; 10 of them are a goal."""

    def __init__(self, robot):
        node = robot.node
        self._clock = node.get_clock()
        self._publishers = {
            'odom': node.create_publisher(Odometry, '/odom', 10),
            'scan': node.create_publisher(LaserScan, '/scan', BEST_EFFORT),
            'radio': node.create_publisher(Float32, '/radio', 10),
            'status': node.create_publisher(
                GoalStatusArray, '/go/_action/status', qos_profile_action_status_default
            ),
        }
        self.silent = set()
        self.count, self._x, self._random = 0, 0.0, random.Random(0)
        node.create_timer(0.01, self._move)

    def publish(self, topic, message):
        if topic not in self.silent:
            self._publishers[topic].publish(message)

    def _move(self):
        goal, step = divmod(self.count, 10)
        stamp = self._clock.now().to_msg()
        if step == 0:
            status = GoalStatusArray()
            for number, code in ((goal - 1, 4), (goal, 2)):
                entry = GoalStatus(status=code)
                entry.goal_info.goal_id.uuid[:2] = divmod(number % 65536, 256)
                entry.goal_info.stamp = stamp
                status.status_list.append(entry)
            self.publish('status', status)
        scan = LaserScan(range_max=8.0, ranges=[float(step)] * 8 + [float('inf')] * 4)
        scan.header.stamp = stamp
        self.publish('scan', scan)
        self.publish('radio', Float32(data=self._random.gauss(-40, 2)))
        odometry = Odometry()
        odometry.header.stamp = stamp
        self._x = self._random.random() + (self._x if step else 0)
        odometry.pose.pose.position.x = self._x
        half = self._random.random()
        odometry.pose.pose.orientation.z, odometry.pose.pose.orientation.w = sin(half), cos(half)
        self.publish('odom', odometry)
        self.count += 1


def test_a_robot_of_its_own_topics_gives_episodes_and_groups(start, robot, robot_file):
    sampler = start('sampler_node', robot_file=robot_file)
    start('selector_node', selection_period=0.0, min_episodes=3, num_features=4)
    states, rewards = [], []
    robot.node.create_subscription(JointState, 'state', states.append, 10)
    robot.node.create_subscription(JointState, 'reward', rewards.append, 10)
    robot.until(lambda: {'sampler: steps', 'selector: input'} <= robot.diagnostics.keys())
    assert robot.diagnostics['sampler: steps'][0] == WARN
    assert 'nobody publishes it' in robot.diagnostics['sampler: /odom'][1]
    Drive(robot)  # Its publishers come after the sampler.
    robot.until(lambda: robot.value('episodes') >= 5)
    assert list(states[-1].name) == CHANNELS
    assert dict(zip(rewards[-1].name, rewards[-1].position, strict=True))['half_life'] == 2
    assert states[-1].position[4:6] == pytest.approx([states[-1].position[3], 8])
    assert hypot(*states[-1].position[1:3]) == pytest.approx(1)
    refusal = robot.set_parameter('num_features', 5)
    assert 'expected at most 4, the number of sensors' in refusal.reason
    reply = json.loads(robot.call(robot.select_client).message)
    assert set(reply['ranking']) == {'x', 'yaw', 'scan', 'radio'}
    robot.until(lambda: robot.diagnostics['sampler: /scan'][0] == OK)
    values = robot.diagnostics['sampler: /scan'][2]
    assert float(values['rate in Hz']) > 5
    assert (values['wrong'], float(values['age in s']) < 5) == ('0', True)
    assert sampler.end(signal.SIGTERM) == 0
    assert 'Traceback' not in sampler.output


def test_it_says_which_channel_breaks_episodes_and_goes_on(start, robot, robot_file):
    sampler = start('sampler_node', robot_file=robot_file)
    drive = Drive(robot)
    rewards = []
    robot.node.create_subscription(JointState, 'reward', rewards.append, 10)
    robot.until(lambda: len(rewards) > 20 and robot.diagnostics)
    drive.silent = {'scan'}
    robot.until(
        lambda: (
            'lack scan: silent for more than its max_age, 1 s; this'
            in robot.diagnostics['sampler: steps'][1]
        )
    )
    robot.until(lambda: robot.diagnostics['sampler: /scan'][0] == STALE)
    assert any(key.startswith('missing: scan') for key in robot.diagnostics['sampler: steps'][2])
    drive.silent = set()

    def is_wrong():
        drive.publish('scan', LaserScan(ranges=[1.0]))  # Too short, and without a stamp.
        return int(robot.diagnostics['sampler: /scan'][2]['wrong'])

    robot.until(is_wrong)  # again and again: a scan is sent at best effort
    before = len(rewards)
    robot.until(lambda: len(rewards) > before + 20)
    assert sampler.process.poll() is None


def test_messages_of_another_type_than_the_file_means_do_not_end_it(start, robot, tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text(
        'step: {topic: /text}\nreward: "1 / a"\nepisode: {action: /go}\n'
        'channels: {a: /text.data, b: {path: /b.data, type: std_msgs/msg/Float64}}\n'
    )
    sampler = start('sampler_node', robot_file=path)
    text = robot.node.create_publisher(String, '/text', 10)
    status = robot.node.create_publisher(Float32, '/go/_action/status', 10)
    robot.node.create_publisher(Float32, '/b', 10)
    robot.until(lambda: text.get_subscription_count() and status.get_subscription_count())
    # Again and again: that one side knows the other does not mean that it is known there.
    robot.node.create_timer(0.1, lambda: text.publish(String(data='hello')))
    robot.node.create_timer(0.1, lambda: status.publish(Float32()))
    robot.until(
        lambda: all(
            int(robot.diagnostics.get(f'sampler: {topic}', ('', '', {}))[2].get('wrong', 0))
            for topic in ('/text', '/go/_action/status')
        )
    )
    said = "/text.data is the text 'hello'; expected a number"
    robot.until(lambda: said in robot.diagnostics['sampler: /text'][1])
    said = "/go/_action/status has no field 'status_list'; expected one of data"
    robot.until(lambda: said in robot.diagnostics['sampler: /go/_action/status'][1])
    said = '/b is of type std_msgs/msg/Float32, not std_msgs/msg/Float64 as in the robot file'
    robot.until(lambda: said in robot.diagnostics['sampler: /b'][1])
    assert said in sampler.output
    assert sampler.process.poll() is None


def test_a_file_with_mistakes_ends_it_with_all_of_them(start, tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text(FILE.replace('as: yaw', 'as: jaw').replace('+ 10', '+ scan * 10'))
    sampler = start('sampler_node', robot_file=path, robot='x')
    assert sampler.process.wait(20) == 2
    assert 'the name nearest to robot is robot_file' in sampler.output
    assert "line 5: yaw.as is 'jaw'; expected yaw" in sampler.output
    assert 'line 8: reward uses scan' in sampler.output
    assert 'Traceback' not in sampler.output


def test_stamps_of_steps_are_those_of_the_clock_topic(start, robot, robot_file):
    start('sampler_node', robot_file=robot_file)
    stamps = []
    robot.node.create_subscription(
        JointState,
        'state',
        lambda m: stamps.append(conversions.stamp_to_nanoseconds(m.header.stamp)),
        10,
    )
    begin = time.time_ns()
    Drive(robot)
    robot.until(lambda: len(stamps) > 10)
    assert begin <= stamps[0] <= stamps[-1] <= time.time_ns()
    assert stamps == sorted(set(stamps))


NUMBERS = 'step: {topic: /a}\nchannels: {a: /a.data}\nreward: a\n'


def test_a_publisher_may_come_back_with_another_type(start, robot, tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text(NUMBERS)
    sampler = start('sampler_node', robot_file=path)
    states = []
    robot.node.create_subscription(JointState, 'state', states.append, 10)
    for kind, number in ((Float32, 1.0), (Float64, 2.0), (Bool, 0.0)):
        publisher = robot.node.create_publisher(kind, '/a', 10)
        value = kind(data=bool(number) if kind is Bool else number)
        timer = robot.node.create_timer(0.05, lambda p=publisher, v=value: p.publish(v))
        robot.until(lambda n=number: states and states[-1].position[0] == n)
        robot.node.destroy_timer(timer)
        robot.node.destroy_publisher(publisher)
    assert 'Traceback' not in sampler.output


def test_the_last_steps_come_when_the_robot_falls_silent(start, robot, tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text(NUMBERS)
    start('sampler_node', robot_file=path)
    rewards = []
    robot.node.create_subscription(
        JointState, 'reward', lambda m: rewards.append(m.position[list(m.name).index('reward')]), 10
    )
    publisher = robot.node.create_publisher(Float32, '/a', 10)
    robot.until(
        lambda: publisher.get_subscription_count() and robot.node.count_publishers('reward')
    )
    sent = itertools.count()
    timer = robot.node.create_timer(
        0.05, lambda: publisher.publish(Float32(data=float(next(sent))))
    )
    robot.until(lambda: len(rewards) > 5)
    robot.node.destroy_timer(timer)
    last = next(sent) - 1
    robot.until(lambda: rewards[-1] == last)
    assert rewards == list(range(int(rewards[0]), last + 1))


def test_who_is_behind_with_receiving_takes_the_simulated_time_at_which_each_came(
    start, robot, tmp_path
):
    path = tmp_path / 'robot.yaml'
    path.write_text('step: {rate: 10.0}\nchannels: {radio: /radio.data}\nreward: radio\n')
    node, states = robot.node, []
    clock = node.create_publisher(Clock, '/clock', 1000)
    radio = node.create_publisher(Float32, '/radio', 1000)
    node.create_subscription(JointState, 'state', states.append, 1000)
    sampler = start('sampler_node', robot_file=path, use_sim_time=True)
    steps = itertools.count()

    def publish():
        # Whatever has no header is at the time of the clock: a number between any two steps.
        step = next(steps)
        clock.publish(Clock(clock=Time(nanoseconds=step * 10**8 + 5 * 10**7).to_msg()))
        radio.publish(Float32(data=float(step)))
        return step

    robot.until(lambda: publish() and states)  # Both are heard.
    sampler.process.send_signal(signal.SIGSTOP)
    begin = publish() * 10**8
    for _ in range(60):
        publish()
    sampler.process.send_signal(signal.SIGCONT)

    def time(message):
        return conversions.stamp_to_nanoseconds(message.header.stamp)

    robot.until(lambda: sum(time(message) > begin for message in states) >= 30)
    for message in states:
        if time(message) > begin:
            assert message.position[0] == time(message) // 10**8 - 1


def test_a_simulation_that_is_reset_gives_steps_in_each_run(start, robot, tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text(
        'step: {rate: 10.0}\nchannels: {x: /odom.pose.pose.position.x}\nreward: x\n'
        'episode: {steps: 10}\n'
    )
    node, steps = robot.node, []
    clock = node.create_publisher(Clock, '/clock', 1000)
    odom = node.create_publisher(Odometry, '/odom', 1000)
    node.create_subscription(JointState, 'reward', lambda m: steps.append(list(m.position)), 1000)
    start('sampler_node', robot_file=path, use_sim_time=True)

    def publish(step):
        stamp = Time(nanoseconds=step * 10**8 + 5 * 10**7).to_msg()
        clock.publish(Clock(clock=stamp))
        message = Odometry()
        message.header.stamp = stamp
        message.pose.pose.position.x = float(step)
        odom.publish(message)

    def of(run):
        backs = [i for i in range(1, len(steps)) if steps[i][0] < steps[i - 1][0]]
        return steps[backs[-1] :] if len(backs) == run else []

    first = itertools.count()
    robot.until(lambda: publish(next(first)) or steps)  # Both are heard.
    for run in range(1, 4):
        for step in range(70):
            publish(step)
        robot.until(lambda run=run: len(of(run)) >= 50)
    # Ten in a row of an episode, of which each reaches what was published of it.
    found = of(3)[:10]
    assert found == [[float(n), 0, float(n == 10), found[0][3], n - 1] for n in range(1, 11)]


def test_the_last_goal_of_a_robot_that_falls_silent_has_its_end(start, robot, tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text(
        'step: {rate: 10.0}\nchannels: {a: /a.data}\nreward: 10 * succeeded\n'
        'episode: {action: /go}\n'
    )
    node, ends = robot.node, []
    status = node.create_publisher(
        GoalStatusArray, '/go/_action/status', qos_profile_action_status_default
    )
    number = node.create_publisher(Float32, '/a', 10)
    steps = []

    def take(message):
        sample = dict(zip(message.name, message.position, strict=True))
        (ends if sample['terminated'] else steps).append(sample)

    node.create_subscription(JointState, 'reward', take, 10)
    start('sampler_node', robot_file=path)
    robot.until(lambda: number.get_subscription_count() and status.get_subscription_count())
    status.publish(GoalStatusArray(status_list=[GoalStatus(status=2)]))
    timer = node.create_timer(0.05, lambda: number.publish(Float32(data=1.0)))
    robot.until(lambda: len(steps) > 5)
    node.destroy_timer(timer)
    status.publish(GoalStatusArray(status_list=[GoalStatus(status=4)]))
    robot.until(lambda: ends)
    assert [sample['reward'] for sample in ends] == [10]


def test_a_lateness_that_is_none_ends_it(start, robot_file):
    sampler = start('sampler_node', robot_file=robot_file, max_lateness=-1.0)
    assert sampler.process.wait(20) == 2
    assert 'max_lateness is -1.0; expected seconds, 0 or more' in sampler.output
