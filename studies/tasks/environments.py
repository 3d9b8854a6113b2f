# SPDX-License-Identifier: Apache-2.0

"""Gymnasium environments as tasks, and what their returns depend on.

What is relevant follows from the equations of motion and the reward in Gymnasium's source: the
smallest set of channels that, with the policy here, makes the return independent of the others.

cart_pole
    The pole's acceleration depends on its angle, its angular velocity and the push. The reward of
    each step is 1 until the angle exceeds 12 degrees, or the cart leaves the track, which it does
    not within 30 steps; so position and velocity of the cart, which appear in neither, add nothing
    to the pole's. They do correlate with these, because the same pushes move both. Pushes left and
    right are equally likely.
pendulum
    A step costs angle^2 + 0.1 velocity^2 + 0.001 torque^2, and the acceleration depends on the
    sine of the angle: the future is that of angle and angular velocity, the angle being observed
    as cosine and sine. All three are relevant. The torque is uniform.
taxi
    The reward is -1 for each step, +20 for a passenger brought to his destination, and -10 for
    picking him up or setting him down in the wrong place. The distance left depends on the row and
    the column of the taxi, the place of the passenger and his destination: all four.
cliff_walking
    The reward of each step is -1, that of a fall from the cliff -100, after which the robot is back
    at the start. The distance left and that to the cliff depend on row and column: both.
frozen_lake
    The reward at the goal is 1; holes end the episode. How near they are depends on row and column:
    both. The ice is not slippery, because otherwise the goal is hardly reached within an episode.

In these three the policy takes the action that would be best without chance, but draws one of
all actions at random with probability 0.3. Where an environment ends an episode, it is shorter.

reacher
    The cost of a step is the distance of the fingertip from the target plus the squares of the
    torques, which are random. The distance is the length of the vector between them, which is
    observed, and which the angular velocities of both joints change. The angles and the target
    determine it, too.
inverted_pendulum
    The reward of each step is 1 until the pole leans more than 0.2. As with cart_pole only the
    pole's angle and angular velocity are relevant. The pushes are random.

Not taken: MountainCar and Acrobot, whose return does not vary within 30 steps of a random policy.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cmifs_ros.core import Episode

NUM_STEPS = 30
RANDOM_ACTION_PROBABILITY = 0.3
#: Discount factor for the best action.
_GAMMA = 0.95
_SWEEPS = 200

Policy = Callable[[object, np.random.Generator], object]


class Environment(NamedTuple):
    """One of Gymnasium's environments as a task.

    Attributes
    ----------
    make : callable
        Returns the environment, given Gymnasium's options such as `render_mode`.
    channel_names : tuple of str
    relevant : tuple of int
    target : tuple of int
        The channels that the reward depends on directly.
    observe : callable
        From an observation to its channels.
    make_policy : callable
        From an environment to its policy: observation, generator -> action.

    """

    make: Callable[..., object]
    channel_names: tuple[str, ...]
    relevant: tuple[int, ...]
    target: tuple[int, ...]
    observe: Callable[[object], np.ndarray]
    make_policy: Callable[[object], Policy]


def rollout_environment(name: str, num_episodes: int, seed: int) -> list[Episode]:
    """Return episodes of at most 30 steps; the same seed gives the same episodes.

    Parameters
    ----------
    name : str
        One of `ENVIRONMENTS`.
    num_episodes : int
    seed : int
        Seed of the environment and, independently, of the policy.

    """
    environment = ENVIRONMENTS[name]
    world = environment.make()
    world_seed, policy_seed = np.random.SeedSequence(seed).generate_state(2)
    rng = np.random.default_rng(policy_seed)
    policy = environment.make_policy(world)
    world.reset(seed=int(world_seed))
    episodes = []
    for _ in range(num_episodes):
        states, rewards = [], []
        observation, _ = world.reset()
        terminated = False
        while not terminated and len(rewards) < NUM_STEPS:
            states.append(environment.observe(observation))
            observation, reward, terminated, *_ = world.step(policy(observation, rng))
            rewards.append(reward)
        episodes.append(Episode(states, rewards))
    return episodes


def _make_cart_pole(**options):
    from gymnasium.envs.classic_control.cartpole import CartPoleEnv

    return CartPoleEnv(**options)


def _make_pendulum(**options):
    from gymnasium.envs.classic_control.pendulum import PendulumEnv

    return PendulumEnv(**options)


def _make_taxi(**options):
    from gymnasium.envs.toy_text.taxi import TaxiEnv

    return TaxiEnv(**options)


def _make_cliff_walking(**options):
    from gymnasium.envs.toy_text.cliffwalking import CliffWalkingEnv

    return CliffWalkingEnv(**options)


def _make_frozen_lake(**options):
    from gymnasium.envs.toy_text.frozen_lake import FrozenLakeEnv

    return FrozenLakeEnv(is_slippery=False, **options)


def _make_reacher(**options):
    from gymnasium.envs.mujoco.reacher_v5 import ReacherEnv

    return ReacherEnv(**options)


def _make_inverted_pendulum(**options):
    from gymnasium.envs.mujoco.inverted_pendulum_v5 import InvertedPendulumEnv

    return InvertedPendulumEnv(**options)


def _act_at_random(world) -> Policy:
    low, high = world.action_space.low, world.action_space.high
    return lambda observation, rng: rng.uniform(low, high)


def _push_at_random(world) -> Policy:
    return lambda observation, rng: int(rng.integers(2))


def _turn_at_random(world) -> Policy:
    return lambda observation, rng: rng.uniform(-2, 2, size=1)


def _mostly_best(world) -> Policy:
    """Return a policy that mostly takes the best action, from value iteration on world.P."""
    num_actions = len(world.P[0])
    values = np.zeros(len(world.P))
    for _ in range(_SWEEPS):
        actions = np.array(
            [
                [
                    sum(
                        probability * (reward + _GAMMA * values[after] * (not terminated))
                        for probability, after, reward, terminated in world.P[state][action]
                    )
                    for action in range(num_actions)
                ]
                for state in range(len(values))
            ]
        )
        converged = np.allclose(actions.max(axis=1), values)
        values = actions.max(axis=1)
        if converged:
            break
    best = actions.argmax(axis=1)

    def policy(observation, rng):
        if rng.random() < RANDOM_ACTION_PROBABILITY:
            return int(rng.integers(num_actions))
        return int(best[observation])

    return policy


#: Numbers from 0 as the environments code them, in mixed radix.
_TAXI_SHAPE = (5, 5, 5, 4)
_CLIFF_SHAPE = (4, 12)
_LAKE_SHAPE = (4, 4)

ENVIRONMENTS = {
    'cart_pole': Environment(
        _make_cart_pole,
        ('position', 'velocity', 'angle', 'angular_velocity'),
        (2, 3),
        (2,),
        np.asarray,
        _push_at_random,
    ),
    'pendulum': Environment(
        _make_pendulum,
        ('cosine', 'sine', 'angular_velocity'),
        (0, 1, 2),
        (0, 1, 2),
        np.asarray,
        _turn_at_random,
    ),
    'taxi': Environment(
        _make_taxi,
        ('row', 'column', 'passenger', 'destination'),
        (0, 1, 2, 3),
        (0, 1, 2, 3),
        lambda number: np.array(np.unravel_index(number, _TAXI_SHAPE)),
        _mostly_best,
    ),
    'cliff_walking': Environment(
        _make_cliff_walking,
        ('row', 'column'),
        (0, 1),
        (0, 1),
        lambda number: np.array(np.unravel_index(number, _CLIFF_SHAPE)),
        _mostly_best,
    ),
    'frozen_lake': Environment(
        _make_frozen_lake,
        ('row', 'column'),
        (0, 1),
        (0, 1),
        lambda number: np.array(np.unravel_index(number, _LAKE_SHAPE)),
        _mostly_best,
    ),
    'reacher': Environment(
        _make_reacher,
        (
            *('cosine_1', 'cosine_2', 'sine_1', 'sine_2', 'target_x', 'target_y'),
            *('angular_velocity_1', 'angular_velocity_2', 'to_target_x', 'to_target_y'),
        ),
        (8, 9),
        (8, 9),
        np.asarray,
        _act_at_random,
    ),
    'inverted_pendulum': Environment(
        _make_inverted_pendulum,
        ('position', 'angle', 'velocity', 'angular_velocity'),
        (1, 3),
        (1,),
        np.asarray,
        _act_at_random,
    ),
}
#: The environments that need MuJoCo.
MUJOCO = ('reacher', 'inverted_pendulum')
