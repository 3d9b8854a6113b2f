"""A Gymnasium environment as a robot that is simulated: named channels, and a random policy.

Gymnasium is optional: python3 -m pip install gymnasium.
"""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from cmifs_ros.core.channel_names import problem_of_names

from .gymnasium_episodes import channel_names, flatten


class WorldError(Exception):
    """An environment failed while it ran; the message says which, how and where."""


class GymnasiumWorld:
    """An environment with states as vectors, as `GridWorld` is used.

    Its episodes under its own policy, which is random, are those of `collect_episodes`.

    Parameters
    ----------
    name : str
        As `gymnasium.make` takes it, such as 'Pendulum-v1'.
    seed : int

    Attributes
    ----------
    channel_names : tuple of str
    actions : str
        Which there are, in words.

    Raises
    ------
    ValueError
        If there is no Gymnasium, no such environment, or its states cannot be ours.

    """

    def __init__(self, name: str, seed: int):
        try:
            import gymnasium
        except ImportError:
            raise ValueError(
                f'env is {name!r}, and Gymnasium is not installed: '
                'python3 -m pip install gymnasium (gymnasium[mujoco] for MuJoCo)'
            ) from None
        try:
            self._env = gymnasium.make(name)
        except Exception as error:  # Of the registry or of the environment's own making.
            what = ' '.join(str(error).split())[:300]
            raise ValueError(
                f'env is {name!r}; expected an environment such as Pendulum-v1: {what}'
            ) from error
        self.channel_names = channel_names(self._env)
        problem = problem_of_names(self.channel_names)
        if problem:
            raise ValueError(f'env is {name!r}, whose states have {problem}')
        self.actions = f'some of {self._env.action_space}'
        self._is_discrete = isinstance(self._env.action_space, gymnasium.spaces.Discrete)
        self._name = name
        self._seed: int | None = seed
        self._env.action_space.seed(seed)

    def reset(self) -> tuple[np.ndarray, dict]:
        """Begin an episode; return its first state, shape (v,), and what else is told.

        Raises
        ------
        WorldError
            If the environment raises anything; so does `step`.

        """
        with self._blamed_for('reset'):
            observation, told = self._env.reset(seed=self._seed)
            self._seed = None
            return flatten(observation), told

    def step(self, action) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Take an action; return what Gymnasium does, the state as a vector."""
        with self._blamed_for('step'):
            observation, reward, terminated, truncated, told = self._env.step(action)
            return flatten(observation), float(reward), bool(terminated), bool(truncated), told

    def sample_action(self):
        """Return a random action."""
        return self._env.action_space.sample()

    def allows(self, number: int) -> bool:
        """Tell whether a whole number is an action."""
        return self._is_discrete and bool(self._env.action_space.contains(np.int64(number)))

    @contextmanager
    def _blamed_for(self, what: str) -> Iterator[None]:
        try:
            yield
        except Exception as error:  # It is somebody else's code.
            where = traceback.extract_tb(error.__traceback__)[-1]
            raise WorldError(
                f'the {what} of the environment {self._name!r} failed: {type(error).__name__}: '
                f'{" ".join(str(error).split())[:300]} ({where.filename}, line {where.lineno})'
            ) from error
