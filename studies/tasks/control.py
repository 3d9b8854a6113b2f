# SPDX-License-Identifier: Apache-2.0

"""Worlds in which sensors matter through the action: what a controller needs to see.

match
    A piece of one of several types arrives; the reward is 1 if it is put into the right bin.
secret_key
    The action is a number, and the reward falls with its distance from 3 k1 - 3 k2 + k3.
stakes
    The reward is that of a bet, tripled while the level is high; the next level is high if the
    action differs from the key.
high_stakes
    The same with nine times: who knows the key gives up small bets for a high level.
mixed
    SEEK's: the reward depends on the action and on s1, and s1 at the next step on s2. Half of the
    other channels are driven by the action, half are independent of everything.
autoregressive
    SEEK's: the reward is the action times s1 + s2; the action determines whether channels persist.
toy
    That of Castelletti et al. 2011: the reward depends on s0 and the action, s0 at the next step on
    s2, and s2 on the action.
nothing
    Rewards, actions and channels are independent.

A skilled controller takes the best action in 19 of 20 steps.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from cmifs_ros.core import Episode

#: Share of random actions of a skilled controller.
_SLIPS = 0.05


class ControlWorld(NamedTuple):
    """A world with actions, a step at a time.

    A state has the channels first; what no sensor shows comes after them.

    Attributes
    ----------
    begin : callable
        generator -> the state in which an episode begins
    step : callable
        (generator, state, action) -> the reward, and the next state. It draws the same numbers
        whatever the action is, so that episodes by different actions can be compared.
    random : callable
        generator -> an action
    best : callable
        channels -> the action of a skilled controller
    channel_names : tuple of str
    num_steps, num_episodes : int
        Default numbers.
    needed_for : dict of str to tuple of str
        The channels that each target needs. 'action' applies to skilled controllers.

    """

    begin: Callable[[Generator], np.ndarray]
    step: Callable[[Generator, np.ndarray, float], tuple[float, np.ndarray]]
    random: Callable[[Generator], float]
    best: Callable[[np.ndarray], float]
    channel_names: tuple[str, ...]
    num_steps: int
    num_episodes: int
    needed_for: dict[str, tuple[str, ...]]


class RunningWorld:
    """A control world in which one acts.

    Parameters
    ----------
    world : ControlWorld
    seed : int or sequence of int

    """

    def __init__(self, world: ControlWorld, seed):
        self._world, self._rng = world, np.random.default_rng(seed)

    def reset(self) -> np.ndarray:
        """Begin an episode; return the channels."""
        self._state = self._world.begin(self._rng)
        return self._seen()

    def step(self, action: float) -> tuple[np.ndarray, float, bool]:
        """Act; return the channels then, the reward, and that the episode goes on."""
        reward, self._state = self._world.step(self._rng, self._state, action)
        return self._seen(), float(reward), False

    def _seen(self) -> np.ndarray:
        return self._state[: len(self._world.channel_names)]


def skilled(world: ControlWorld, channels: np.ndarray, rng: Generator) -> float:
    """Return the action of a skilled controller."""
    random, is_slip = world.random(rng), rng.random() < _SLIPS
    return random if is_slip else world.best(channels)


def rollout_control(
    name: str, num_episodes: int, seed: int, *, is_skilled: bool = False
) -> list[Episode]:
    """Return episodes of one of `CONTROL_WORLDS`; the same seed gives the same episodes."""
    world = CONTROL_WORLDS[name]
    own, of_policy = [seed, sum(map(ord, name))], np.random.default_rng([seed, is_skilled])
    running = RunningWorld(world, own)
    episodes = []
    for _ in range(num_episodes):
        state, steps = running.reset(), []
        for _ in range(world.num_steps):
            action = skilled(world, state, of_policy) if is_skilled else world.random(of_policy)
            reached, reward, _ = running.step(action)
            steps.append((state, reward, action))
            state = reached
        episodes.append(Episode(*zip(*steps, strict=True)))
    return episodes


def _names(prefix: str, count: int) -> tuple[str, ...]:
    return tuple(f'{prefix}{i}' for i in range(1, count + 1))


def _coin(rng) -> int:
    return int(rng.integers(2))


def _new_piece(rng):
    kind = _coin(rng)
    return np.array([kind + 0.2 * rng.normal(), *rng.normal(size=5), kind])


def _match(rng, state, action):
    return float(action == state[-1]), _new_piece(rng)


def _new_key(rng):
    return rng.normal(size=8)


def _secret(keys):
    return keys[:3] @ [3, -3, 1]


def _secret_key(rng, state, action):
    return -abs(action - _secret(state)), _new_key(rng)


def _new_stake(rng, level=None):
    coins = rng.integers(0, 2, size=3)
    coins[0] = coins[0] if level is None else level
    return np.array([*coins, *rng.normal(size=4)])


def _stakes(rng, state, action, *, high):
    level, bet, key = state[:3]
    reward = (high if level else 1.0) * (1.0 if action == bet else -1.0)
    return reward, _new_stake(rng, action != key)


def _begin_mixed(rng):
    return np.array([_coin(rng), *rng.normal(size=19)])


def _mixed(rng, state, action):
    s1, s2, driven, free = state[0], state[1], state[2:11], state[11:]
    reward = action + s1 + 0.5 * rng.normal()
    s1 = rng.random() < 1 / (1 + np.exp(-s2))
    driven = 0.5 * driven + (action - 0.5) + 0.5 * rng.normal(size=9)
    return reward, np.array([s1, rng.normal(), *driven, *(0.5 * free + rng.normal(size=9))])


def _autoregressive(rng, state, action):
    reward = action * (state[0] + state[1]) + 0.5 * rng.normal()
    return reward, (0.8 if action else 0.08) * state + 0.5 * rng.normal(size=20)


def _toy(rng, state, action):
    s0 = state[0] + 0.1 * state[2]
    s2 = np.cbrt(state[2] + 0.5 * action)
    return -(state[0] ** 2) - action, np.array([s0, rng.normal(), s2, rng.normal()])


def _nothing(rng, state, action):
    return rng.normal(), rng.normal(size=6)


def _stakes_world(high: float) -> ControlWorld:
    return ControlWorld(
        _new_stake,
        partial(_stakes, high=high),
        _coin,
        lambda seen: int(seen[1]),
        ('level', 'bet', 'key', *_names('noise_', 4)),
        12,
        100,
        {'decision': ('level', 'bet', 'key'), 'action': ('bet',)},
    )


CONTROL_WORLDS = {
    'match': ControlWorld(
        _new_piece,
        _match,
        _coin,
        lambda seen: int(seen[0] > 0.5),
        ('hue', *_names('noise_', 5)),
        12,
        60,
        {'return': ('hue',), 'decision': ('hue',), 'action': ('hue',)},
    ),
    'secret_key': ControlWorld(
        _new_key,
        _secret_key,
        lambda rng: 4.5 * rng.normal(),
        _secret,
        ('k1', 'k2', 'k3', *_names('decoy_', 5)),
        10,
        100,
        dict.fromkeys(('return', 'decision', 'action'), ('k1', 'k2', 'k3')),
    ),
    'stakes': _stakes_world(high=3.0),
    'high_stakes': _stakes_world(high=9.0),
    'mixed': ControlWorld(
        _begin_mixed,
        _mixed,
        _coin,
        lambda seen: int(seen[0] > 0.5),
        ('s1', 's2', *_names('driven_', 9), *_names('free_', 9)),
        20,
        100,
        {'decision': ('s1', 's2'), 'action': ('s1',)},
    ),
    'autoregressive': ControlWorld(
        partial(Generator.normal, size=20),
        _autoregressive,
        _coin,
        lambda seen: int(seen[0] + seen[1] > 0),
        _names('s', 20),
        50,
        60,
        dict.fromkeys(('return', 'decision', 'action'), ('s1', 's2')),
    ),
    'toy': ControlWorld(
        lambda rng: 0.5 * rng.normal(size=4),
        _toy,
        lambda rng: rng.uniform(-1, 1),
        lambda seen: np.clip(-2 * seen[0] - seen[2], -1, 1),
        ('s0', 's1', 's2', 's3'),
        10,
        60,
        dict.fromkeys(('return', 'decision', 'action'), ('s0', 's2')),
    ),
    'nothing': ControlWorld(
        lambda rng: rng.normal(size=6),
        _nothing,
        _coin,
        lambda seen: 0,
        _names('noise_', 6),
        12,
        60,
        dict.fromkeys(('return', 'decision', 'action'), ()),
    ),
}
