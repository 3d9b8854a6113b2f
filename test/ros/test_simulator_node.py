# SPDX-License-Identifier: Apache-2.0

import os
import signal
from pathlib import Path

import numpy as np
import pytest
import yaml
from ament_index_python.packages import get_package_share_directory
from nav_msgs.msg import OccupancyGrid
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Int32
from visualization_msgs.msg import MarkerArray

from cmifs_ros.collect.episodes.pairing import EpisodeAssembler
from cmifs_ros.collect.episodes.reward_reader import RewardReader
from cmifs_ros.ros import conversions
from cmifs_ros.sim import channel_names, rollout
from cmifs_ros.sim.grid_world import WALLS
from cmifs_ros.sim.gymnasium_episodes import action_names, collect_episodes

QOS = QoSProfile(depth=1000)


class Listener:
    """Joins what the simulator publishes to episodes, as any node could."""

    def __init__(self, robot):
        self.assembler = EpisodeAssembler(1000)
        self.episodes = []
        self.reward_reader = RewardReader()
        self.state_names = []
        self.reward_names = set()
        self.action_names = set()
        robot.node.create_subscription(JointState, 'state', self._on_state, QOS)
        robot.node.create_subscription(JointState, 'reward', self._on_reward, QOS)
        robot.node.create_subscription(JointState, 'action', self._on_action, QOS)

    def _on_state(self, msg):
        names, values = conversions.named_values(msg)
        self.state_names.append(tuple(names))
        stamp = conversions.stamp_to_nanoseconds(msg.header.stamp)
        self.episodes += self.assembler.add_state(stamp, names, values)

    def _on_action(self, msg):
        names, values = conversions.named_values(msg)
        self.action_names.add(tuple(names))
        stamp = conversions.stamp_to_nanoseconds(msg.header.stamp)
        self.episodes += self.assembler.actions.add_action(stamp, names, values)

    def _on_reward(self, msg):
        self.reward_names.add(tuple(msg.name))
        stamp = conversions.stamp_to_nanoseconds(msg.header.stamp)
        sample = self.reward_reader.sample_of(*conversions.named_values(msg))
        self.episodes += self.assembler.add_reward(stamp, sample)


def act(robot, action):
    """Publish an action again and again: a first message may meet a node that knows no sender."""
    publisher = robot.node.create_publisher(Int32, 'command', 10)
    robot.node.create_timer(0.1, lambda: publisher.publish(Int32(data=action)))


@pytest.mark.parametrize('scenario', ['without_gravel', 'with_gravel'])
def test_it_publishes_the_episodes_of_its_seed_and_none_is_lost(start, robot, scenario):
    node = start('simulator_node', rate=500.0, seed=4, num_episodes=5, scenario=scenario)
    listener = Listener(robot)
    robot.until(lambda: len(listener.episodes) == 5)
    for episode, expected in zip(listener.episodes, rollout(scenario, 5, seed=4), strict=True):
        np.testing.assert_array_equal(episode.states, expected.states)
        np.testing.assert_array_equal(episode.rewards, expected.rewards)
    assert set(listener.state_names) == {channel_names(scenario)}
    assert listener.reward_names == {
        ('reward', 'action', 'terminated', 'truncated', 'episode', 'step')
    }
    assert not listener.assembler.dropped_messages
    robot.until(lambda: 'published 5 episodes' in node.output)


@pytest.fixture
def set_parameter(robot):
    """Set a parameter of the simulator and return the result."""
    client = AsyncParameterClient(robot.node, 'simulator')

    def set_(name, value):
        robot.until(client.services_are_ready)
        future = client.set_parameters([Parameter(name, value=value)])
        robot.until(future.done)
        return future.result().results[0]

    return set_


