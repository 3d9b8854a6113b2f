# SPDX-License-Identifier: Apache-2.0

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from ament_index_python.packages import get_package_share_directory
from processes import is_running
from rcl_interfaces.srv import DescribeParameters, ListParameters
from sensor_msgs.msg import JointState
from slow_episodes import SLOW_NAMES, slow_episodes
from std_msgs.msg import String

from cmifs_ros.collect.episodes.builder import RewardSample
from cmifs_ros.core import ConditionalMISelector, Episode, KDRSelector
from cmifs_ros.core.looks import level_of_look
from cmifs_ros.ros import sampler_node, selector_parameters, simulator_node
from cmifs_ros.ros.diagnostics import OK, WARN
from cmifs_ros.sim import channel_names, rollout

NAMES = ('a', 'b', 'c')


def small_episodes(count=24, steps=3, seed=0):
    """Return episodes whose reward is channel c, with some noise."""
    rng = np.random.default_rng(seed)
    episodes = []
    for _ in range(count):
        states = rng.normal(size=(steps, 3))
        episodes.append(Episode(states, states[:, 2] + 0.1 * rng.normal(size=steps)))
    return episodes


@pytest.fixture
def selector(start, robot):
    node = start('selector_node', selection_period=0.0)
    robot.wait_for_selector()
    return node


def test_the_service_gives_what_the_selector_finds_on_the_same_episodes(start, robot):
    start('selector_node', selection_period=0.0, num_features=2, random_state=3)
    robot.wait_for_selector()
    names = channel_names('with_gravel')[:6]
    episodes = [Episode(e.states[:, :6], e.rewards) for e in rollout('with_gravel', 25, seed=1)]
    robot.publish_episodes(episodes, names)
    robot.wait_for_episodes(25)
    reply = robot.call(robot.select_client)
    assert reply.success, reply.message
    found = json.loads(reply.message)

    level = level_of_look(0.05, renewals=np.log2(25), num_first=20)
    own = ConditionalMISelector(2, random_state=3, significance=level).fit(episodes, names=names)
    assert found['indices'] == own.get_support(indices=True).tolist()
    assert found['names'] == own.get_feature_names_out().tolist()
    assert found['scores'] == pytest.approx(own.scores_.tolist(), abs=1e-12)
    assert (found['episodes'], found['steps']) == (25, 500)
    assert found['seconds'] > 0
    assert '\n' not in reply.message

    # Latched: somebody who comes late still gets them.
    assert robot.latched('selected_indices').data.tolist() == found['indices']
    scores = robot.latched('scores', JointState)
    assert list(scores.name) == found['ranking']
    np.testing.assert_allclose(scores.position, found['scores'])
    assert robot.latched('selection', String).data == reply.message
    assert found['number'] == 1
    assert json.loads(robot.call(robot.select_client).message)['number'] == 2


def test_when_the_task_has_changed_the_episodes_from_before_are_forgotten(selector, robot):
    before = [Episode(e.states[:, ::-1], e.rewards) for e in small_episodes(40, seed=1)]
    robot.publish_episodes([*before, *small_episodes(40, seed=2)], NAMES)
    robot.wait_for_episodes(80)
    found = json.loads(robot.call(robot.select_client).message)
    assert found['names'] == ['c']
    assert 30 <= found['outdated'] == 80 - found['episodes'] <= 50
    robot.wait_for_episodes(found['episodes'])
    text = f'the oldest {found["outdated"]} episodes no longer fit the newest {found["episodes"]}'
    robot.until(lambda: text in selector.output)
    assert robot.set_parameter('forget_outdated', False).successful


