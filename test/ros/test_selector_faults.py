# SPDX-License-Identifier: Apache-2.0

"""Faults, each injected for real into a running selector."""

import json
import os
import signal
from itertools import cycle

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String

from cmifs_ros.collect.episodes.builder import RewardSample
from cmifs_ros.core import Episode
from cmifs_ros.ros import conversions
from cmifs_ros.ros.qos import LATCHED_QOS
from studies.soak.messages import random_reward, random_state

NAMES = ('a', 'b', 'c')
INPUT, SELECTION = 'selector: input', 'selector: selection'
OK, WARN, ERROR, STALE = b'\x00', b'\x01', b'\x02', b'\x03'


def episodes_of(states):
    """Return episodes of 3 steps whose reward is channel c."""
    return [Episode(s, s[:, 2]) for s in np.reshape(states, (-1, 3, 3))]


def normal_episodes(count=24, offset=0.0, seed=0):
    return episodes_of(np.random.default_rng(seed).normal(size=(count, 3, 3)) + offset)


@pytest.fixture
def selector(start, robot):
    node = start('selector_node', selection_period=0.0)
    robot.wait_for_selector()
    return node


def test_the_worker_is_there_before_the_first_episode(selector, robot):
    robot.until(lambda: robot.diagnostics[SELECTION][2]['worker pid'] != 'none')
    assert robot.diagnostics[SELECTION][2]['worker'] == 'idle'


def test_a_worker_may_be_killed_again_and_again(selector, robot):
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

    stamp = robot.publish_episodes(normal_episodes(), NAMES)
    robot.wait_for_episodes(24)
    for _ in range(2):
        assert robot.call(robot.select_client).success
        kill_worker('idle')
        robot.until(lambda: robot.diagnostics[SELECTION][2]['worker pid'] == 'none')
    assert robot.call(robot.select_client).success
    robot.call(robot.clear_client)
    stamp = robot.publish_slow_episodes(begin=stamp)
    for _ in range(2):
        future = robot.select_client.call_async(robot.select_client.srv_type.Request())
        kill_worker('computing')
        robot.until(future.done)
        assert not future.result().success
        assert 'the worker process died' in json.loads(future.result().message)['error']
    robot.call(robot.clear_client)
    robot.publish_episodes(normal_episodes(), NAMES, begin=stamp)
    robot.wait_for_episodes(24)
    assert json.loads(robot.call(robot.select_client).message)['names'] == ['c']


def test_a_selection_that_takes_too_long_is_ended_and_the_next_one_works(selector, robot):
    robot.publish_slow_episodes()
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
    stamp = again.publish_episodes(normal_episodes(2, seed=1), NAMES, begin=stamp + 1)
    again.wait_for_episodes(3)
    assert again.value('episodes dropped: lost_end') == 1
    again.publish_episodes(normal_episodes(2, offset=1.0), NAMES)  # time is set back
    again.wait_for_episodes(5)
    assert 'Traceback' not in selector.output


def test_two_selectors_on_one_graph_are_told(selector, robot, start):
    other = start('selector_node', '-r', '__node:=other')
    said = '/other, /selector all publish /selection: end all but one'
    for name in 'selector', 'other':
        key = f'{name}: selection'
        robot.until(lambda key=key: robot.diagnostics.get(key, (OK, ''))[1].startswith(said))
        assert robot.diagnostics[key][0] == WARN
    assert said in selector.output
    assert other.end() == 0
    robot.until(lambda: robot.diagnostics[SELECTION][0] == OK)


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
    robot.publish_episodes(normal_episodes(1, seed=1), NAMES, begin=10**12)
    robot.wait_for_episodes(25)


def test_a_reward_that_never_comes_is_told(selector, robot):
    robot.until(lambda: robot.diagnostics[INPUT][:2] == (WARN, 'no state has arrived yet'))
    for stamp in range(1, 1201):
        robot.publish_state(stamp, NAMES, [1.0, 2.0, 3.0])
        robot.executor.spin_once(timeout_sec=0)
    robot.until(lambda: robot.value('messages dropped: state_without_reward') == 200)
    assert robot.value('unpaired messages') == 1000
    assert robot.diagnostics[INPUT][:2] == (WARN, 'states come, but no reward for 5 s')
    robot.until(lambda: robot.diagnostics[INPUT][0] == STALE)
    assert robot.diagnostics[INPUT][1].startswith('no state for ')


