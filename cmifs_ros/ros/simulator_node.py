# SPDX-License-Identifier: Apache-2.0

"""The simulator node: a simulated robot that publishes its state and reward.

The robot lives in the grid world or in any Gymnasium environment.
"""

from __future__ import annotations

import secrets
import sys

import numpy as np
from nav_msgs.msg import OccupancyGrid
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, Int32
from visualization_msgs.msg import MarkerArray

from cmifs_ros.collect.episodes.builder import RewardSample
from cmifs_ros.core.words import counted
from cmifs_ros.sim import SCENARIOS, GridWorld, sample_action
from cmifs_ros.sim.grid_world import MOVES, WALLS
from cmifs_ros.sim.gymnasium_world import GymnasiumWorld, WorldError

from . import conversions
from .parameters import Spec, declare
from .qos import LATCHED_QOS, STREAM_QOS
from .run_node import run_node

MILLISECOND = 1_000_000  # in nanoseconds

PARAMETERS = (
    Spec('env', '', 'A Gymnasium environment instead of the grid world, such as Pendulum-v1; its '
         'own policy is random. Requires gymnasium.', read_only=True),
    Spec('scenario', 'without_gravel', 'The grid world; a change takes effect at the next episode.',
         choices=SCENARIOS),
    Spec('rate', 20.0, 'Steps per second.', (0.01, 10_000)),
    Spec('seed', -1, 'Seed of the world and the policy; -1 draws one. A change starts a new '
         'sequence of episodes at the next episode.', (-1, 2**31 - 1)),
    Spec('policy', 'own', 'Who chooses the actions: its own policy, or whoever publishes `command` '
         '(std_msgs/Int32: 0 up, 1 down, 2 left, 3 right, or from the Discrete space of `env`). '
         'The newest action is repeated; its own policy acts until the first one arrives.',
         choices=('own', 'topic')),
    Spec('num_episodes', 0, 'Episodes to publish; 0: no limit.', (0, 2**31 - 1)),
    Spec('wait_for_subscribers', True,
         'Start only when both state and reward have a subscriber, so that no step is lost.'),
)  # fmt: skip


