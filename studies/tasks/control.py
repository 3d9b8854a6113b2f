# SPDX-License-Identifier: Apache-2.0

"""Worlds in which sensors matter by what the robot does: what a controller needs to see.

match
    A piece of some kind comes; the reward is 1 if it is put into the bin of its kind.
secret_key
    The action is a number, and the reward falls with its distance from 3 k1 - 3 k2 + k3.
stakes
    The reward is that of a bet, three times as great while the level is high; the next level is
    high if the action differs from the key.
mixed
    SEEK's: the reward depends on the action and on s1, and s1 at the next step on s2. Half of the
    other channels are driven by the action, half are independent of everything.
autoregressive
    SEEK's: the reward is the action times s1 + s2; the action lets all channels live or die.
toy
    That of Castelletti et al. 2011: the reward depends on s0 and the action, s0 at the next step on
    s2, and s2 on the action.
nothing
    Rewards, actions and channels are independent.

Where a controller is skilled, it takes the best action in all but one of twenty steps.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cmifs_ros.core import Episode

#: Of a skilled controller.
_SLIPS = 0.05


class ControlWorld(NamedTuple):
    """A world with actions.

    Attributes
    ----------
    draw : callable
        (generator, steps, is_skilled) -> states (T, v), rewards (T,), actions (T, a)
    channel_names : tuple of str
    num_steps, num_episodes : int
        As they are usually drawn.
    needed_for : dict of str to tuple of str
        The channels that each target needs. 'action' is asked of skilled controllers.

    """

    draw: Callable
    channel_names: tuple[str, ...]
    num_steps: int
    num_episodes: int
    needed_for: dict[str, tuple[str, ...]]


def rollout_control(
    name: str, num_episodes: int, seed: int, *, is_skilled: bool = False
) -> list[Episode]:
    """Return episodes of one of `CONTROL_WORLDS`, the same ones for the same seed."""
    world = CONTROL_WORLDS[name]
    rng = np.random.default_rng([seed, sum(map(ord, name)), is_skilled])
    return [Episode(*world.draw(rng, world.num_steps, is_skilled)) for _ in range(num_episodes)]


def _names(prefix: str, count: int) -> tuple[str, ...]:
    return tuple(f'{prefix}{i}' for i in range(1, count + 1))


def _skilled(rng, best, random):
    """Return the best actions, but some random ones in their place."""
    return np.where(rng.random(best.shape) < _SLIPS, random, best)


def _match(rng, num_steps, is_skilled):
    kind, random = rng.integers(0, 2, size=(2, num_steps))
    action = _skilled(rng, kind, random) if is_skilled else random
    hue = kind + 0.2 * rng.normal(size=num_steps)
    states = np.column_stack([hue, rng.normal(size=(num_steps, 5))])
    return states, (action == kind).astype(float), action


def _secret_key(rng, num_steps, is_skilled):
    keys = rng.normal(size=(num_steps, 3))
    best = keys @ [3, -3, 1]
    random = 4.5 * rng.normal(size=num_steps)
    action = _skilled(rng, best, random) if is_skilled else random
    states = np.column_stack([keys, rng.normal(size=(num_steps, 5))])
    return states, -np.abs(action - best), action


def _stakes(rng, num_steps, is_skilled):
    bet, key, random = rng.integers(0, 2, size=(3, num_steps))
    action = _skilled(rng, bet, random) if is_skilled else random
    level = np.empty(num_steps, dtype=int)
    level[0] = rng.integers(0, 2)
    level[1:] = action[:-1] ^ key[:-1]
    rewards = np.where(level, 3.0, 1.0) * np.where(action == bet, 1.0, -1.0)
    return np.column_stack([level, bet, key, rng.normal(size=(num_steps, 4))]), rewards, action


def _mixed(rng, num_steps, is_skilled):
    num_driven, num_free = 9, 9
    states = np.empty((num_steps, 2 + num_driven + num_free))
    action = rng.integers(0, 2, size=num_steps)
    s1, s2 = float(rng.integers(0, 2)), rng.normal(size=num_steps)
    driven, free = rng.normal(size=num_driven), rng.normal(size=num_free)
    rewards = np.empty(num_steps)
    for t in range(num_steps):
        if is_skilled:
            action[t] = _skilled(rng, np.array(s1 > 0.5), action[t])
        states[t] = s1, s2[t], *driven, *free
        rewards[t] = action[t] + s1 + 0.5 * rng.normal()
        s1 = float(rng.random() < 1 / (1 + np.exp(-s2[t])))
        driven = 0.5 * driven + (action[t] - 0.5) + 0.5 * rng.normal(size=num_driven)
        free = 0.5 * free + rng.normal(size=num_free)
    return states, rewards, action


def _autoregressive(rng, num_steps, is_skilled):
    state = rng.normal(size=20)
    states, rewards = np.empty((num_steps, 20)), np.empty(num_steps)
    action = rng.integers(0, 2, size=num_steps)
    for t in range(num_steps):
        if is_skilled:
            action[t] = _skilled(rng, np.array(state[0] + state[1] > 0), action[t])
        states[t] = state
        rewards[t] = action[t] * (state[0] + state[1]) + 0.5 * rng.normal()
        state = (0.8 if action[t] else 0.08) * state + 0.5 * rng.normal(size=20)
    return states, rewards, action


def _toy(rng, num_steps, is_skilled):
    state = 0.5 * rng.normal(size=4)
    states, rewards = np.empty((num_steps, 4)), np.empty(num_steps)
    actions = rng.uniform(-1, 1, size=num_steps)
    for t in range(num_steps):
        if is_skilled:
            best = np.array(np.clip(-2 * state[0] - state[2], -1, 1))
            actions[t] = _skilled(rng, best, actions[t])
        states[t] = state
        rewards[t] = -(state[0] ** 2) - actions[t]
        s0 = state[0] + 0.1 * state[2]
        s2 = np.cbrt(state[2] + 0.5 * actions[t])
        state = np.array([s0, rng.normal(), s2, rng.normal()])
    return states, rewards, actions


def _nothing(rng, num_steps, is_skilled):
    return (
        rng.normal(size=(num_steps, 6)),
        rng.normal(size=num_steps),
        rng.integers(0, 2, size=num_steps),
    )


CONTROL_WORLDS = {
    'match': ControlWorld(
        _match,
        ('hue', *_names('noise_', 5)),
        12,
        60,
        {'return': ('hue',), 'decision': ('hue',), 'action': ('hue',)},
    ),
    'secret_key': ControlWorld(
        _secret_key,
        ('k1', 'k2', 'k3', *_names('decoy_', 5)),
        10,
        100,
        dict.fromkeys(('return', 'decision', 'action'), ('k1', 'k2', 'k3')),
    ),
    'stakes': ControlWorld(
        _stakes,
        ('level', 'bet', 'key', *_names('noise_', 4)),
        12,
        100,
        {'decision': ('level', 'bet', 'key'), 'action': ('bet',)},
    ),
    'mixed': ControlWorld(
        _mixed,
        ('s1', 's2', *_names('driven_', 9), *_names('free_', 9)),
        20,
        100,
        {'decision': ('s1', 's2'), 'action': ('s1',)},
    ),
    'autoregressive': ControlWorld(
        _autoregressive,
        _names('s', 20),
        50,
        60,
        dict.fromkeys(('return', 'decision', 'action'), ('s1', 's2')),
    ),
    'toy': ControlWorld(
        _toy,
        ('s0', 's1', 's2', 's3'),
        10,
        60,
        dict.fromkeys(('return', 'decision', 'action'), ('s0', 's2')),
    ),
    'nothing': ControlWorld(
        _nothing, _names('noise_', 6), 12, 60, dict.fromkeys(('return', 'decision', 'action'), ())
    ),
}