def test_huge_and_constant_values_are_answered(selector, robot):
    # Each of another length, as the same one again is not kept.
    constant = [Episode(np.full((n, 3), 1.5), np.full(n, 1.5)) for n in range(2, 26)]
    robot.publish_episodes(constant, NAMES)
    robot.wait_for_episodes(24)
    reply = robot.call(robot.select_client)
    assert reply.success
    assert json.loads(reply.message)['names'] == []
    what = 'no sensor changed in 24 episodes'
    robot.until(lambda: robot.diagnostics['selector: selection'][1].startswith(what))
    robot.call(robot.clear_client)
    huge = np.random.default_rng(0).choice([-1e308, 1e308], size=(24, 3, 3))
    robot.publish_episodes(episodes_of(huge), NAMES, begin=10**12)
    robot.wait_for_episodes(24)
    reply = robot.call(robot.select_client)
    assert not reply.success
    expected = 'a reward is 1e+308 in size; expected returns that do not overflow'
    assert json.loads(reply.message)['error'] == expected
    robot.call(robot.clear_client)
    robot.publish_episodes(normal_episodes(), NAMES, begin=2 * 10**12)
    robot.wait_for_episodes(24)
    assert robot.call(robot.select_client).success
    assert 'Traceback' not in selector.output


def test_publishers_at_best_effort_are_received(selector, robot, make_robot):
    lossy = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
    robot.node.destroy_publisher(robot.state_publisher)
    robot.state_publisher = robot.node.create_publisher(JointState, 'state', lossy)
    episodes = cycle(normal_episodes(10))
    stamp = 1

    def arrived():
        nonlocal stamp
        stamp = robot.publish_episodes([next(episodes)], NAMES, begin=stamp)
        return robot.value('episodes') >= 2

    robot.until(arrived)
    assert 'QoS' not in selector.output


def test_publishers_of_another_type_are_named(selector, robot):
    robot.node.destroy_publisher(robot.reward_publisher)
    robot.node.create_publisher(Float64, 'reward', 10)
    expected = 'reward comes from /robot as std_msgs/msg/Float64; expected sensor_msgs/msg/Joint'
    robot.until(lambda: expected in robot.diagnostics[INPUT][1])
    assert robot.diagnostics[INPUT][0] == WARN
    robot.until(lambda: selector.output.count(expected) == 1)


def test_stamps_that_differ_are_told_with_their_distance_and_may_be_tolerated(selector, robot):
    stamp = 1_000_000_000
    for episode in normal_episodes(2):
        for step, (state, reward) in enumerate(zip(episode.states, episode.rewards, strict=True)):
            robot.publish_state(stamp + 1_000_000, NAMES, state)
            robot.publish_reward(stamp, RewardSample(reward, False, step == 2, 0, step))
            stamp += 50_000_000
    robot.until(lambda: 'the nearest is 1 ms away' in robot.diagnostics[INPUT][1])
    assert robot.diagnostics[INPUT][0] == WARN
    assert 'stamp_tolerance' in selector.output
    robot.call(robot.clear_client)
    assert robot.set_parameter('stamp_tolerance', 0.002).successful
    for episode in normal_episodes(2):
        for step, (state, reward) in enumerate(zip(episode.states, episode.rewards, strict=True)):
            robot.publish_state(stamp + 1_000_000, NAMES, state)
            robot.publish_reward(stamp, RewardSample(reward, False, step == 2, 0, step))
            stamp += 50_000_000
    robot.wait_for_episodes(2)


def test_an_episode_that_comes_again_is_counted_and_not_kept(selector, robot):
    stamp = 1
    for loop in range(3):
        stamp = robot.publish_episodes(normal_episodes(5), NAMES, begin=stamp)
        robot.until(lambda loop=loop: robot.value('episodes repeated') == 5 * loop)
    assert robot.value('episodes') == 5
    assert selector.output.count('is a bag played in a loop') == 1


