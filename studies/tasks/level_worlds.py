# SPDX-License-Identifier: Apache-2.0

"""Worlds in which a test easily confirms an irrelevant sensor.

pendulum_in_full, cosine_of_pendulum, angle_of_pole
    Gymnasium environments, with all channels visible or a single one.
vibration
    Each reading partly shows the outcome of the episode, by the scale of a vibration.
fading, late
    The hidden state is visible in the first steps only, or in the last ones.
counts
    Readings and rewards count events of a hidden rate.
the_better_the_longer, falls
    Each step has the reward 1 until a fall, which comes later with a better grip, or at random.
heavy_tails
    The noise of the rewards has Student's distribution with 1.5 degrees of freedom: no variance.
unequal_noise
    The noise of the rewards grows with the visible channel.
echo_of_action
    A few long episodes. The reward is a nonlinear function of the action and two sensors; a third
    sensor measures the action almost exactly.
windows_memory_0, ..._50, ..._200, ..._1000
    A single drive cut into windows. The reward has a memory of this many steps. No sensor is
    related to it; each has its own memory.
fleet, fleet_without_sources
    Robots of 12 episodes each. Each has its own mean reward, and its own zero of each sensor; the
    robot of an episode is given, or not.

Each world also has `IRRELEVANT` channels of four kinds: constant in an episode, slow, white, and
the visible ones of an independent recording.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from cmifs_ros.core import Episode

from .environments import rollout_environment
from .synthetic import ar

KINDS = ('constant', 'slow', 'white', 'other')
IRRELEVANT = ('constant_1', 'constant_2', 'slow_1', 'slow_2', 'white_1', 'white_2')
EPISODES_A_ROBOT = 12
_WINDOW = 25
_MEMORIES = (0, 5, 20, 50, 100, 300, 1000, 3000)

Rollout = Callable[[int, int], list[Episode]]


class LevelWorld(NamedTuple):
    """A world, without the irrelevant sensors.

    Attributes
    ----------
    rollout : callable
        (number of episodes, seed) -> list of Episode
    shown : tuple of str
        Names of its channels. Those that begin with 'other' are irrelevant.
    episodes : tuple of int
        Numbers of episodes that the study of the level draws.

    """

    rollout: Rollout
    shown: tuple[str, ...]
    episodes: tuple[int, ...] = (60,)

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Names of the visible channels and of the irrelevant ones."""
        others = (f'other_{name}' for name in self.shown if name in self.relevant)
        return (*self.shown, *IRRELEVANT, *others)

    @property
    def relevant(self) -> tuple[str, ...]:
        """Names of the relevant channels."""
        return tuple(name for name in self.shown if not name.startswith('other'))


def rollout_level(name: str, num_episodes: int, seed: int) -> list[Episode]:
    """Return episodes of one of `LEVEL_WORLDS` with irrelevant sensors.

    The same seed gives the same episodes, but different ones in each world, so that the rows of a
    table are independent.
    """
    world, entropy = LEVEL_WORLDS[name], [seed, *name.encode()]
    own, other, rest = (int(s) for s in np.random.SeedSequence(entropy).generate_state(3))
    episodes = world.rollout(num_episodes, own)
    if not world.relevant:
        return [
            replace(e, states=np.hstack([e.states, irrelevant(len(e), rest, i)]))
            for i, e in enumerate(episodes)
        ]
    # The relevant channels come first.
    shown_by_others = [
        o.states[:, : len(world.relevant)] for o in world.rollout(num_episodes, other)
    ]
    return [
        replace(e, states=np.hstack([e.states, irrelevant(len(e), rest, i), _as_long(o, len(e))]))
        for i, (e, o) in enumerate(zip(episodes, shown_by_others, strict=True))
    ]


def irrelevant(num_steps: int, seed: int, number: int) -> np.ndarray:
    """Return the `IRRELEVANT` channels of an episode, shape (num_steps, 6)."""
    rng = np.random.default_rng([seed, number])
    constant = np.tile(rng.normal(size=2), (num_steps, 1))
    slow = rng.normal(size=2) + 0.2 * np.cumsum(rng.normal(size=(num_steps, 2)), axis=0)
    return np.hstack([constant, slow, rng.normal(size=(num_steps, 2))])


def _as_long(states: np.ndarray, num_steps: int) -> np.ndarray:
    """Return states of a number of steps; a shorter episode repeats its last state."""
    return states[np.minimum(np.arange(num_steps), len(states) - 1)]


def _each(draw: Callable, num_episodes: int, seed: int) -> list[Episode]:
    """Return independent episodes from `draw`, which returns one channel and the rewards."""
    drawn = (draw(np.random.default_rng([seed, i])) for i in range(num_episodes))
    return [Episode(channel[:, None], rewards) for channel, rewards in drawn]


def _one_channel(name: str, channel: int, num_episodes: int, seed: int) -> list[Episode]:
    episodes = rollout_environment(name, num_episodes, seed)
    return [Episode(e.states[:, [channel]], e.rewards) for e in episodes]


def _rewards_at_the_end(num_steps: int, reward: float) -> np.ndarray:
    return np.append(np.zeros(num_steps - 1), reward)


def _vibration(rng):
    is_good = rng.random() < 0.3
    size = 1.0 if is_good else np.exp(rng.uniform(0.7, 3))
    return np.arcsinh(size * rng.normal(size=15)), _rewards_at_the_end(15, is_good)