class SimulatorNode(Node):
    """Publish one step of the world at each tick, state and reward with the same stamp."""

    def __init__(self):
        super().__init__('simulator')
        self._settings = declare(self, PARAMETERS, lambda values: None, self._apply_parameters)
        self._state_publisher = self.create_publisher(JointState, 'state', STREAM_QOS)
        self._reward_publisher = self.create_publisher(JointState, 'reward', STREAM_QOS)
        self._map_publisher = self.create_publisher(OccupancyGrid, 'map', LATCHED_QOS)
        self._marker_publisher = self.create_publisher(MarkerArray, 'markers', 10)
        self.create_subscription(Int32, 'command', self._on_command, 10)
        # No actions for the grid world: the paper's criterion does not use them.
        self._action_publisher = None
        if self._settings['env']:
            self._action_publisher = self.create_publisher(JointState, 'action', STREAM_QOS)
        self._action: int | None = None  # the newest one received
        self._acting: Header | None = None  # of the state whose action is pending
        self._world: GridWorld | GymnasiumWorld | None = None
        self._state: np.ndarray | None = None  # None between episodes
        self._episode = -1
        self._step = 0
        self._last_stamp = -MILLISECOND
        self._has_begun = False
        self._said_of_limit = 0
        self._make_world()
        self._running = self._world  # A new world starts with the next episode.
        if self._settings['wait_for_subscribers']:
            self.get_logger().info('waiting for subscribers of state and reward')
        self._timer = self.create_timer(1 / self._settings['rate'], self._tick)

    def _apply_parameters(self, changed: dict) -> None:
        if {'scenario', 'seed'} & changed.keys():
            self._world = None
        if 'rate' in changed:
            self._timer.timer_period_ns = int(1e9 / changed['rate'])
            self._timer.reset()

    def _tick(self) -> None:
        try:
            self._go_on()
        except WorldError as error:
            raise SystemExit(f'simulator: {error}') from error

    def _go_on(self) -> None:
        self._has_begun = self._has_begun or self._may_begin()
        if not self._has_begun:
            return
        if self._acting is not None:  # The action had one period to arrive.
            self._act(self._acting, self._choose_action())
        if self._state is None and not self._begin_episode():
            return
        header = self._header()
        self._state_publisher.publish(
            conversions.named_values_to_msg(header, self._names, self._state)
        )
        self._publish_markers(header)
        if self._settings['policy'] == 'topic':
            self._acting = header
        else:
            self._act(header, self._choose_action())

    def _on_command(self, msg: Int32) -> None:
        world = self._running
        is_grid = isinstance(world, GridWorld)
        if msg.data in MOVES if is_grid else world.allows(msg.data):
            self._action = msg.data
        else:
            actions = '0 (up), 1 (down), 2 (left), 3 (right)' if is_grid else world.actions
            self.get_logger().warning(
                f'command is {msg.data}; expected {actions}', throttle_duration_sec=10.0
            )

    def _choose_action(self):
        if self._action is not None and self._settings['policy'] == 'topic':
            return self._action
        if isinstance(self._running, GridWorld):
            return sample_action(self._state, self._policy_rng)
        return self._running.sample_action()

    def _act(self, header: Header, action) -> None:
        self._acting = None
        if self._action_publisher is not None and self._running.action_names:
            values = self._running.values_of(action)
            self._action_publisher.publish(
                conversions.named_values_to_msg(header, self._running.action_names, values)
            )
        self._state, reward, terminated, truncated, _ = self._running.step(action)
        sample = RewardSample(reward, terminated, truncated, self._episode, self._step)
        number = int(action) if np.ndim(action) == 0 else None
        self._reward_publisher.publish(conversions.reward_sample_to_msg(header, sample, number))
        self._step += 1
        if terminated or truncated:
            self._state = None

    def _may_begin(self) -> bool:
        return not self._settings['wait_for_subscribers'] or bool(
            self._state_publisher.get_subscription_count()
            and self._reward_publisher.get_subscription_count()
        )

    def _begin_episode(self) -> bool:
        limit = self._settings['num_episodes']
        if limit and self._episode + 1 >= limit:
            if self._said_of_limit != limit:
                self._said_of_limit = limit
                self.get_logger().info(f'published {counted(self._episode + 1, "episode")}')
            return False
        if self._world is None:
            self._make_world()
        self._running = self._world
        self._names = self._world.channel_names
        self._state, _ = self._world.reset()
        self._episode += 1
        self._step = 0
        if isinstance(self._world, GridWorld):
            self._map_publisher.publish(
                conversions.grid_to_msg(self._header(), WALLS, self._world.gravel)
            )
        return True

    def _make_world(self) -> None:
        seed, name = self._settings['seed'], self._settings['env']
        if seed < 0:
            seed = secrets.randbelow(2**31)
        if name:
            self._world = GymnasiumWorld(name, seed)
        else:
            world_seed, policy_seed = np.random.SeedSequence(seed).spawn(2)
            self._world = GridWorld(self._settings['scenario'], seed=world_seed)
            self._policy_rng = np.random.default_rng(policy_seed)
        self.get_logger().info(
            f'{name or self._world.scenario}, seed {seed}, {self._settings["rate"]:g} steps/s'
        )

    def _header(self) -> Header:
        # Two steps must not share a stamp, even if a simulated clock ticks coarsely.
        now = self.get_clock().now().nanoseconds
        is_same_tick = 0 <= self._last_stamp - now < MILLISECOND
        self._last_stamp = self._last_stamp + 1 if is_same_tick else now
        return Header(stamp=conversions.stamp_from_nanoseconds(self._last_stamp), frame_id='map')

    def _publish_markers(self, header: Header) -> None:
        world = self._running
        if isinstance(world, GridWorld) and self._marker_publisher.get_subscription_count():
            self._marker_publisher.publish(
                conversions.robot_to_msg(header, world.column, world.row, world.battery)
            )


if __name__ == '__main__':
    sys.exit(run_node('simulator_node', 'SimulatorNode'))