@pytest.mark.parametrize('first', ['arm', 'gripper'])
def test_of_parts_on_one_topic_the_one_with_the_rewards_stamps_is_the_state_and_the_remedy_is_told(
    selector, robot, first
):
    stamp = 10
    for number in range(4):
        for step in range(5):
            parts = [
                (stamp, ['shoulder', 'elbow'], [step, number]),
                (stamp - 3, ['gripper'], [0.0]),
            ]
            for part in parts if first == 'arm' else parts[::-1]:
                robot.publish_state(*part)
            robot.publish_reward(stamp, RewardSample(step, False, step == 4, number, step))
            stamp += 10
    robot.wait_for_episodes(4)
    expected = (
        'states with different channels alternate: those with shoulder, elbow are used, because '
        'they had the stamp of the first reward; those that differ by gripper are dropped; publish '
        'complete states, or merge the parts with the sampler'
    )
    robot.until(lambda: robot.diagnostics[INPUT][:2] == (WARN, expected))
    assert selector.output.count(expected) == 1


@pytest.mark.parametrize('restart', [False, True])
def test_a_robot_with_other_channels_begins_anew_if_wished_and_else_is_told_how(
    start, robot, restart
):
    node = start('selector_node', selection_period=0.0, restart_on_new_channels=restart)
    robot.wait_for_selector()
    stamp = robot.publish_episodes(normal_episodes(2), NAMES)
    robot.wait_for_episodes(2)
    others = normal_episodes(20, seed=1)
    stamp = robot.publish_episodes(others, ('d', 'e', 'f'), begin=stamp)
    if restart:
        robot.until(lambda: robot.value('episodes') > 2)
        assert 'restart_on_new_channels' in node.output
        return
    robot.until(lambda: '~/clear_episodes' in robot.diagnostics[INPUT][1])
    assert '~/clear_episodes' in node.output
    assert '~/clear_episodes' in json.loads(robot.call(robot.select_client).message)['error']


def test_velocities_are_taken_and_passed_on_by_name(start, robot):
    start('selector_node', selection_period=0.0, fields='position,velocity')
    robot.wait_for_selector()
    msg = JointState(name=['wheel'], position=[1.0], velocity=[2.0])
    robot.state_publisher.publish(msg)
    robot.until(lambda: robot.selected)
    assert list(robot.selected[0].name) == ['wheel', 'wheel.velocity']
    assert robot.selected[0].position.tolist() == [1.0, 2.0]


def test_states_of_velocities_alone_name_the_remedy(selector, robot):
    robot.state_publisher.publish(JointState(name=['wheel'], velocity=[2.0]))
    robot.until(lambda: 'set fields to velocity' in selector.output)
    assert not robot.selected


def test_every_fifth_state_having_a_reward_is_no_reason_to_warn(selector, robot):
    stamp = 1
    for number, episode in enumerate(normal_episodes(8)):
        for step, (state, reward) in enumerate(zip(episode.states, episode.rewards, strict=True)):
            for _ in range(4):
                robot.publish_state(stamp, NAMES, state)
                stamp += 1
            robot.publish_state(stamp, NAMES, state)
            robot.publish_reward(stamp, RewardSample(reward, False, step == 2, number, step))
            stamp += 1
    robot.wait_for_episodes(8)
    assert robot.value('messages dropped: state_without_reward') >= 90
    assert robot.diagnostics[INPUT][:2] == (OK, 'collecting')


def test_whole_numbers_are_floats_and_unknown_parameters_named(start, robot):
    node = start('selector_node', gamma=1, selection_perod=5, use_sim_time=False)
    robot.wait_for_selector()
    assert 'selection_perod; the name nearest to selection_perod is selection_period' in node.output
    assert node.output.count('[WARN]') == 1
    assert robot.set_parameter('selection_period', 5).successful
    values = json.loads(robot.diagnostics[SELECTION][2]['parameters'])
    assert values['gamma'] == 1.0
    robot.until(
        lambda: json.loads(robot.diagnostics[SELECTION][2]['parameters'])['selection_period'] == 5
    )