def test_the_method_kdr_needs_its_target_and_gives_what_its_selector_finds(selector, robot):
    refusal = robot.set_parameter('method', 'kdr')
    assert not refusal.successful
    assert "kdr_target is ''; method kdr needs the channels" in refusal.reason
    assert not robot.set_parameter('kdr_target', 'x,').successful
    assert not robot.set_parameter('method', 'mi').successful
    for name, value in (('kdr_target', 'x'), ('method', 'kdr'), ('num_features', 2)):
        assert robot.set_parameter(name, value).successful
    names = channel_names('without_gravel')
    episodes = rollout('without_gravel', 25, seed=1)
    robot.publish_episodes(episodes, names)
    robot.wait_for_episodes(25)
    found = json.loads(robot.call(robot.select_client).message)
    own = KDRSelector(2, target='x').fit(episodes, names=names)
    assert found['names'] == own.get_feature_names_out().tolist()
    assert found['scores'] == pytest.approx(own.scores_.tolist())

    refusal = robot.set_parameter('kdr_target', 'lidar')
    assert not refusal.successful
    assert "kdr_target names channel 'lidar'; expected some of x, y" in refusal.reason


def test_selected_state_carries_the_selected_channels_and_the_number_of_the_selection(
    selector, robot
):
    robot.set_parameter('num_features', 1)
    robot.publish_state(5, NAMES, [1.0, 2.0, 3.0])
    robot.until(lambda: robot.selected)
    assert list(robot.selected[0].name) == list(NAMES)  # all of them until there is a selection
    assert robot.selected[0].position.tolist() == [1, 2, 3]
    assert robot.selected[0].header.frame_id == ''

    robot.publish_episodes(small_episodes(), NAMES, begin=1_000)
    robot.wait_for_episodes(24)
    assert json.loads(robot.call(robot.select_client).message)['names'] == ['c']
    announced = json.loads(robot.latched('selection', String).data)
    assert (announced['names'], announced['indices']) == (['c'], [2])
    for names, values in (
        (NAMES, [1.0, 2.0, 3.0]),
        (('c', 'b', 'a'), [3.0, 2.0, 1.0]),  # another order
        (('new', 'c'), [9.0, 3.0]),  # other channels, but the selected one is there
        (NAMES, [np.nan, 2.0, 3.0]),  # a broken sensor that does not matter
    ):
        robot.selected.clear()
        robot.publish_state(7_123_456_789, names, values)
        robot.until(lambda: robot.selected)
        (msg,) = robot.selected
        assert list(msg.name) == ['c']
        assert msg.position.tolist() == [3.0]
        assert (msg.header.stamp.sec, msg.header.stamp.nanosec) == (7, 123_456_789)
        assert msg.header.frame_id == str(announced['number'])

    assert robot.set_parameter('layout', 'full').successful
    robot.selected.clear()
    robot.publish_state(8, ('c', 'b', 'a'), [3.0, 2.0, 1.0])
    robot.until(lambda: robot.selected)
    assert list(robot.selected[0].name) == list(NAMES)
    np.testing.assert_equal(robot.selected[0].position.tolist(), [np.nan, np.nan, 3.0])


def test_the_selected_channels_keep_the_order_of_the_state(selector, robot):
    rng = np.random.default_rng(0)
    states = rng.normal(size=(48, 12, 3))

    def select(weights, part, begin):
        episodes = [Episode(s, s @ weights) for s in states[part]]
        robot.publish_episodes(episodes, NAMES, begin=begin)
        robot.wait_for_episodes(24)
        found = json.loads(robot.call(robot.select_client).message)
        robot.selected.clear()
        robot.publish_state(begin - 1, NAMES, [1.0, 2.0, 3.0])
        robot.until(lambda: robot.selected)
        assert robot.selected[0].header.frame_id == str(found['number'])
        return found['names'], list(robot.selected[0].name)

    robot.set_parameter('num_features', 2)
    robot.set_parameter('max_episodes', 24)
    assert select([1.0, 0.0, 3.0], slice(24), 10**9) == (['c', 'a'], ['a', 'c'])
    robot.call(robot.clear_client)
    assert select([3.0, 0.0, 1.0], slice(24, 48), 10**12)[1] == ['a', 'c']
    robot.call(robot.clear_client)
    assert select([0.0, 3.0, 1.0], slice(24, 48), 2 * 10**12)[1] == ['b', 'c']