def test_every_parameter_takes_effect_while_it_runs(start, robot, set_parameter):
    start('simulator_node', rate=0.01, num_episodes=2)
    states = []
    robot.node.create_subscription(JointState, 'state', states.append, QOS)
    assert set_parameter('wait_for_subscribers', False).successful
    assert set_parameter('rate', 500.0).successful
    robot.until(lambda: len(states) == 40)  # nobody subscribes to reward
    assert set_parameter('num_episodes', 3).successful
    robot.until(lambda: len(states) == 60)


def test_the_scenario_changes_with_the_next_episode(start, robot, set_parameter):
    start('simulator_node', rate=200.0)
    listener = Listener(robot)
    robot.until(lambda: listener.episodes)
    refused = set_parameter('scenario', 'mars')
    assert not refused.successful
    assert "scenario is 'mars'; expected one of without_gravel, with_gravel" in refused.reason
    assert set_parameter('scenario', 'with_gravel').successful
    robot.until(lambda: listener.state_names[-1] == channel_names('with_gravel'))
    change = listener.state_names.index(channel_names('with_gravel'))
    assert change % 20 == 0
    assert set(listener.state_names[:change]) == {channel_names('without_gravel')}


def test_the_map_is_latched_and_the_robot_marked(start, robot):
    start('simulator_node', rate=100.0, scenario='with_gravel')
    Listener(robot)
    markers = []
    robot.node.create_subscription(MarkerArray, 'markers', markers.append, 10)
    robot.until(lambda: markers)
    assert markers[0].markers[1].text.startswith('battery ')
    grid = robot.latched('map', OccupancyGrid)
    cells = np.array(grid.data).reshape(grid.info.height, grid.info.width).T
    np.testing.assert_array_equal(cells == 100, WALLS)
    assert set(np.unique(cells)) <= {0, 50, 100}


def test_the_file_for_rviz_asks_for_what_the_simulator_publishes(start, robot):
    start('simulator_node')
    path = Path(get_package_share_directory('cmifs_ros'), 'config', 'simulator.rviz')
    manager = yaml.safe_load(path.read_text())['Visualization Manager']
    shown = {'rviz_default_plugins/Map': 'nav_msgs/msg/OccupancyGrid',
             'rviz_default_plugins/MarkerArray': 'visualization_msgs/msg/MarkerArray'}  # fmt: skip
    assert {display['Class'] for display in manager['Displays']} == shown.keys()
    for display in manager['Displays']:
        topic = display['Topic']
        robot.until(lambda name=topic['Value']: robot.node.get_publishers_info_by_topic(name))
        (publisher,) = robot.node.get_publishers_info_by_topic(topic['Value'])
        assert publisher.topic_type == shown[display['Class']]
        durability = publisher.qos_profile.durability.name.replace('_', ' ').title()
        assert topic['Durability Policy'] == durability
    assert manager['Global Options']['Fixed Frame'] == 'map'


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_signals_end_it_cleanly(start, robot, number):
    node = start('simulator_node', rate=1000.0)
    listener = Listener(robot)
    robot.until(lambda: listener.episodes)
    assert node.end(number) == 0
    assert 'Traceback' not in node.output


def test_it_takes_actions_from_a_topic_and_pays_for_them(start, robot):
    start('simulator_node', rate=100.0, seed=4, policy='topic')
    listener = Listener(robot)
    taken = []

    def on_reward(msg):
        taken.append(dict(zip(msg.name, msg.position, strict=True))['action'])

    robot.node.create_subscription(JointState, 'reward', on_reward, QOS)
    # Until an action comes its own policy acts, so that nobody waits for the other.
    robot.until(lambda: 3.0 in taken)
    act(robot, 2)
    act(robot, 7)  # It is no action, and changes nothing.
    robot.until(lambda: len(taken) > 60 and set(taken[-60:]) == {2.0})
    # Left of column 1 there is nothing: the robot stays, each state paired with its reward.
    robot.until(lambda: len(listener.episodes) >= 8)
    assert set(listener.episodes[-1].states[:, 0]) == {1.0}
    assert not listener.assembler.dropped_messages


