# SPDX-License-Identifier: Apache-2.0

"""Real nodes in real processes, each test in a ROS domain of its own."""

import itertools
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not here; core and sim do without it')
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'

import rclpy
from ament_index_python.packages import get_package_prefix
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from slow_episodes import SLOW_NAMES, slow_episodes
from std_msgs.msg import Header, Int32MultiArray
from std_srvs.srv import Trigger

from cmifs_ros.collect.episodes.builder import RewardSample
from cmifs_ros.ros import conversions

STREAM = QoSProfile(depth=10_000)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

_domains = itertools.cycle(range(1, 101))
for _ in range(os.getpid() % 100):  # Two test runs on one machine begin at different domains.
    next(_domains)


@pytest.fixture
def domain():
    return next(_domains)


@pytest.fixture
def start(domain, tmp_path):
    """Start an installed executable, as `ros2 run` finds it; end it when the test ends."""
    running = []

    def start_(executable, *arguments, **parameters):
        process = RunningNode(executable, arguments, parameters, domain, tmp_path)
        running.append(process)
        return process

    yield start_
    for process in running:
        process.kill()


class RunningNode:
    def __init__(self, executable, arguments, parameters, domain, folder):
        path = Path(get_package_prefix('cmifs_ros'), 'lib', 'cmifs_ros', executable)
        settings = [
            word
            for name, value in parameters.items()
            for word in ('-p', f'{name}:={str(value).lower() if value in (True, False) else value}')
        ]
        self.log = folder / f'{executable}_{len(list(folder.iterdir()))}.log'
        with self.log.open('w') as output:
            self.process = subprocess.Popen(
                [path, '--ros-args', *settings, *arguments],
                env=os.environ | {'ROS_DOMAIN_ID': str(domain)},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    @property
    def output(self):
        return self.log.read_text()

    def children(self):
        """Return the process ids of all descendants."""
        found, queue = [], [self.process.pid]
        while queue:
            for task in Path(f'/proc/{queue.pop()}/task').glob('*/children'):
                pids = [int(pid) for pid in task.read_text().split()]
                found += pids
                queue += pids
        return found

    def end(self, number=signal.SIGINT, group=False):
        """Send a signal, to the whole group as a terminal does or to the process alone.

        Return the exit code.
        """
        (os.killpg if group else os.kill)(self.process.pid, number)
        return self.process.wait(10)

    def kill(self):
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()


@pytest.fixture
def make_robot(domain):
    """Return a function that makes nodes of the test's own in the same domain.

    After a node was killed, a new one knows the living alone.
    """
    made = []

    def make():
        context = rclpy.Context()
        rclpy.init(context=context, domain_id=domain)
        made.append(Robot(context))
        return made[-1]

    yield make
    for robot in made:
        robot.node.destroy_node()
        rclpy.shutdown(context=robot.node.context)


@pytest.fixture
def robot(make_robot):
    return make_robot()


class Robot:
    """Publishes state and reward and keeps all that comes back."""

    def __init__(self, context):
        self.node = rclpy.create_node('robot', context=context)
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self.state_publisher = self.node.create_publisher(JointState, 'state', STREAM)
        self.reward_publisher = self.node.create_publisher(JointState, 'reward', STREAM)
        self.action_publisher = None
        self.selected = []
        self.diagnostics = {}
        self.node.create_subscription(JointState, 'selected_state', self._on_selected, STREAM)
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        self.select_client = self.node.create_client(Trigger, 'select_features', qos_profile=STREAM)
        self.clear_client = self.node.create_client(Trigger, 'selector/clear_episodes')

    def _on_selected(self, msg):
        self.selected.append(msg)

    def _on_diagnostics(self, msg):
        for status in msg.status:
            values = {pair.key: pair.value for pair in status.values}
            self.diagnostics[status.name] = (status.level, status.message, values)

    def until(self, condition, seconds=60.0):
        """Spin until a condition holds; fail if it does not in time."""
        deadline = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < deadline, f'timed out; diagnostics: {self.diagnostics}'
            self.executor.spin_once(timeout_sec=0.05)

    def wait_for_selector(self):
        """Wait until the selector and this node see each other on all topics and services."""
        self.until(
            lambda: (
                self.state_publisher.get_subscription_count() > 0
                and self.reward_publisher.get_subscription_count() > 0
                and self.node.count_publishers('selected_state') > 0
                and self.select_client.service_is_ready()
                and self.clear_client.service_is_ready()
                and self.diagnostics
            )
        )

    def act(self):
        """Begin to publish actions, and wait until the selector receives them."""
        self.action_publisher = self.node.create_publisher(JointState, 'action', STREAM)

        def is_heard():
            self.action_publisher.publish(JointState())  # Unusable, which is reported.
            _, _, values = self.diagnostics.get('selector: input', (b'', '', {}))
            return 'messages dropped: malformed_action' in values

        self.until(is_heard)

    def publish_state(self, stamp, names, values):
        header = Header(stamp=conversions.stamp_from_nanoseconds(stamp), frame_id='base')
        self.state_publisher.publish(conversions.named_values_to_msg(header, names, values))

    def publish_action(self, stamp, names, values):
        header = Header(stamp=conversions.stamp_from_nanoseconds(stamp))
        self.action_publisher.publish(conversions.named_values_to_msg(header, names, values))

    def publish_reward(self, stamp, sample):
        header = Header(stamp=conversions.stamp_from_nanoseconds(stamp))
        self.reward_publisher.publish(conversions.reward_sample_to_msg(header, sample, action=0))

    def publish_fields(self, stamp, **fields):
        """Publish a reward message with these fields alone."""
        header = Header(stamp=conversions.stamp_from_nanoseconds(stamp))
        self.reward_publisher.publish(
            conversions.named_values_to_msg(header, fields, fields.values())
        )

    def publish_episodes(self, episodes, names, begin=1, period=1_000_000):
        """Publish complete episodes; return the stamp after the last."""
        stamp = begin
        for number, episode in enumerate(episodes):
            for step, (state, reward) in enumerate(
                zip(episode.states, episode.rewards, strict=True)
            ):
                self.publish_state(stamp, names, state)
                ends = step == len(episode) - 1
                self.publish_reward(stamp, RewardSample(reward, False, ends, number, step))
                stamp += period
                self.executor.spin_once(timeout_sec=0)
        return stamp

    def publish_slow_episodes(self, begin=1):
        """Publish 40 episodes whose selection takes seconds; return the stamp after the last."""
        stamp = self.publish_episodes(slow_episodes(40), SLOW_NAMES, begin)
        self.wait_for_episodes(40)
        return stamp

    def value(self, key, status='selector: input'):
        """Return a number of the newest diagnostics; a count that is absent is 0."""
        return int(self.diagnostics[status][2].get(key, 0))

    def wait_for_episodes(self, count):
        self.until(lambda: self.value('episodes') == count)

    def call(self, client, request=None, seconds=300.0):
        """Call a service; a first selection compiles, which takes minutes on a busy machine."""
        future = client.call_async(request or Trigger.Request())
        self.until(future.done, seconds)
        return future.result()

    def ask(self, client, request):
        """Call a service that changes nothing, and again: a reply to a new client may be lost."""
        futures, begin = [], time.monotonic()

        def is_answered():
            if time.monotonic() - begin >= 15.0 * len(futures):
                futures.append(client.call_async(request))
            return any(future.done() for future in futures)

        self.until(is_answered)
        return next(future.result() for future in futures if future.done())

    def set_parameter(self, name, value):
        client = AsyncParameterClient(self.node, 'selector')
        self.until(client.services_are_ready)
        future = client.set_parameters([Parameter(name, value=value)])
        self.until(future.done)
        return future.result().results[0]

    def latched(self, topic, kind=Int32MultiArray):
        """Return the last message of a latched topic, as a subscriber that comes late."""
        received = []
        subscription = self.node.create_subscription(kind, topic, received.append, LATCHED)
        self.until(lambda: received)
        self.node.destroy_subscription(subscription)
        return received[-1]