def test_nothing_passes_before_the_selection_if_so_wished(start, robot):
    start('selector_node', selection_period=0.0, pass_through_until_selected=False)
    robot.wait_for_selector()
    robot.publish_episodes(small_episodes(), NAMES)
    robot.wait_for_episodes(24)
    assert not robot.selected
    assert robot.call(robot.select_client).success
    robot.publish_state(1_000_000_000, NAMES, [1.0, 2.0, 3.0])
    robot.until(lambda: robot.selected)


def test_too_few_episodes_are_refused_with_the_numbers_and_enough_wait_for_a_call(selector, robot):
    robot.publish_episodes(small_episodes(3), NAMES)
    robot.wait_for_episodes(3)
    reply = robot.call(robot.select_client)
    assert not reply.success
    said = 'no selection yet: 3 episodes of at least 20'
    robot.until(lambda: robot.diagnostics['selector: selection'][1] == said)
    assert robot.set_parameter('min_episodes', 3).successful
    said = 'call select_features'
    robot.until(lambda: said in robot.diagnostics['selector: selection'][1])
    answer = json.loads(reply.message)
    assert (answer['episodes'], answer['min_episodes']) == (3, 20)
    assert '3 episodes so far; a selection needs at least 20' in answer['error']


def test_state_keeps_flowing_and_nothing_is_lost_while_a_selection_runs(selector, robot):
    robot.publish_slow_episodes()
    robot.set_parameter('max_episodes', 1000)
    robot.set_parameter('num_features', 2)
    robot.selected.clear()
    future = robot.select_client.call_async(robot.select_client.srv_type.Request())
    more = slow_episodes(200, seed=1)
    stamp, sent, relayed = 10**12, 0, 0
    while not future.done() and sent < len(more):
        stamp = robot.publish_episodes([more[sent]], SLOW_NAMES, begin=stamp)
        sent += 1
        robot.until(lambda n=sent: len(robot.selected) == 20 * n or future.done())
        relayed = relayed if future.done() else sent
    robot.until(future.done, 300)
    assert future.result().success
    assert relayed > 3
    robot.wait_for_episodes(40 + sent)
    robot.until(lambda: len(robot.selected) == 20 * sent)
    assert robot.value('transitions') == 20 * (40 + sent)
    assert not [key for key in robot.diagnostics['selector: input'][2] if 'dropped' in key]


def test_many_callers_share_few_computations(selector, robot):
    robot.publish_episodes(small_episodes(), NAMES)
    robot.wait_for_episodes(24)
    request = robot.select_client.srv_type.Request()
    futures = [robot.select_client.call_async(request) for _ in range(20)]
    robot.until(lambda: all(f.done() for f in futures), 300)
    assert all(f.result().success for f in futures)
    assert len({f.result().message for f in futures}) <= 2


CALLER = """
import sys
import rclpy
from std_srvs.srv import Trigger

rclpy.init()
node = rclpy.create_node(f'caller_{sys.argv[1]}')
client = node.create_client(Trigger, 'select_features')
assert client.wait_for_service(60)
print('ready', flush=True)
sys.stdin.readline()
for _ in range(4):  # The middleware may lose a reply.
    future = client.call_async(Trigger.Request())
    rclpy.spin_until_future_complete(node, future, timeout_sec=20)
    if future.done():
        break
print('answered' if future.done() else 'not answered', flush=True)
"""