def test_a_wrong_action_is_said_to_be_one(start, robot):
    node = start('simulator_node', policy='topic', wait_for_subscribers=False)
    act(robot, -1)
    robot.until(lambda: 'command is -1; expected 0 (up), 1 (down), 2 (left), 3' in node.output)
    assert 'Traceback' not in node.output


@pytest.mark.parametrize(
    ('env', 'names'),
    [
        ('Pendulum-v1', ('obs_0', 'obs_1', 'obs_2')),
        ('CartPole-v1', ('obs_0', 'obs_1', 'obs_2', 'obs_3')),
    ],
)
def test_an_environment_of_gymnasium_gives_its_episodes(start, robot, env, names):
    gymnasium = pytest.importorskip('gymnasium', reason='gymnasium is not here')
    start('simulator_node', env=env, rate=1000.0, seed=4, num_episodes=3)
    listener = Listener(robot)
    listener.assembler.actions.are_published = lambda: True
    robot.until(lambda: len(listener.episodes) == 3)
    expected = collect_episodes(gymnasium.make(env), 3, seed=4)
    for episode, other in zip(listener.episodes, expected, strict=True):
        np.testing.assert_array_equal(episode.states, other.states)
        np.testing.assert_array_equal(episode.rewards, other.rewards)
        np.testing.assert_array_equal(episode.actions, other.actions)
    assert set(listener.state_names) == {names}
    assert listener.action_names == {action_names(gymnasium.make(env))}
    (fields,) = listener.reward_names
    assert ('action' in fields) == (env == 'CartPole-v1')


def test_actions_of_a_discrete_environment_come_from_the_topic(start, robot):
    pytest.importorskip('gymnasium', reason='gymnasium is not here')
    node = start('simulator_node', env='CartPole-v1', rate=200.0, policy='topic')
    Listener(robot)
    taken = []
    robot.node.create_subscription(
        JointState, 'reward', lambda m: taken.append(m.position[list(m.name).index('action')]), QOS
    )
    act(robot, 1)
    robot.until(lambda: len(taken) > 40 and set(taken[-40:]) == {1.0})
    act(robot, 2)
    robot.until(lambda: 'command is 2; expected some of Discrete(2)' in node.output)
    assert set(taken) <= {0.0, 1.0}  # What is no action is not taken.
    assert 'Traceback' not in node.output


@pytest.mark.parametrize('env', ['Nothing-v9', 'no/such:thing'])
def test_an_unknown_environment_ends_it_with_a_sentence(start, env):
    pytest.importorskip('gymnasium', reason='gymnasium is not here')
    node = start('simulator_node', env=env)
    assert node.process.wait(20) == 2
    assert f"env is '{env}'; expected an environment such as Pendulum-v1" in node.output
    assert 'Traceback' not in node.output


@pytest.mark.parametrize('method', ['reset', 'step'])
def test_an_environment_that_fails_ends_it_with_a_sentence(start, tmp_path, monkeypatch, method):
    pytest.importorskip('gymnasium', reason='gymnasium is not here')
    (tmp_path / 'broken.py').write_text(f"""
from gymnasium import register
from gymnasium.envs.classic_control import PendulumEnv

class Broken(PendulumEnv):
    def {method}(self, *action, **options):
        raise OSError('the motor is gone')

register('Broken-v0', Broken)
""")
    monkeypatch.setenv('PYTHONPATH', str(tmp_path), prepend=os.pathsep)
    node = start('simulator_node', env='broken:Broken-v0', wait_for_subscribers=False)
    assert node.process.wait(20) == 1
    said = f"the {method} of the environment 'broken:Broken-v0' failed: OSError: the motor is gone"
    assert f'simulator: {said} ({tmp_path / "broken.py"}, line 7)\n' in node.output
    assert 'Traceback' not in node.output
