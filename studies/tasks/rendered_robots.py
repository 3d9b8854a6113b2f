# SPDX-License-Identifier: Apache-2.0

"""MuJoCo's robots with a camera that renders them.

reacher
    It moves with random torques. The reward falls with the distance to a target, which stays in its
    place for an episode, and with the squares of the torques, which vary more. The camera looks
    down; the target is a small red ball. The joint states hide its place, and the vector between it
    and the fingertip.
reacher_at_low_cost
    The same with a tenth of the cost of torques, so that the target matters more.
inverted_pendulum
    It is pushed at random, and the reward of each step is 1 until the pole leans too much. The
    joint states hide its angle and angular velocity; the camera shows the former. The same forces
    push the cart, so its state is informative about the pole.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from cmifs_ros.collect.encoders import Image
from cmifs_ros.core import Episode

from .cameras import ANOTHER, GIVEN, image_of
from .environments import ENVIRONMENTS, NUM_STEPS

#: Rows and columns of a picture.
SIZE = 64


class _Scene(NamedTuple):
    """How an environment is recorded.

    Attributes
    ----------
    environment : str
        One of `ENVIRONMENTS`.
    hidden : tuple of str
        Channels that the joint states lack, unless they are given.
    num_episodes : int
    options : mapping
        Gymnasium's options, such as the camera in place of the environment's own.

    """

    environment: str
    hidden: tuple[str, ...]
    num_episodes: int
    options: Mapping[str, object] = {}


_FROM_ABOVE = {
    'default_camera_config': {'distance': 0.7, 'elevation': -90.0, 'lookat': (0.0, 0.0, 0.0)}
}
_REACHER = _Scene(
    'reacher', ('target_x', 'target_y', 'to_target_x', 'to_target_y'), 100, _FROM_ABOVE
)
SCENES = {
    'reacher': _REACHER,
    'reacher_at_low_cost': _REACHER._replace(options=_FROM_ABOVE | {'reward_control_weight': 0.1}),
    'inverted_pendulum': _Scene('inverted_pendulum', ('angle', 'angular_velocity'), 150),
}


class _Robot:
    """An environment with a random policy, which begins anew whenever it ends."""

    def __init__(self, scene: _Scene, seed: np.random.SeedSequence):
        # Read by MuJoCo when it is imported: EGL needs no display.
        os.environ.setdefault('MUJOCO_GL', 'egl')
        self.env = ENVIRONMENTS[scene.environment].make(
            render_mode='rgb_array', width=SIZE, height=SIZE, **scene.options
        )
        self._rng = np.random.default_rng(seed)
        self.observation, _ = self.env.reset(seed=int(seed.generate_state(1)[0]))
        self._num_steps = 0

    def step(self) -> tuple[np.ndarray, float, bool]:
        """Act at random; return the action, the reward, and whether the episode has ended."""
        space = self.env.action_space
        action = self._rng.uniform(space.low, space.high)
        self.observation, reward, has_ended, *_ = self.env.step(action)
        self._num_steps += 1
        has_ended = has_ended or self._num_steps == NUM_STEPS
        if has_ended:
            self.observation, _ = self.env.reset()
            self._num_steps = 0
        return action, reward, has_ended


def rendered_robot(name: str, seed: int, kind: str) -> tuple[list[Episode], list[str]]:
    """Return the episodes of a recording and the names of their channels; see `cameras.KINDS`."""
    scene, camera = SCENES[name], Image()
    robot, other = (_Robot(scene, part) for part in np.random.SeedSequence(seed).spawn(2))
    seen = other if kind == ANOTHER else robot
    names = ENVIRONMENTS[scene.environment].channel_names
    kept = [i for i, channel in enumerate(names) if kind == GIVEN or channel not in scene.hidden]
    episodes = []
    for _ in range(scene.num_episodes):
        states, rewards, actions, has_ended = [], [], [], False
        while not has_ended:
            view = camera.encode(image_of(seen.env.render()))
            states.append([*robot.observation[kept], *view])
            other.step()
            action, reward, has_ended = robot.step()
            actions.append(action)
            rewards.append(reward)
        episodes.append(Episode(states, rewards, actions))
    robot.env.close()
    other.env.close()
    return episodes, [names[i] for i in kept] + [f'camera{suffix}' for suffix in camera.suffixes]
