# SPDX-License-Identifier: Apache-2.0

"""A Gymnasium environment as a simulated robot: named channels and a random policy.

Gymnasium is optional: python3 -m pip install gymnasium.
"""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from cmifs_ros.core.channel_names import problem_of_names

from .gymnasium_episodes import action_names, channel_names, flatten, named_action


class WorldError(Exception):
    """An environment raised an exception; the message says which, how and where."""


class GymnasiumWorld:
    """An environment with vector states and the interface of `GridWorld`.

    With its own random policy it gives the same episodes as `collect_episodes`.

    Parameters
    ----------
    name : str
        A name for `gymnasium.make`, such as 'Pendulum-v1'.
    seed : int

    Attributes
    ----------
    channel_names : tuple of str
    action_names : tuple of str
        As of `gymnasium_episodes.action_names`.
    actions : str
        Description of the action space.

    Raises
    ------
    ValueError
        If Gymnasium or the environment is not available, or its channels are not usable.

    """

    def __init__(self, name: str, seed: int):
        try:
            import gymnasium
        except ImportError:
            raise ValueError(
                f'env is {name!r}, but Gymnasium is not installed: '
                'python3 -m pip install gymnasium (gymnasium[mujoco] for MuJoCo)'
            ) from None
        try:
            self._env = gymnasium.make(name)
        except Exception as error:  # Raised by the registry or by the environment.
            what = ' '.join(str(error).split())[:300]
            raise ValueError(
                f'env is {name!r}; expected an environment such as Pendulum-v1: {what}'
            ) from error
        self.channel_names = channel_names(self._env)
        problem = problem_of_names(self.channel_names)
        if problem:
            raise ValueError(f'env is {name!r}, whose states have {problem}')
        self.action_names = action_names(self._env)
        problem = problem_of_names(self.action_names)
        if problem:
            raise ValueError(f'env is {name!r}, whose actions have {problem}')
        self.actions = f'some of {self._env.action_space}'
        self._is_discrete = isinstance(self._env.action_space, gymnasium.spaces.Discrete)
        self._name = name
        self._seed: int | None = seed
        self._env.action_space.seed(seed)

    def reset(self) -> tuple[np.ndarray, dict]:
        """Start an episode; return its first state, shape (v,), and the info dict.

        Raises
        ------
        WorldError
            If the environment raises an exception; also raised by `step`.

        """
        with self._blamed_for('reset'):
            observation, told = self._env.reset(seed=self._seed)
            self._seed = None
            return flatten(observation), told

    def step(self, action) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Perform an action; return the values of Gymnasium's `step`, with a vector state."""
        with self._blamed_for('step'):
            observation, reward, terminated, truncated, told = self._env.step(action)
            return flatten(observation), float(reward), bool(terminated), bool(truncated), told

    def sample_action(self):
        """Return a random action."""
        return self._env.action_space.sample()

    def values_of(self, action) -> list[float]:
        """Return the numbers of an action, as `action_names`."""
        return list(named_action(self._env.action_space, action).values())

    def allows(self, number: int) -> bool:
        """Return whether an integer is a valid action."""
        return self._is_discrete and bool(self._env.action_space.contains(np.int64(number)))

    @contextmanager
    def _blamed_for(self, what: str) -> Iterator[None]:
        try:
            yield
        except Exception as error:  # The environment may raise anything.
            where = traceback.extract_tb(error.__traceback__)[-1]
            raise WorldError(
                f'the {what} of the environment {self._name!r} failed: {type(error).__name__}: '
                f'{" ".join(str(error).split())[:300]} ({where.filename}, line {where.lineno})'
            ) from error