def test_each_of_many_processes_that_call_at_once_is_answered(start, domain):
    # As many as find each other on one machine; each receives the replies to all of them.
    selector = start('selector_node', selection_period=0.0)
    callers = [
        subprocess.Popen(
            [sys.executable, '-c', CALLER, str(number)],
            env=os.environ | {'ROS_DOMAIN_ID': str(domain)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for number in range(25)
    ]
    try:
        assert all(caller.stdout.readline() == 'ready\n' for caller in callers)
        for caller in callers:
            caller.stdin.write('\n')
            caller.stdin.flush()
        said = [caller.stdout.readline() for caller in callers]
        assert said == ['answered\n'] * len(callers), selector.output
    finally:
        for caller in callers:
            caller.kill()
            caller.communicate()


@pytest.mark.parametrize(
    ('names', 'values', 'cause'),
    [
        (NAMES, [1.0, 2.0], 'wrong_length'),
        (NAMES, [1.0, np.nan, 2.0], 'not_finite'),
        (('a', 'b', 'renamed'), [1.0, 2.0, 3.0], 'wrong_channels'),
        ((*NAMES, 'unknown'), [1.0, 2.0, 3.0, 4.0], 'wrong_channels'),
    ],
)
def test_a_bad_state_is_counted_warned_of_and_disturbs_nothing_else(
    selector, robot, names, values, cause
):
    stamp = robot.publish_episodes(small_episodes(1), NAMES)
    robot.publish_state(stamp, names, values)
    robot.publish_reward(stamp, RewardSample(1.0, False, False, 1, 0))
    robot.publish_episodes(small_episodes(2, seed=1), NAMES, begin=stamp + 10)
    robot.wait_for_episodes(3)
    assert robot.value(f'messages dropped: {cause}') == 1
    assert robot.value('messages dropped: reward_without_state') == 1
    robot.until(lambda: f'1 {cause}' in selector.output)
    assert 'Traceback' not in selector.output


def test_duplicates_orphans_and_gaps_are_counted(selector, robot):
    robot.publish_state(10, NAMES, [1.0, 2.0, 3.0])
    robot.publish_state(10, NAMES, [1.0, 2.0, 3.0])
    robot.publish_reward(10, RewardSample(1.0, False, False, 0, 0))
    robot.publish_reward(20, RewardSample(1.0, False, False, 0, 1))  # has no state
    robot.publish_state(30, NAMES, [1.0, 2.0, 3.0])  # has no reward
    robot.publish_state(40, NAMES, [1.0, 2.0, 3.0])
    robot.publish_reward(40, RewardSample(1.0, False, True, 0, 3))
    for step in (0, 2):
        robot.publish_state(50 + step, NAMES, [1.0, 2.0, 3.0])
        robot.publish_reward(50 + step, RewardSample(1.0, False, step == 2, 1, step))
    robot.publish_fields(60, nothing=1.0)
    robot.publish_episodes(small_episodes(2), NAMES, begin=100)
    robot.wait_for_episodes(2)
    for cause in (
        'messages dropped: duplicate_stamp',
        'messages dropped: reward_without_state',
        'messages dropped: state_without_reward',
        'messages dropped: malformed_reward',
        'episodes dropped: lost_state',
        'episodes dropped: step_gap',
    ):
        assert robot.value(cause) == 1, cause
    robot.until(lambda: robot.diagnostics['selector: input'][0] == b'\x01')


def test_rewards_alone_are_enough_and_what_they_lack_is_said_once(start, robot):
    node = start('selector_node', selection_period=0.0, max_episode_steps=4)
    robot.wait_for_selector()
    for number in range(8):
        robot.publish_state(number + 1, NAMES, [number, 0.0, 0.0])
        robot.publish_fields(number + 1, reward=1.0)
    robot.wait_for_episodes(2)
    assert node.output.count('an episode is closed at max_episode_steps=4') == 1
    assert node.output.count('have no `step`') == 1


def test_bad_parameters_are_refused_with_a_reason(selector, robot):
    for name, value, reason in (
        ('gamma', 1.5, 'out of range'),
        ('gamma', 'high', 'type'),
        ('criterion', 'x', "criterion is 'x'; expected one of held_out, plug_in"),
        ('direction', 'up', "direction is 'up'; expected one of forward, backward"),
        ('max_episodes', 1, 'out of range'),
        ('num_features', -1, 'out of range'),
        ('selection_period', 1e-9, 'selection_period is 1e-09; expected 0 or at least 0.1 s'),
        ('sensor_groups', 'pose', "sensor_groups has 'pose'; expected"),
        ('control_msgs', True, 'read-only'),
    ):
        result = robot.set_parameter(name, value)
        assert not result.successful
        assert reason in result.reason
    assert selector.process.poll() is None


def test_accepted_parameters_take_effect_while_running(selector, robot):
    robot.publish_episodes(small_episodes(24), NAMES)
    robot.wait_for_episodes(24)
    assert robot.set_parameter('max_episodes', 22).successful
    robot.wait_for_episodes(22)
    assert robot.set_parameter('sensor_groups', 'pair=a,c').successful
    assert robot.set_parameter('num_features', 1).successful
    assert json.loads(robot.call(robot.select_client).message)['names'] == ['a', 'c']
    assert robot.set_parameter('half_life', 1e-12).successful
    error = json.loads(robot.call(robot.select_client).message)['error']
    assert error.startswith('a half-life of 1e-12 s discounts a reward to 0 within a step of')
    assert robot.set_parameter('half_life', 1e9).successful
    assert json.loads(robot.call(robot.select_client).message)['names'] == ['a', 'c']
    refusal = robot.set_parameter('num_features', 9)
    assert not refusal.successful
    expected = 'num_features is 9; expected at most 2, the number of sensors, or 0'
    assert refusal.reason == expected
    refusal = robot.set_parameter('sensor_groups', 'pair=a,d')
    assert "sensor_groups names channel 'd'; expected some of a, b, c" in refusal.reason


@pytest.mark.parametrize('order', [1, -1])
def test_bounds_can_be_loaded_in_any_order_and_enough_is_kept_for_a_selection(
    selector, robot, order
):
    for name, value in [('min_episodes', 12), ('max_episodes', 11)][::order]:
        assert robot.set_parameter(name, value).successful
    robot.publish_episodes(small_episodes(14), NAMES)
    robot.wait_for_episodes(12)
    assert robot.call(robot.select_client).success
    for name, value in [('min_episodes', 150), ('max_episodes', 200)][::order]:
        assert robot.set_parameter(name, value).successful


def test_memory_is_bounded_and_an_episode_that_would_exceed_it_is_closed(start, robot):
    start('selector_node', selection_period=0.0, max_buffer_mb=1, max_episode_steps=1_000_000)
    robot.wait_for_selector()
    names = [f'c{i}' for i in range(1000)]
    (endless,) = small_episodes(1, steps=400)
    endless = Episode(np.tile(endless.states[:, :1], 1000), endless.rewards)
    robot.publish_episodes([endless], names)
    robot.until(lambda: robot.value('transitions') == 400)
    assert robot.value('episodes cut') == 3  # at 124 steps of 1001 values each
    # Each of these leaves no room for the one before: the last 28 steps remain.
    assert robot.value('episodes') == 1
    assert robot.value('buffer bytes') == 28 * 1001 * 8
    assert robot.value('buffer bytes allowed') == 10**6


def test_a_state_with_too_many_channels_is_dropped_unread(selector, robot):
    robot.publish_state(1, [str(i) for i in range(5000)], np.zeros(5000))
    robot.publish_state(2, NAMES, np.zeros(5000))
    robot.publish_fields(3, **{str(i): 0.0 for i in range(5000)})
    robot.publish_state(4, ['x' * 300, 'b'], np.zeros(2))
    robot.publish_episodes(small_episodes(1), NAMES, begin=10)
    robot.wait_for_episodes(1)
    for cause, count in (('unusable_state', 2), ('malformed_reward', 1), ('wrong_channels', 1)):
        assert robot.value(f'messages dropped: {cause}') == count


def test_a_bad_parameter_at_the_start_is_one_sentence(start):
    node = start('selector_node', criterion='nonsense')
    assert node.process.wait(20) == 2
    assert node.output == "criterion is 'nonsense'; expected one of held_out, plug_in\n"


@pytest.mark.parametrize(
    'arguments', [('--params-file', '/nonexistent.yaml'), ('-r', '__node:=1bad')]
)
def test_unreadable_ros_arguments_are_named_without_a_traceback(start, arguments):
    node = start('selector_node', *arguments)
    assert node.process.wait(20) == 2
    assert 'Traceback' not in node.output
    assert arguments[1] in node.output


def test_selections_come_by_themselves_when_there_are_new_episodes(start, robot):
    start('selector_node', selection_period=0.5)
    robot.wait_for_selector()
    robot.publish_episodes(small_episodes(), NAMES)
    assert 2 in robot.latched('selected_indices').data
    status = 'selector: selection'
    robot.until(lambda: robot.diagnostics[status][2].get('cause') == 'timer')


def test_the_diagnostics_tell_the_cause_and_the_cost_of_a_selection(selector, robot):
    rng = np.random.default_rng(0)
    names = [f'a sensor with a name longer than 32 letters, {i}' for i in range(12)]
    states = rng.normal(size=(24, 3, 12))
    robot.publish_episodes([Episode(s, s[:, 7]) for s in states], names)
    robot.wait_for_episodes(24)
    reply = json.loads(robot.call(robot.select_client).message)
    assert reply['names'] == [names[7]]
    status = 'selector: selection'
    robot.until(lambda: 'cause' in robot.diagnostics[status][2])
    values = robot.diagnostics[status][2]
    assert values['cause'] == 'service call'
    assert float(values['seconds taken']) == pytest.approx(reply['seconds'], abs=0.01)
    assert values['number'] == '1'


def test_where_nothing_is_confirmed_the_diagnostics_tell_how_far_it_is(selector, robot):
    rng = np.random.default_rng(0)
    states = rng.normal(size=(24, 3, 3))
    robot.publish_episodes([Episode(s, rng.normal(size=3)) for s in states], NAMES)
    robot.wait_for_episodes(24)
    reply = robot.call(robot.select_client)
    found = json.loads(reply.message)
    assert found['names'] == []
    assert reply.success
    undecided = 'undecided' in [sensor['status'] for sensor in found['sensors']]
    assert found['number'] == 0
    what = 'nothing confirmed yet; 24 episodes' if undecided else 'no evidence that any'
    status = 'selector: selection'
    robot.until(lambda: robot.diagnostics[status][1].startswith(what))
    assert robot.diagnostics[status][0] == (OK if undecided else WARN)


def test_what_limits_the_data_is_logged_once_of_each_kind(selector, robot):
    stamp = 1
    for count, far in ((24, 1e3), (48, 2e3)):
        first, *others = small_episodes(seed=count)
        first = Episode(first.states, np.array([far, 0.0, 0.0]))
        stamp = robot.publish_episodes([first, *others], NAMES, stamp)
        robot.wait_for_episodes(count)
        (warning,) = json.loads(robot.call(robot.select_client).message)['warnings']
        assert f'{far:g} in episode' in warning
    assert selector.output.count('of the variance of the rewards') == 1


def test_of_rewards_by_which_no_return_differs_the_cause_is_told(selector, robot):
    states = np.random.default_rng(0).normal(size=(24, 3, 3))
    robot.publish_episodes([Episode(s, np.full(3, -1.0)) for s in states], NAMES)
    robot.wait_for_episodes(24)
    what = 'every reward is -1, in all 24 episodes'
    reply = robot.call(robot.select_client)
    assert not reply.success
    assert json.loads(reply.message)['error'].startswith(what)
    status = 'selector: selection'
    robot.until(lambda: robot.diagnostics[status][1].startswith(what))
    assert robot.diagnostics[status][0] == WARN


def test_cleared_episodes_are_gone_and_other_channels_welcome(selector, robot):
    robot.publish_episodes(small_episodes(2), NAMES)
    robot.wait_for_episodes(2)
    reply = robot.call(robot.clear_client)
    assert (reply.success, json.loads(reply.message)) == (True, {'episodes': 2})
    robot.wait_for_episodes(0)
    robot.publish_episodes(small_episodes(1), ('d', 'e', 'f'), begin=10**12)
    robot.wait_for_episodes(1)


def test_after_a_clear_other_channels_pass_until_they_are_selected_from(selector, robot):
    robot.set_parameter('num_features', 1)
    robot.publish_episodes(small_episodes(), NAMES)
    robot.wait_for_episodes(24)
    assert robot.call(robot.select_client).success
    robot.call(robot.clear_client)
    robot.wait_for_episodes(0)
    robot.publish_episodes(small_episodes(1), ('d', 'e', 'f'), begin=10**12)
    robot.wait_for_episodes(1)
    robot.until(lambda: robot.selected and list(robot.selected[-1].name) == ['d', 'e', 'f'])
    assert 'the selection is dropped: c is not among the new channels d, e, f' in selector.output


def test_a_selection_of_cleared_episodes_is_answered_but_not_used(selector, robot):
    robot.publish_slow_episodes()
    future = robot.select_client.call_async(robot.select_client.srv_type.Request())
    status = 'selector: selection'
    robot.until(lambda: robot.diagnostics[status][2]['worker'] == 'computing')
    robot.call(robot.clear_client)
    robot.until(future.done, 300)
    assert not future.result().success
    answer = json.loads(future.result().message)
    assert answer['episodes'] == 40
    assert 'its episodes were cleared meanwhile' in answer['error']
    robot.until(lambda: 'its episodes were cleared meanwhile' in selector.output)
    assert 'names' not in robot.diagnostics[status][2]


def test_states_without_a_selected_channel_turn_the_diagnostics_to_warn(selector, robot):
    robot.set_parameter('num_features', 1)
    robot.publish_episodes(small_episodes(), NAMES)
    robot.wait_for_episodes(24)
    assert robot.call(robot.select_client).success
    robot.publish_state(10**12, ('a', 'b'), [1.0, 2.0])
    status = 'selector: selection'
    robot.until(lambda: robot.diagnostics[status][0] == b'\x01')
    assert robot.value('states without a selected channel', status) == 1


def test_a_refusal_is_no_error_of_the_node(selector, robot):
    assert not robot.call(robot.select_client).success
    status = 'selector: selection'
    robot.diagnostics.clear()
    robot.until(lambda: status in robot.diagnostics)
    assert robot.diagnostics[status][0] == b'\x00'
    assert 'WARN' not in selector.output


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_during_start_up_ends_the_node_cleanly(start, robot, number):
    node = start('selector_node')
    # rclpy is being loaded: Python is up and the node is not.
    maps = Path(f'/proc/{node.process.pid}/maps')
    robot.until(lambda: '_rclpy_pybind11' in maps.read_text())
    assert (node.end(number), node.output) == (0, '')


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    ('moment', 'cores'), [('idle', 1), ('spawning', 1), ('selecting', 1), ('selecting', 2)]
)
def test_signals_end_the_node_and_its_workers_cleanly(selector, robot, number, moment, cores):
    robot.set_parameter('worker_threads', cores)
    if moment != 'idle':
        robot.publish_slow_episodes()
        robot.select_client.call_async(robot.select_client.srv_type.Request())
        # The tracker, the worker, and those that it shares the work with.
        robot.until(lambda: len(selector.children()) >= 2)
        if moment == 'selecting':
            status = 'selector: selection'
            robot.until(lambda: robot.diagnostics[status][2]['worker'] == 'computing')
    children = selector.children()
    # Ctrl-C reaches the whole group of the terminal.
    assert selector.end(number, group=number == signal.SIGINT) == 0
    assert 'Traceback' not in selector.output
    robot.until(lambda: not any(map(is_running, children)), 2)


@pytest.mark.parametrize('cores', [1, 2])
def test_no_worker_outlives_a_killed_node(selector, robot, cores):
    robot.set_parameter('worker_threads', cores)
    robot.publish_slow_episodes()
    robot.select_client.call_async(robot.select_client.srv_type.Request())
    status = 'selector: selection'
    robot.until(lambda: robot.diagnostics[status][2]['worker'] == 'computing')
    children = selector.children()
    assert children
    os.kill(selector.process.pid, signal.SIGKILL)
    selector.process.wait()
    robot.until(lambda: not any(map(is_running, children)), 5)


def test_names_follow_the_namespace(start, robot):
    start('selector_node', '-r', '__ns:=/robot1')
    expected = {
        '/robot1/state', '/robot1/reward', '/robot1/selected_state',
        '/robot1/selected_indices', '/robot1/scores', '/robot1/selection', '/diagnostics',
    }  # fmt: skip
    services = {
        '/robot1/select_features', '/robot1/selector/clear_episodes', '/robot1/selector/cancel',
    }  # fmt: skip

    def names(pairs):
        return {name for name, _ in pairs}

    robot.until(lambda: services <= names(robot.node.get_service_names_and_types()))
    robot.until(lambda: expected <= names(robot.node.get_topic_names_and_types()))
    statuses = {'robot1/selector: input', 'robot1/selector: selection'}
    robot.until(lambda: robot.diagnostics)
    assert statuses == set(robot.diagnostics)


@pytest.mark.parametrize(('executable', 'node'), [
    ('sampler_node', 'sampler'), ('selector_node', 'selector'), ('simulator_node', 'simulator'),
])  # fmt: skip
def test_the_parameter_file_names_every_parameter_with_its_default(
    start, robot, executable, node, tmp_path
):
    needed = []
    if node == 'sampler':
        (tmp_path / 'robot.yaml').write_text('step: {rate: 1}\nchannels: {a: /a.data}\nreward: a\n')
        needed = ['-p', f'robot_file:={tmp_path / "robot.yaml"}']
    start(executable, *needed)
    lister = robot.node.create_client(ListParameters, f'{node}/list_parameters')
    describer = robot.node.create_client(DescribeParameters, f'{node}/describe_parameters')
    robot.until(lister.service_is_ready)
    robot.until(describer.service_is_ready)
    foreign = ('use_sim_time', 'start_type_description_service', 'qos_overrides')
    names = [
        name
        for name in robot.ask(lister, ListParameters.Request()).result.names
        if not name.startswith(foreign)
    ]
    path = Path(get_package_share_directory('cmifs_ros'), 'config', 'cmifs_ros.yaml')
    written = yaml.safe_load(path.read_text())[f'/**/{node}']['ros__parameters']
    specs = {
        'sampler': sampler_node.PARAMETERS,
        'selector': selector_parameters.PARAMETERS,
        'simulator': simulator_node.PARAMETERS,
    }[node]
    assert written == {spec.name: spec.default for spec in specs}
    assert list(written) == [spec.name for spec in specs]
    assert set(written) == set(names)
    described = robot.ask(describer, DescribeParameters.Request(names=names)).descriptors
    assert all(d.description for d in described)
    again = ('-r', f'__node:={node}', '-r', '__ns:=/again')
    start(executable, '--params-file', str(path), *needed, *again)
    again = robot.node.create_client(ListParameters, f'/again/{node}/list_parameters')
    robot.until(again.service_is_ready)
