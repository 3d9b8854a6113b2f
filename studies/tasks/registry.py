# SPDX-License-Identifier: Apache-2.0

"""The tasks for comparing methods, by name."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np

from cmifs_ros.core import Episode
from cmifs_ros.sim import channel_names, rollout, rollout_chain
from cmifs_ros.sim.chain import CHANNEL_NAMES as CHAIN_NAMES
from cmifs_ros.sim.grid_world import MAX_EPISODE_STEPS, NUM_CHANNELS

from .distractors import distractor_names, with_distractors
from .environments import ENVIRONMENTS, MUJOCO, rollout_environment
from .fixed_gravel import FixedGravelWorld
from .level_worlds import LEVEL_WORLDS, OF_GYMNASIUM, rollout_level
from .lidar_world import CHANNEL_NAMES as LIDAR_NAMES
from .lidar_world import GROUPS as LIDAR_GROUPS
from .lidar_world import RELEVANT as LIDAR_RELEVANT
from .lidar_world import rollout_lidar_world
from .rewards import REWARD_WORLDS
from .synthetic import WORLDS, rollout_world


class Task(NamedTuple):
    """A task and its ground truth.

    Attributes
    ----------
    rollout : callable
        (number of episodes, seed) -> list of Episode; a smaller number gives the first ones of a
        larger number.
    channel_names : tuple of str
    relevant : tuple of int
        The sensors that should rank first, as indices of `sensor_names`.
    target : tuple of int
        The channels that the reward depends on directly; KDR is given them.
    groups : dict of str to tuple of str
        Sensors of several channels. Every other channel is a sensor of its own.

    """

    rollout: Callable[[int, int], list[Episode]]
    channel_names: tuple[str, ...]
    relevant: tuple[int, ...]
    target: tuple[int, ...]
    groups: dict[str, tuple[str, ...]] = {}  # noqa: RUF012

    @property
    def sensors(self) -> dict[str, tuple[int, ...]]:
        """Each sensor's channels, in the order of their first ones, as in the selectors."""
        group_of = {name: group for group, names in self.groups.items() for name in names}
        sensors: dict[str, tuple[int, ...]] = {}
        for index, name in enumerate(self.channel_names):
            sensor = group_of.get(name, name)
            sensors[sensor] = (*sensors.get(sensor, ()), index)
        return sensors

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """Names of the sensors."""
        return tuple(self.sensors)

    @property
    def optimum(self) -> int:
        """The least rank sum of the relevant sensors."""
        return sum(range(1, len(self.relevant) + 1))

    @property
    def chance(self) -> float:
        """The expected rank sum of a random order."""
        return len(self.relevant) * (len(self.sensors) + 1) / 2


def task_of(
    rollout_task: Callable[[int, int], list[Episode]],
    channel_names: tuple[str, ...],
    relevant: tuple[str, ...],
    groups: dict[str, tuple[str, ...]],
) -> Task:
    """Return a task from the names of the relevant channels; KDR is given the first."""
    task = Task(rollout_task, channel_names, (), (0,), groups)
    names = task.sensor_names
    target = task.sensors[relevant[0]] if relevant else (0,)
    return task._replace(relevant=tuple(map(names.index, relevant)), target=target)


def rollout_among_distractors(
    rollout_task: Callable[[int, int], list[Episode]], num_episodes: int, seed: int
) -> list[Episode]:
    """Return episodes of a task with the channels of `distractors` appended."""
    own, other, rest = (int(s) for s in np.random.SeedSequence(seed).generate_state(3))
    return with_distractors(
        rollout_task(num_episodes, own), rollout_task(num_episodes, other), rest
    )


def rollout_scaled(
    scenario: str,
    num_episodes: int,
    seed: int,
    *,
    num_steps: int = MAX_EPISODE_STEPS,
    num_channels: int = NUM_CHANNELS,
) -> list[Episode]:
    """Return episodes of the grid world in another size.

    A longer episode consists of several of 20 steps, as if the robot were carried back to the start
    each time. Channels beyond 14 are noise, rounded down like that of the world; with fewer, the
    last ones are left out.
    """
    rounds = -(-num_steps // MAX_EPISODE_STEPS)
    parts = rollout(scenario, num_episodes * rounds, seed)
    episodes = []
    for i in range(num_episodes):
        joined = parts[i * rounds : (i + 1) * rounds]
        states = np.concatenate([part.states for part in joined])[:num_steps, :num_channels]
        rewards = np.concatenate([part.rewards for part in joined])[:num_steps]
        shape = (num_steps, max(0, num_channels - NUM_CHANNELS))
        noise = np.floor(np.random.default_rng([seed, i]).normal(size=shape))
        episodes.append(Episode(np.hstack([states, noise]), rewards))
    return episodes


def what_is_missing(task: str) -> str | None:
    """Return how to install the missing package of a task, or None."""
    if task in (*ENVIRONMENTS, *OF_GYMNASIUM) and find_spec('gymnasium') is None:
        return 'not installed: python3 -m pip install gymnasium'
    if task in MUJOCO and find_spec('mujoco') is None:
        return "not installed: python3 -m pip install 'gymnasium[mujoco]'"
    if task == 'lidar_world' and find_spec('irsim') is None:
        return 'not installed: python3 -m pip install ir-sim'
    return None


#: Tasks for the evidence alone, not for the order of the sensors.
OF_EVIDENCE = (*REWARD_WORLDS, *LEVEL_WORLDS)
#: In the scenarios the reward depends directly on s(1), which the paper gives to its baseline.
TASKS = (
    {
        'without_gravel': Task(
            partial(rollout, 'without_gravel'), channel_names('without_gravel'), (0, 1), (0,)
        ),
        'with_gravel': Task(
            partial(rollout, 'with_gravel'), channel_names('with_gravel'), (0, 1, 2, 3), (0,)
        ),
        'with_fixed_gravel': Task(
            partial(rollout, 'with_gravel', make_world=FixedGravelWorld),
            channel_names('with_gravel'),
            (0, 1, 2, 3),
            (0,),
        ),
        'chain': Task(
            partial(rollout_among_distractors, rollout_chain),
            CHAIN_NAMES + distractor_names(CHAIN_NAMES),
            (0, 1, 2),
            (0,),
        ),
    }
    | {
        name: Task(
            partial(rollout_among_distractors, partial(rollout_environment, name)),
            environment.channel_names + distractor_names(environment.channel_names),
            environment.relevant,
            environment.target,
        )
        for name, environment in ENVIRONMENTS.items()
    }
    | {
        name: task_of(
            partial(rollout_world, world), world.channel_names, world.relevant, world.groups
        )
        for name, world in (WORLDS | REWARD_WORLDS).items()
    }
    | {
        name: task_of(partial(rollout_level, name), world.channel_names, world.relevant, {})
        for name, world in LEVEL_WORLDS.items()
    }
    | {'lidar_world': task_of(rollout_lidar_world, LIDAR_NAMES, LIDAR_RELEVANT, LIDAR_GROUPS)}
)
