# SPDX-License-Identifier: Apache-2.0

"""Tasks in which one can act: the worlds of `studies.tasks`, a step at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.random import Generator

from cmifs_ros.core import Episode
from cmifs_ros.sim import GridWorld, sample_action
from cmifs_ros.sim.grid_world import MAX_EPISODE_STEPS, MOVES
from studies.tasks.control import CONTROL_WORLDS, RunningWorld
from studies.tasks.distractors import NUM_NOISE, NUM_WALKS
from studies.tasks.environments import ENVIRONMENTS, NUM_STEPS
from studies.tasks.registry import TASKS

#: (channels, generator) -> action.
Behaviour = Callable[[np.ndarray, Generator], Any]


class LearningTask(NamedTuple):
    """A task to act in.

    Attributes
    ----------
    make : callable
        From a seed to a world: `reset()` returns the channels, `step(action)` the channels then,
        the reward and whether the episode terminates.
    channel_names : tuple of str
    needed : tuple of int
        The channels that a controller needs.
    actions : sequence
        What a learner chooses from; of numbers that stand for nothing else, each is a value of its
        own in `Episode.actions` (one-hot).
    is_categorical : bool
        Whether the actions are such numbers.
    num_steps : int
        An episode has at most so many steps.
    behave : Behaviour
        The policy whose episodes one learns from.

    """

    make: Callable[[int], Any]
    channel_names: tuple[str, ...]
    needed: tuple[int, ...]
    actions: Sequence[float]
    is_categorical: bool
    num_steps: int
    behave: Behaviour


class Recording(NamedTuple):
    """An episode of T steps: states (T + 1, v), T actions, rewards (T,), whether it terminated.

    The last state is the one reached. Where an episode was only cut short it goes on for all that a
    learner knows.
    """

    states: np.ndarray
    actions: list
    rewards: np.ndarray
    terminated: bool


class Transitions(NamedTuple):
    """Steps of many episodes: state, action by its index, reward, state reached, terminated there.

    The arrays have the shapes (n, v), (n,), (n,), (n, v) and (n,).
    """

    states: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    next_states: np.ndarray
    terminated: np.ndarray


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
        self._is_vector = bool(self._world.action_space.shape)
        self._world.reset(seed=own)
        self._other.reset(seed=other)
        self._rng = np.random.default_rng(rest)

    def reset(self) -> np.ndarray:
        self._other_state = self._observe(self._other.reset()[0])
        self._is_other_still = False
        self._walks = self._rng.normal(size=NUM_WALKS)
        return self._with_distractors(self._world.reset()[0])

    def step(self, action: float) -> tuple[np.ndarray, float, bool]:
        observation, reward, terminated, *_ = self._act(self._world, action)
        if not self._is_other_still:
            random_action = self._actions[self._rng.integers(len(self._actions))]
            reached, _, self._is_other_still, *_ = self._act(self._other, random_action)
            if not self._is_other_still:
                self._other_state = self._observe(reached)
        self._walks = self._walks + self._rng.normal(size=NUM_WALKS)
        return self._with_distractors(observation), float(reward), bool(terminated)

    def _act(self, world, action: float):
        return world.step(np.array([action]) if self._is_vector else action)

    def _with_distractors(self, observation) -> np.ndarray:
        noise = self._rng.normal(size=NUM_NOISE)
        state = [self._observe(observation), noise, self._walks, self._other_state]
        return np.concatenate(state).astype(float)


def _any_of(actions: Sequence) -> Behaviour:
    return lambda channels, rng: actions[rng.integers(len(actions))]


def _control_task(name: str, actions: Sequence[float]) -> LearningTask:
    world = CONTROL_WORLDS[name]
    return LearningTask(
        partial(RunningWorld, world),
        world.channel_names,
        tuple(map(world.channel_names.index, world.needed_for['decision'])),
        actions,
        is_categorical=False,
        num_steps=world.num_steps,
        behave=_any_of(actions),
    )


def _grid_task(scenario: str) -> LearningTask:
    return LearningTask(
        partial(_Grid, scenario),
        TASKS[scenario].channel_names,
        TASKS[scenario].relevant,
        tuple(MOVES),
        is_categorical=True,
        num_steps=MAX_EPISODE_STEPS,
        behave=sample_action,
    )


def _gymnasium_task(name: str, actions: Sequence[float], is_categorical: bool) -> LearningTask:
    return LearningTask(
        partial(_AmongDistractors, name, actions),
        TASKS[name].channel_names,
        TASKS[name].relevant,
        actions,
        is_categorical,
        NUM_STEPS,
        _any_of(actions),
    )


LEARNING_TASKS = {
    'match': _control_task('match', (0, 1)),
    'secret_key': _control_task('secret_key', (-9.0, -6.0, -3.0, 0.0, 3.0, 6.0, 9.0)),
    'stakes': _control_task('stakes', (0, 1)),
    'high_stakes': _control_task('high_stakes', (0, 1)),
    'mixed': _control_task('mixed', (0, 1)),
    'autoregressive': _control_task('autoregressive', (0, 1)),
    'toy': _control_task('toy', (-1.0, -0.5, 0.0, 0.5, 1.0)),
    'without_gravel': _grid_task('without_gravel'),
    'with_gravel': _grid_task('with_gravel'),
    'cart_pole': _gymnasium_task('cart_pole', (0, 1), is_categorical=True),
    'pendulum': _gymnasium_task('pendulum', (-2.0, 0.0, 2.0), is_categorical=False),
}


def record(
    name: str,
    num_episodes: int,
    seed: int,
    behave: Behaviour | None = None,
    frozen: Mapping[int, float] | None = None,
) -> list[Recording]:
    """Act in a task and return what happened, the same for the same seed.

    Parameters
    ----------
    name : str
        One of `LEARNING_TASKS`.
    num_episodes, seed : int
    behave : Behaviour, optional
        Who acts; by default the task's own behaviour.
    frozen : mapping of int to float, optional
        Channels that show this value to who acts, whatever they are.

    """
    task = LEARNING_TASKS[name]
    behave, frozen = behave or task.behave, frozen or {}
    world_seed, policy_seed = (int(s) for s in np.random.SeedSequence(seed).generate_state(2))
    world, rng = task.make(world_seed), np.random.default_rng(policy_seed)
    recordings = []
    for _ in range(num_episodes):
        states, actions, rewards, terminated = [world.reset()], [], [], False
        while not terminated and len(rewards) < task.num_steps:
            seen = states[-1].copy()
            seen[list(frozen)] = list(frozen.values())
            actions.append(behave(seen, rng))
            reached, reward, terminated = world.step(actions[-1])
            states.append(reached)
            rewards.append(reward)
        recordings.append(Recording(np.array(states), actions, np.array(rewards), terminated))
    return recordings


def episodes_of(name: str, recordings: Sequence[Recording]) -> list[Episode]:
    """Return what a selector is given of recordings."""
    task = LEARNING_TASKS[name]

    def values(action):
        return [action == a for a in task.actions] if task.is_categorical else [action]

    return [Episode(r.states[:-1], r.rewards, [*map(values, r.actions)]) for r in recordings]


def transitions_of(name: str, recordings: Sequence[Recording]) -> Transitions:
    """Return what a learner is given of recordings whose actions are all among the task's."""
    index = {action: i for i, action in enumerate(LEARNING_TASKS[name].actions)}
    return Transitions(
        np.concatenate([r.states[:-1] for r in recordings]),
        np.array([index[action] for r in recordings for action in r.actions]),
        np.concatenate([r.rewards for r in recordings]),
        np.concatenate([r.states[1:] for r in recordings]),
        np.concatenate([r.terminated & _is_last(len(r.actions)) for r in recordings]),
    )


def _is_last(num_steps: int) -> np.ndarray:
    return np.arange(1, num_steps + 1) == num_steps


def returns_of(
    name: str, act: Callable[[np.ndarray], np.ndarray], num_episodes: int, seed: int
) -> np.ndarray:
    """Return the undiscounted return of a policy in each of many fresh episodes.

    Parameters
    ----------
    name : str
        One of `LEARNING_TASKS`.
    act : callable
        From states, shape (n, v), to the indices of as many actions; the episodes go on side by
        side.
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
            states[i], reward, terminated = worlds[i].step(task.actions[action])
            returns[i] += reward
            if not terminated:
                going_on.append(i)
        running = np.array(going_on, dtype=int)
    return returns
