# SPDX-License-Identifier: Apache-2.0

"""A robot with a lidar, simulated by ir-sim: it drives noisily to a goal among obstacles.

The reward is 1 at the goal, which is always at the same place, and -1 at a collision; both end the
episode. Start and obstacles are drawn anew each time, and the robot does not avoid the obstacles. x
and y show how far the goal is, the lidar shows whether something is in the way: these are relevant.
The battery, the temperature, the signal of the radio, the accelerometer and the lidar of another
robot, whose episode is another one, are not. The package ir-sim is optional.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from cmifs_ros.core import Episode

NUM_RAYS = 12
NUM_OBSTACLES = 4
MAX_STEPS = 60
STEP_SECONDS = 0.2
SPEED = 1.0
SIZE = 10.0
GOAL = (9.0, 5.0)
#: Distance at which the goal is reached, and least distance of obstacles from start and goal.
GOAL_RADIUS = 0.5
CLEARANCE = 1.2
RANGE_MAX = 4.0

_RAYS = tuple(f'lidar_{i}' for i in range(NUM_RAYS))
_OTHER_RAYS = tuple(f'other_lidar_{i}' for i in range(NUM_RAYS))
CHANNEL_NAMES = (
    *('x', 'y', *_RAYS, 'battery', 'temperature', 'radio', 'accelerometer'),
    *_OTHER_RAYS,
)
GROUPS = {'lidar': _RAYS, 'other_lidar': _OTHER_RAYS}
RELEVANT = ('x', 'y', 'lidar')

_OBSTACLES = '\n'.join(
    f'  - {{shape: {{name: circle, radius: 0.4}}, state: [{i}, -5, 0]}}'
    for i in range(NUM_OBSTACLES)
)
#: In ir-sim's format. Whatever stands somewhere is put elsewhere before each episode.
WORLD = f"""
world:
  {{height: 30, width: 30, offset: [-10, -10], step_time: %(step_seconds)s, collision_mode: stop}}
robot:
  - kinematics: {{name: omni}}
    shape: {{name: circle, radius: 0.2}}
    state: [1, 5, 0]
    goal: [{GOAL[0]}, {GOAL[1]}, 0]
    vel_max: [3, 3]
    sensors:
      - {{name: lidar2d, range_min: 0, range_max: {RANGE_MAX}, angle_range: 6.2831853,
         number: %(num_rays)s, noise: False}}
obstacle:
{_OBSTACLES}
"""


class LidarWorld:
    """The world without irrelevant sensors: episode by episode, step by step.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws start, obstacles and driving noise.
    step_seconds : float, optional
    num_rays : int, optional

    """

    def __init__(
        self,
        rng: np.random.Generator,
        step_seconds: float = STEP_SECONDS,
        num_rays: int = NUM_RAYS,
    ):
        import irsim

        self._rng = rng
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / 'world.yaml'
            path.write_text(WORLD % {'step_seconds': step_seconds, 'num_rays': num_rays})
            self._env = irsim.make(str(path), headless=True, log_level='ERROR')
        self._robot = self._env.robot

    def reset(self) -> np.ndarray:
        """Begin an episode; return x, y and the rays in m, shape (14,)."""
        start = self._rng.uniform((0.5, 1.0), (1.5, 9.0))
        for obstacle in self._env.obstacle_list:
            place = start
            while min(np.linalg.norm(place - start), np.linalg.norm(place - GOAL)) < CLEARANCE:
                place = self._rng.uniform((1.0, 1.0), (9.0, 9.0))
            obstacle.set_state([*place, 0.0], init=True)
        self._robot.set_state([*start, 0.0], init=True)
        self._env.reset()
        return self._observe()

    def step(self) -> tuple[np.ndarray, float, bool]:
        """Drive a step; return the observation, the reward, and whether the episode has ended."""
        return self.move(self.steer())

    def steer(self) -> np.ndarray:
        """Return the velocity in m/s, shape (2,), at which the robot would drive now."""
        way = np.array(GOAL) - self._robot.state[:2, 0]
        return SPEED * way / np.linalg.norm(way) + self._rng.normal(0, 0.7, size=2)

    def move(self, velocity: np.ndarray) -> tuple[np.ndarray, float, bool]:
        """Drive a step with a velocity; return the same as `step`."""
        self._env.step(velocity[:, None])
        observation = self._observe()
        if self._robot.collision:
            return observation, -1.0, True
        has_arrived = np.linalg.norm(observation[:2] - GOAL) < GOAL_RADIUS
        return observation, float(has_arrived), bool(has_arrived)

    def _observe(self) -> np.ndarray:
        return np.array([*self._robot.state[:2, 0], *self._robot.get_lidar_scan()['ranges']])


def rollout_lidar_world(num_episodes: int, seed: int) -> list[Episode]:
    """Return episodes of at most 60 steps, the same ones bit for bit for the same seed.

    At the end of a shorter episode the other robot stands still.
    """
    own, other, rest = np.random.SeedSequence(seed).spawn(3)
    driven = _drive(np.random.default_rng(own), num_episodes)
    others = _drive(np.random.default_rng(other), num_episodes)
    rng = np.random.default_rng(rest)
    episodes = []
    for (observed, rewards), (elsewhere, _) in zip(driven, others, strict=True):
        steps = np.arange(len(rewards))
        battery = rng.uniform(20, 100) - 0.1 * steps
        temperature = rng.uniform(20, 40) + np.cumsum(rng.normal(0, 0.1, size=len(steps)))
        radio = -60 + 5 * rng.normal(size=len(steps))
        accelerometer = rng.normal(size=len(steps))
        other_rays = elsewhere[np.minimum(steps, len(elsewhere) - 1), 2:]
        states = np.column_stack([observed, battery, temperature, radio, accelerometer, other_rays])
        episodes.append(Episode(states, rewards))
    return episodes


def _drive(rng: np.random.Generator, num_episodes: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the observations (T, 14) and rewards (T,) of each episode."""
    world = LidarWorld(rng)
    driven = []
    for _ in range(num_episodes):
        observed, rewards = [], []
        observation, has_ended = world.reset(), False
        while not has_ended and len(rewards) < MAX_STEPS:
            observed.append(observation)
            observation, reward, has_ended = world.step()
            rewards.append(reward)
        driven.append((np.array(observed), np.array(rewards)))
    return driven