def test_a_selection_can_be_cancelled_and_the_next_one_works(selector, robot):
    robot.publish_slow_episodes()
    cancel = robot.node.create_client(robot.select_client.srv_type, 'selector/cancel')
    robot.until(cancel.service_is_ready)
    assert not robot.call(cancel).success
    future = robot.select_client.call_async(robot.select_client.srv_type.Request())
    robot.until(lambda: robot.diagnostics[SELECTION][2]['worker'] == 'computing')
    assert robot.call(cancel).success
    robot.until(future.done)
    assert json.loads(future.result().message)['error'] == 'the selection was cancelled'
    assert robot.set_parameter('num_features', 1).successful
    assert robot.call(robot.select_client).success


def test_whoever_waits_is_answered_when_the_node_ends(selector, robot):
    robot.publish_slow_episodes()
    assert robot.set_parameter('worker_threads', 2).successful
    future = robot.select_client.call_async(robot.select_client.srv_type.Request())
    robot.until(lambda: robot.diagnostics[SELECTION][2]['worker'] == 'computing')
    robot.until(lambda: len(selector.children()) >= 2)
    selector.end(signal.SIGINT, group=True)
    robot.until(future.done)
    assert 'shutting down' in json.loads(future.result().message)['error']
    assert 'leaked' not in selector.output


def test_data_that_have_changed_since_the_selection_turn_it_to_warn(selector, robot):
    stamp = robot.publish_episodes(normal_episodes(), NAMES)
    robot.wait_for_episodes(24)
    assert robot.call(robot.select_client).success
    stamp = robot.publish_episodes(normal_episodes(30, seed=1), NAMES, begin=stamp)
    robot.wait_for_episodes(54)
    assert robot.diagnostics[SELECTION][0] == OK
    doubts = []
    robot.node.create_subscription(
        String, 'selection', lambda m: doubts.append(json.loads(m.data)['doubt']), LATCHED_QOS
    )
    stamp = robot.publish_episodes(normal_episodes(30, [0.0, 5.0, 0.0], seed=2), NAMES, begin=stamp)
    robot.until(lambda: robot.diagnostics[SELECTION][0] == WARN)
    said = 'the data have changed since the selection: b'
    assert robot.diagnostics[SELECTION][1] == said
    robot.until(lambda: doubts == ['', said])
    assert robot.call(robot.select_client).success
    robot.until(lambda: robot.diagnostics[SELECTION][0] == OK)


def test_texts_of_a_sampler_that_cannot_be_read_are_told(selector, robot):
    rate = f'{{"messages_per_s": 1{"0" * 400}, "bytes_per_s": 1}}'
    texts = {
        'channel_topics': f'{{"channels": {{}}, "needed": [], "rates": {{"/a": {rate}}}}}',
        'switched_off': r'["\ud800"]',  # It cannot be printed.
    }
    for topic, text in texts.items():
        robot.node.create_publisher(String, topic, LATCHED_QOS).publish(String(data=text))
        robot.until(lambda topic=topic: f'{topic} cannot be read' in selector.output)
    assert robot.call(robot.clear_client).success


def test_random_messages_leave_the_node_as_it_was(selector, robot):
    rng = np.random.default_rng(0)
    for _ in range(1500):
        robot.state_publisher.publish(random_state(rng))
        robot.reward_publisher.publish(random_reward(rng))
        robot.executor.spin_once(timeout_sec=0)
    robot.until(lambda: robot.diagnostics[INPUT][0] == WARN)
    # A slow node must have taken all of them before it is cleared.
    robot.until(lambda: robot.diagnostics[INPUT][1].startswith('no state for'))
    assert robot.call(robot.clear_client).success
    robot.publish_episodes(normal_episodes(), NAMES)
    robot.wait_for_episodes(24)
    assert robot.call(robot.select_client).success
    assert 'Traceback' not in selector.output