def _fading(rng):
    hidden = rng.normal()
    shown = hidden * np.exp(-np.arange(30) / 6) + 0.3 * rng.normal(size=30)
    return shown, _rewards_at_the_end(30, hidden + 0.5 * rng.normal())


def _late(rng):
    hidden = rng.normal()
    shown = hidden * (np.arange(30) > 15) + 0.3 * rng.normal(size=30)
    return shown, 0.3 * hidden + rng.normal(size=30)


def _counts(rng):
    rate = rng.gamma(1.0)
    return rng.poisson(3 * rate, size=20).astype(float), rng.poisson(rate, size=20)


def _the_better_the_longer(rng):
    grip = rng.normal()
    num_steps = max(5, int(12 * np.exp(0.5 * grip)))
    return grip + rng.normal(size=num_steps), np.ones(num_steps)


def _falls(rng):
    grip = rng.normal()
    num_steps = min(2 + int(rng.geometric(min(1.0, 0.08 * np.exp(-grip)))), 80)
    return grip + rng.normal(size=num_steps), np.ones(num_steps)


def _heavy_tails(rng):
    shown = 0.5 * np.cumsum(rng.normal(size=20))
    noise = rng.standard_t(1.5, size=20) * np.exp(0.5 * np.clip(shown, -2, 2))
    return shown, shown + noise


def _unequal_noise(rng):
    shown = rng.normal() + 0.5 * rng.normal(size=20)
    noise = np.exp(shown) * rng.normal(size=20) + np.exp(shown[0]) * rng.normal()
    return shown, shown + noise


def _remembering(noise: np.ndarray, num_steps: int) -> np.ndarray:
    """Return a stationary process of variance 1 with a memory of some steps, from white noise."""
    share = np.exp(-1 / num_steps) if num_steps else 0.0
    new = np.append(noise[:1], np.sqrt(1 - share**2) * noise[1:])
    return lfilter([1.0], [1.0, -share], new)


def _windows(of_reward: int, num_episodes: int, seed: int) -> list[Episode]:
    noise = np.random.default_rng(seed).normal(size=(num_episodes * _WINDOW, 1 + len(_MEMORIES)))
    rewards = _remembering(noise[:, 0], of_reward)
    states = np.column_stack(
        [_remembering(of_one, m) for of_one, m in zip(noise[:, 1:].T, _MEMORIES, strict=True)]
    )
    return [
        Episode(states[i : i + _WINDOW], rewards[i : i + _WINDOW])
        for i in range(0, len(rewards), _WINDOW)
    ]


def _fleet(has_sources: bool, num_episodes: int, seed: int) -> list[Episode]:
    episodes = []
    for i in range(num_episodes):
        robot = i // EPISODES_A_ROBOT
        zero, mean_reward = np.random.default_rng([seed, robot, 1]).normal(size=2)
        rng = np.random.default_rng([seed, i])
        slip = ar(rng, 12, 1, 0.8)
        rewards = 0.5 * slip[:, 0] + 0.5 * mean_reward + rng.normal(size=12)
        source = f'robot_{robot}' if has_sources else ''
        episodes.append(Episode(slip + zero, rewards, source=source))
    return episodes


def _echo_of_action(num_episodes: int, seed: int) -> list[Episode]:
    episodes = []
    for i in range(num_episodes):
        rng = np.random.default_rng([seed, i])
        command = np.repeat(rng.choice([-1.0, 0.0, 0.5, 1.0, 1.5], size=15), 20)
        load = np.repeat(rng.normal(size=12), 25)
        heat = _remembering(rng.normal(size=300), 50)
        echo = command + 0.01 * rng.normal(size=300)
        rewards = np.tanh(command) * (1 + 0.5 * load) - 0.3 * command**2 + 0.5 * heat
        rewards += 0.3 * rng.normal(size=300)
        states = np.column_stack([load, heat, echo])
        episodes.append(Episode(states, rewards, command[:, None]))
    return episodes


def _names(*draws: Callable) -> dict[str, LevelWorld]:
    return {draw.__name__[1:]: LevelWorld(partial(_each, draw), ('x',)) for draw in draws}


_OF_MEMORIES: Sequence[str] = tuple(f'other_memory_{m}' for m in _MEMORIES)

LEVEL_WORLDS = {
    'pendulum_in_full': LevelWorld(
        partial(rollout_environment, 'pendulum'), ('cosine', 'sine', 'angular_velocity')
    ),
    'cosine_of_pendulum': LevelWorld(partial(_one_channel, 'pendulum', 0), ('x',)),
    'angle_of_pole': LevelWorld(partial(_one_channel, 'cart_pole', 2), ('x',)),
    'vibration': LevelWorld(partial(_each, _vibration), ('x',), (80,)),
    **_names(_fading, _late, _counts, _the_better_the_longer, _falls, _heavy_tails, _unequal_noise),
    **{
        f'windows_memory_{m}': LevelWorld(partial(_windows, m), _OF_MEMORIES, (50, 200))
        for m in (0, 50, 200, 1000)
    },
    'echo_of_action': LevelWorld(_echo_of_action, ('load', 'heat', 'other_echo'), (10, 20)),
    'fleet': LevelWorld(partial(_fleet, True), ('x',)),
    'fleet_without_sources': LevelWorld(partial(_fleet, False), ('x',)),
}
#: Worlds that need Gymnasium.
OF_GYMNASIUM = ('pendulum_in_full', 'cosine_of_pendulum', 'angle_of_pole')
