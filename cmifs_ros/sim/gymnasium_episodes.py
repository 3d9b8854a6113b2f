# SPDX-License-Identifier: Apache-2.0

"""Episodes of any environment with Gymnasium's interface, and a wrapper that selects channels.

Only the wrapper needs Gymnasium itself: python3 -m pip install gymnasium.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy

import numpy as np

from cmifs_ros.core import Episode


def flatten(observation) -> np.ndarray:
    """Return the channels of an observation, shape (v,); mappings and tuples are concatenated.

    The keys of a mapping are sorted, because an environment may return them in any order.
    """
    if isinstance(observation, Mapping):
        observation = tuple(observation[key] for key in sorted(observation))
    if isinstance(observation, tuple):
        return np.concatenate([flatten(part) for part in observation])
    return np.asarray(observation, dtype=np.float64).ravel()


def channel_names(env) -> tuple[str, ...]:
    """Return a name for each channel of an environment's observation.

    The names are the keys of a Dict space, numbered if the value is an array; otherwise those in
    the `observation_structure` of MuJoCo's environments (``qpos_0``, ``qvel_0``); otherwise
    ``obs_0``, ``obs_1``, ...
    """
    sample = env.observation_space.sample()
    if isinstance(sample, Mapping):
        sizes = {key: len(flatten(value)) for key, value in sorted(sample.items())}
        return tuple(
            name
            for key, size in sizes.items()
            for name in ([str(key)] if size == 1 else [f'{key}_{i}' for i in range(size)])
        )
    count = len(flatten(sample))
    structure = getattr(env.unwrapped, 'observation_structure', None) or {}
    # `skipped_qpos` and similar entries count what is not observed.
    sizes = {k: n for k, n in structure.items() if not k.startswith('skipped') and n}
    if sum(sizes.values()) == count:
        return tuple(f'{key}_{i}' for key, size in sizes.items() for i in range(size))
    return tuple(f'obs_{i}' for i in range(count))


def action_names(env) -> tuple[str, ...]:
    """Return a name for each number of an environment's actions, as episodes hold them.

    A Discrete action is one-hot, ``action.0``, ``action.1``, ...; the values of a Box are
    ``action_0``, ``action_1``, ..., or ``action`` if there is only one. MultiDiscrete, Dict and
    Tuple consist of such parts. Other spaces, and an environment without one, have no names.
    """
    space = getattr(env, 'action_space', None)
    return () if space is None else tuple(named_action(space, deepcopy(space).sample()))


def named_action(space, action, name: str = 'action') -> dict[str, float]:
    """Return the numbers of an action, with the names of `action_names`.

    Parameters
    ----------
    space : gymnasium.spaces.Space
    action : object
        An element of the space.
    name : str
        Beginning of the names.

    """
    kinds = {kind.__name__ for kind in type(space).__mro__}
    if kinds & {'Dict', 'Tuple'}:
        is_dict = isinstance(space.spaces, Mapping)
        parts = space.spaces.items() if is_dict else enumerate(space.spaces)
        named = [named_action(part, action[key], f'{name}_{key}') for key, part in parts]
        return {key: value for part in named for key, value in part.items()}
    if 'Discrete' in kinds:
        return _one_hot(name, action, space.start, space.n)
    values = np.ravel(action)
    names = [name] if len(values) == 1 else [f'{name}_{i}' for i in range(len(values))]
    if 'MultiDiscrete' in kinds:
        parts = zip(names, values, np.ravel(space.start), np.ravel(space.nvec), strict=True)
        return {key: value for part in parts for key, value in _one_hot(*part).items()}
    if kinds & {'Box', 'MultiBinary'}:
        return {key: float(value) for key, value in zip(names, values, strict=True)}
    return {}


def _one_hot(name: str, value: int, start: int, count: int) -> dict[str, float]:
    return {f'{name}.{k}': float(k == value) for k in range(start, start + count)}


def collect_episodes(
    env,
    num_episodes: int,
    policy: Callable[[object], object] | None = None,
    *,
    max_steps: int = 1000,
    seed: int | None = None,
) -> list[Episode]:
    """Return episodes of an environment with their actions, the same for the same seed.

    The values of an action are named by `action_names(env)`.

    Parameters
    ----------
    env : gymnasium.Env
        Or any object with the same `reset` and `step`.
    num_episodes : int
    policy : callable, optional
        Maps an observation to an action; by default actions are random.
    max_steps : int
        An episode that the environment does not end is cut after this many steps.
    seed : int, optional
        Seed of the environment and of the random actions.

    Raises
    ------
    ValueError
        If a number is below 1, or an observation or reward is not finite.

    """
    for name, value in (('num_episodes', num_episodes), ('max_steps', max_steps)):
        if value < 1:
            raise ValueError(f'{name} is {value}; expected at least 1')
    if policy is None:
        env.action_space.seed(seed)
    space = getattr(env, 'action_space', None)
    episodes = []
    for i in range(num_episodes):
        observation, _ = env.reset(seed=seed if i == 0 else None)
        states, actions, has_ended = [], [], False
        rewards: list[float] = []
        while not has_ended and len(rewards) < max_steps:
            action = env.action_space.sample() if policy is None else policy(observation)
            states.append(flatten(observation))
            actions.append(list(named_action(space, action).values()))
            observation, reward, terminated, truncated, _ = env.step(action)
            rewards.append(reward)
            has_ended = terminated or truncated
        episodes.append(Episode(states, rewards, actions))
    return episodes


def select_channels(env, names: Sequence[str]):
    """Return the environment with an observation that consists of the named channels only.

    Parameters
    ----------
    env : gymnasium.Env
    names : sequence of str
        Some of `channel_names(env)`, for example from `get_feature_names_out` of a selector. The
        new observation is a vector of shape (len(names),) in this order.

    Returns
    -------
    gymnasium.ObservationWrapper

    Raises
    ------
    ImportError
        If Gymnasium is not installed.
    ValueError
        If a channel is unknown or none is named.

    """
    try:
        from gymnasium import ObservationWrapper
        from gymnasium.spaces import Box
    except ImportError as error:
        raise ImportError('Gymnasium is not installed: python3 -m pip install gymnasium') from error

    names, known = list(names), channel_names(env)
    unknown = [name for name in names if name not in known]
    if unknown or not names:
        raise ValueError(f'names is {names}; expected at least one of {", ".join(known)}')
    indices = [known.index(name) for name in names]

    class SelectedChannels(ObservationWrapper):
        """Observe only the selected channels, as a vector."""

        def __init__(self, env):
            super().__init__(env)
            self.observation_space = Box(-np.inf, np.inf, (len(indices),), np.float64)

        def observation(self, observation):
            return flatten(observation)[indices]

    return SelectedChannels(env)
