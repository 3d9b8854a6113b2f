"""Faults, each injected for real into a running selector."""

import json
import os
import signal

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from cmifs_ros.collect.transitions import RewardSample
from cmifs_ros.core import Episode
from cmifs_ros.ros import conversions
from cmifs_ros.sim import channel_names, rollout
from studies.soak.soak import random_reward, random_state

NAMES = ('a', 'b', 'c')
INPUT, SELECTION = 'selector: input', 'selector: selection'
OK, WARN, ERROR, STALE = b'\x00', b'\x01', b'\x02', b'\x03'


def episodes_of(states):
    """Return episodes of 3 steps whose reward is channel c."""
    return [Episode(s, s[:, 2]) for s in np.reshape(states, (-1, 3, 3))]


def normal_episodes(count=24, offset=0.0):
    return episodes_of(np.random.default_rng(0).normal(size=(count, 3, 3)) + offset)


@pytest.fixture
def selector(start, robot):
    node = start('selector_node', selection_period=0.0)
    robot.wait_for_selector()
    return node


def test_a_worker_may_be_killed_again_and_again(selector, robot):
    robot.publish_episodes(rollout('with_gravel', 30, seed=0), channel_names('with_gravel'))
    robot.wait_for_episodes(30)
    assert robot.set_parameter('num_features', 1).successful

    def kill_worker(state):
        robot.diagnostics.clear()
        robot.until(
            lambda: (
                SELECTION in robot.diagnostics
                and robot.diagnostics[SELECTION][2]['worker'] == state
                and robot.diagnostics[SELECTION][2]['worker pid'] != 'none'
            )
        )
        os.kill(int(robot.diagnostics[SELECTION][2]['worker pid']), signal.SIGKILL)

    for _ in range(2):
        assert robot.call(robot.select_client).success
        kill_worker('idle')
        robot.until(lambda: robot.diagnostics[SELECTION][2]['worker pid'] == 'none')
    assert robot.call(robot.select_client).success
    assert robot.set_parameter('num_features', 0).successful
    for _ in range(2):
        future = robot.select_client.call_async(robot.select_client.srv_type.Request())
        kill_worker('computing')
        robot.until(future.done)
        assert not future.result().success
        assert 'the worker process died' in json.loads(future.result().message)['error']
    assert robot.set_parameter('num_features', 1).successful
    assert json.loads(robot.call(robot.select_client).message)['episodes'] == 30


def test_a_selection_that_takes_too_long_is_ended_and_the_next_one_works(selector, robot):
    robot.publish_episodes(normal_episodes(), NAMES)
    robot.wait_for_episodes(24)
    assert robot.set_parameter('selection_timeout', 0.01).successful
    reply = robot.call(robot.select_client)
    assert not reply.success
    expected = 'the selection took longer than 0.01 s (selection_timeout)'
    assert json.loads(reply.message)['error'] == expected
    robot.until(lambda: robot.diagnostics[SELECTION][:2] == (ERROR, expected))
    assert robot.diagnostics[SELECTION][2]['worker pid'] == 'none'
    assert robot.set_parameter('selection_timeout', 0.0).successful
    assert robot.call(robot.select_client).success
    robot.until(lambda: robot.diagnostics[SELECTION][0] == OK)


def test_publishers_come_and_go(selector, robot, make_robot):
    (whole,) = normal_episodes(1)
    stamp = robot.publish_episodes([whole], NAMES)
    robot.publish_state(stamp, NAMES, whole.states[0])
    robot.publish_reward(stamp, RewardSample(0.0, False, False, 1, 0))
    robot.until(lambda: robot.value('transitions') == 4)
    again = make_robot()
    again.wait_for_selector()
    again.until(lambda: again.diagnostics[INPUT][0] == WARN)
    assert 'more than one node publishes state, reward' in again.diagnostics[INPUT][1]
    for publisher in (robot.state_publisher, robot.reward_publisher):
        robot.node.destroy_publisher(publisher)
    stamp = again.publish_episodes(normal_episodes(2), NAMES, begin=stamp + 1)
    again.wait_for_episodes(3)
    assert again.value('episodes dropped: lost_end') == 1
    again.publish_episodes(normal_episodes(2, offset=1.0), NAMES)  # time is set back
    again.wait_for_episodes(5)
    assert 'Traceback' not in selector.output


