# SPDX-License-Identifier: Apache-2.0

"""Tasks in which one can act: the worlds of `studies.tasks`, a step at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from cmifs_ros.core import Episode
from cmifs_ros.sim import GridWorld, sample_action
from cmifs_ros.sim.grid_world import MAX_EPISODE_STEPS, MOVES
from studies.tasks.distractors import NUM_NOISE, NUM_WALKS
from studies.tasks.environments import ENVIRONMENTS, NUM_STEPS
from studies.tasks.registry import TASKS

#: Torques among which the pendulum's learner chooses; the behaviour draws one of them.
TORQUES = (-2.0, 0.0, 2.0)

#: (state, generator) -> action.
Behaviour = Callable[[np.ndarray, np.random.Generator], int]


class Transitions(NamedTuple):
    """Steps of many episodes: state, action, reward, the state reached, whether it ends there.

    The arrays have the shapes (n, v), (n,), (n,), (n, v) and (n,). Where an episode was only cut
    short it goes on for all that the learner knows.
    """

    states: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    next_states: np.ndarray
    terminated: np.ndarray


class LearningTask(NamedTuple):
    """A task to act in.

    Attributes
    ----------
    make : callable
        From a seed to a world: `reset()` returns the state, `step(action)` the state reached, the
        reward and whether it ends there.
    num_actions, num_steps : int
        Actions count from 0; an episode has at most so many steps.
    behave : Behaviour
        The policy whose episodes one learns from.

    """

    make: Callable
    num_actions: int
    num_steps: int
    behave: Behaviour


class _Grid:
    def __init__(self, scenario: str, seed: int):
        self._world = GridWorld(scenario, seed=seed)

    def reset(self) -> np.ndarray:
        return self._world.reset()[0]

    def step(self, action: int) -> tuple[np.ndarray, float, bool]:
        return self._world.step(action)[:3]


class _AmongDistractors:
    """One of Gymnasium's environments with the channels of `studies.tasks.distractors` appended."""

    def __init__(self, name: str, actions: Sequence, seed: int):
        own, other, rest = (int(s) for s in np.random.SeedSequence(seed).generate_state(3))
        self._observe, self._actions = ENVIRONMENTS[name].observe, actions
        self._world, self._other = ENVIRONMENTS[name].make(), ENVIRONMENTS[name].make()
        self._world.reset(seed=own)
        self._other.reset(seed=other)
        self._rng = np.random.default_rng(rest)

    def reset(self) -> np.ndarray:
        self._other_state = self._observe(self._other.reset()[0])
        self._is_other_still = False
        self._walks = self._rng.normal(size=NUM_WALKS)
        return self._with_distractors(self._world.reset()[0])

    def step(self, action: int) -> tuple[np.ndarray, float, bool]:
        observation, reward, terminated, *_ = self._world.step(self._actions[action])
        if not self._is_other_still:
            random_action = self._actions[self._rng.integers(len(self._actions))]
            reached, _, self._is_other_still, *_ = self._other.step(random_action)
            if not self._is_other_still:
                self._other_state = self._observe(reached)
        self._walks = self._walks + self._rng.normal(size=NUM_WALKS)
        return self._with_distractors(observation), float(reward), bool(terminated)

    def _with_distractors(self, observation) -> np.ndarray:
        noise = self._rng.normal(size=NUM_NOISE)
        state = [self._observe(observation), noise, self._walks, self._other_state]
        return np.concatenate(state).astype(float)


def _grid_task(scenario: str) -> LearningTask:
    return LearningTask(
        lambda seed: _Grid(scenario, seed), len(MOVES), MAX_EPISODE_STEPS, sample_action
    )


def _gymnasium_task(name: str, actions: Sequence) -> LearningTask:
    return LearningTask(
        lambda seed: _AmongDistractors(name, actions, seed),
        len(actions),
        NUM_STEPS,
        lambda state, rng: int(rng.integers(len(actions))),
    )


#: The channels, their names and what is relevant are those of `studies.tasks.registry.TASKS`.
LEARNING_TASKS = {
    'without_gravel': _grid_task('without_gravel'),
    'with_gravel': _grid_task('with_gravel'),
    'cart_pole': _gymnasium_task('cart_pole', (0, 1)),
    'pendulum': _gymnasium_task('pendulum', [np.array([torque]) for torque in TORQUES]),
}
assert LEARNING_TASKS.keys() <= TASKS.keys()


def collect(
    name: str, num_episodes: int, seed: int, behave: Behaviour | None = None
) -> tuple[list[Episode], Transitions]:
    """Act, by default as the task's behaviour; return the steps as episodes and as transitions."""
    task = LEARNING_TASKS[name]
    behave = behave or task.behave
    world_seed, policy_seed = (int(s) for s in np.random.SeedSequence(seed).generate_state(2))
    world, rng = task.make(world_seed), np.random.default_rng(policy_seed)
    episodes, steps = [], []
    for _ in range(num_episodes):
        state, terminated, begin = world.reset(), False, len(steps)
        while not terminated and len(steps) - begin < task.num_steps:
            action = behave(state, rng)
            reached, reward, terminated = world.step(action)
            steps.append((state, action, reward, reached, terminated))
            state = reached
        states, _, rewards, *_ = zip(*steps[begin:], strict=True)
        episodes.append(Episode(states, rewards))
    return episodes, Transitions(*map(np.array, zip(*steps, strict=True)))


def returns_of(
    name: str, act: Callable[[np.ndarray], np.ndarray], num_episodes: int, seed: int
) -> np.ndarray:
    """Return the undiscounted return of a policy in each of many fresh episodes.

    Parameters
    ----------
    name : str
        One of `LEARNING_TASKS`.
    act : callable
        From states, shape (n, v), to as many actions; the episodes go on side by side.
    num_episodes, seed : int

    """
    task = LEARNING_TASKS[name]
    worlds = [task.make(int(s)) for s in np.random.SeedSequence(seed).generate_state(num_episodes)]
    states = np.array([world.reset() for world in worlds])
    returns, running = np.zeros(num_episodes), np.arange(num_episodes)
    for _ in range(task.num_steps):
        if not len(running):
            break
        going_on = []
        for i, action in zip(running, act(states[running]), strict=True):
            states[i], reward, terminated = worlds[i].step(int(action))
            returns[i] += reward
            if not terminated:
                going_on.append(i)
        running = np.array(going_on, dtype=int)
    return returns