def test_simulated_time_is_only_shown_and_never_waited_for(start, robot):
    start('selector_node', selection_period=0.5, num_features=1, use_sim_time=True)
    robot.wait_for_selector()
    received = []
    robot.node.create_subscription(DiagnosticArray, '/diagnostics', received.append, 10)
    robot.publish_episodes(normal_episodes(), NAMES)  # there is no clock at all
    robot.wait_for_episodes(24)
    assert robot.latched('selected_indices').data.tolist() == [2]
    assert received[-1].header.stamp.sec == 0
    clock = robot.node.create_publisher(Clock, '/clock', 10)
    robot.until(clock.get_subscription_count)
    for seconds in (1000, 500):  # forwards and back
        now = Clock(clock=conversions.stamp_from_nanoseconds(seconds * 10**9))

        def is_shown(now=now):
            clock.publish(now)  # again: a clock is sent at best effort
            return received[-1].header.stamp.sec == now.clock.sec

        robot.until(is_shown)
    robot.publish_episodes(normal_episodes(1), NAMES, begin=10**12)
    robot.wait_for_episodes(25)


def test_a_reward_that_never_comes_is_told(selector, robot):
    robot.until(lambda: robot.diagnostics[INPUT][:2] == (WARN, 'no state has come yet'))
    for stamp in range(1, 1201):
        robot.publish_state(stamp, NAMES, [1.0, 2.0, 3.0])
        robot.executor.spin_once(timeout_sec=0)
    robot.until(lambda: robot.value('messages dropped: state_without_reward') == 200)
    assert robot.value('unpaired messages') == 1000
    assert robot.diagnostics[INPUT][:2] == (WARN, 'states come, but no reward for 5 s')
    robot.until(lambda: robot.diagnostics[INPUT][0] == STALE)
    assert robot.diagnostics[INPUT][1].startswith('no state for ')


def test_huge_and_constant_values_are_answered(selector, robot):
    robot.publish_episodes(episodes_of(np.full((24, 3, 3), 1.5)), NAMES)
    robot.wait_for_episodes(24)
    reply = robot.call(robot.select_client)
    assert not reply.success
    assert json.loads(reply.message)['error']
    robot.call(robot.clear_client)
    huge = np.random.default_rng(0).choice([-1e308, 1e308], size=(24, 3, 3))
    robot.publish_episodes(episodes_of(huge), NAMES, begin=10**12)
    robot.wait_for_episodes(24)
    reply = robot.call(robot.select_client)
    assert json.loads(reply.message)['names' if reply.success else 'error']
    robot.call(robot.clear_client)
    robot.publish_episodes(normal_episodes(), NAMES, begin=2 * 10**12)
    robot.wait_for_episodes(24)
    assert robot.call(robot.select_client).success
    assert 'Traceback' not in selector.output


def test_a_publisher_with_an_incompatible_qos_is_warned_of_by_name(selector, robot):
    lossy = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = robot.node.create_publisher(JointState, 'state', lossy)
    robot.until(lambda: 'a publisher of state offers a QoS' in selector.output)
    (line,) = [line for line in selector.output.splitlines() if 'offers a QoS' in line]
    assert 'RELIABILITY' in line
    assert '/robot' in line
    robot.until(lambda: 'offers a QoS' in robot.diagnostics[INPUT][1])
    assert robot.diagnostics[INPUT][0] == WARN
    robot.node.destroy_publisher(publisher)
    robot.publish_episodes(normal_episodes(1), NAMES)
    robot.wait_for_episodes(1)


def test_data_that_have_changed_since_the_selection_turn_it_to_warn(selector, robot):
    stamp = robot.publish_episodes(normal_episodes(), NAMES)
    robot.wait_for_episodes(24)
    assert robot.call(robot.select_client).success
    stamp = robot.publish_episodes(normal_episodes(30), NAMES, begin=stamp)
    robot.wait_for_episodes(54)
    assert robot.diagnostics[SELECTION][0] == OK
    stamp = robot.publish_episodes(normal_episodes(30, [0.0, 5.0, 0.0]), NAMES, begin=stamp)
    robot.until(lambda: robot.diagnostics[SELECTION][0] == WARN)
    assert robot.diagnostics[SELECTION][1] == 'the data have changed since the selection: b'
    assert robot.call(robot.select_client).success
    robot.until(lambda: robot.diagnostics[SELECTION][0] == OK)


def test_random_messages_leave_the_node_as_it_was(selector, robot):
    rng = np.random.default_rng(0)
    for _ in range(1500):
        robot.state_publisher.publish(random_state(rng))
        robot.reward_publisher.publish(random_reward(rng))
        robot.executor.spin_once(timeout_sec=0)
    robot.until(lambda: robot.diagnostics[INPUT][0] == WARN)
    assert robot.call(robot.clear_client).success
    robot.publish_episodes(normal_episodes(), NAMES)
    robot.wait_for_episodes(24)
    assert robot.call(robot.select_client).success
    assert 'Traceback' not in selector.output
