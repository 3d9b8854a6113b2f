# SPDX-License-Identifier: Apache-2.0

"""Small worlds for one question each, with a known truth.

point_robot
    A robot at 50 Hz on a noisy, damped spring in the plane. A step costs the distance from the
    origin, plus 1 while the battery is below 20. The future position depends on position and
    velocity, but the spring is slow compared with the episodes: x, y and battery are relevant, and
    velocity is partly redundant with them.
copy, noisy_copy
    The stronger of two relevant sensors has a copy, exact or with noise. The original and the
    weaker sensor are relevant.
dead_channel
    In addition to two relevant sensors there is one that never changes.
two_switches
    The reward is 1 if exactly one of two switches is on: each alone is uninformative.
wild_readings, one_wild_reading
    The only relevant sensor, a range, reads 65535 in 2 % of the steps, or once.
one_of_twelve, twelve_of_noise
    A sensor of twelve channels, of which only the first is relevant, in addition to x; or none is,
    and x and y are relevant.
drift
    The policy improves from episode to episode, and the motor warms up. Nothing is relevant.
wandering
    The return and three sensors drift from episode to episode, independently.
independent_noise
    Channels and rewards are all independent of each other.
beside
    White noise, a random walk and another robot's channel, in addition to the relevant sensor.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from cmifs_ros.core import Episode

NUM_STEPS = 12
WILD_READING = 65535.0
LOW_BATTERY = 20.0
#: Autocorrelation of an `ar` channel at a lag of one step.
PERSISTENCE = 0.9
#: Increase of the age of the robot, from 0 to 1, with each episode.
AGEING = 0.025

_SECONDS = 0.02  # a step of the point robot


class World(NamedTuple):
    """A synthetic task.

    Attributes
    ----------
    draw : callable
        (generator, number of the episode) -> states (T, v), rewards (T,)
    channel_names : tuple of str
    relevant : tuple of str
        Names of channels or groups.
    groups : dict of str to tuple of str
        Sensors of several channels.

    """

    draw: Callable[[np.random.Generator, int], tuple[np.ndarray, np.ndarray]]
    channel_names: tuple[str, ...]
    relevant: tuple[str, ...]
    groups: dict[str, tuple[str, ...]] = {}  # noqa: RUF012


def rollout_synthetic(name: str, num_episodes: int, seed: int) -> list[Episode]:
    """Return episodes of one of `WORLDS`; the same seed gives the same ones bit for bit."""
    return rollout_world(WORLDS[name], num_episodes, seed)


def rollout_world(world: World, num_episodes: int, seed: int) -> list[Episode]:
    """Return episodes of a world, each drawn by its own generator."""
    draw = world.draw
    return [Episode(*draw(np.random.default_rng([seed, i]), i)) for i in range(num_episodes)]


def ar(
    rng: np.random.Generator, num_steps: int, num_channels: int, persistence: float = PERSISTENCE
) -> np.ndarray:
    """Return stationary, autocorrelated normal channels of variance 1."""
    values = rng.normal(size=(num_steps, num_channels))
    for t in range(1, num_steps):
        values[t] = persistence * values[t - 1] + np.sqrt(1 - persistence**2) * values[t]
    return values


def _point_robot(rng, number):
    num_steps = int(rng.integers(60, 101))
    position, velocity = rng.uniform(-2, 2, size=2), rng.normal(size=2)
    battery = rng.uniform(0, 100) - 0.1 * np.arange(num_steps)
    motion = np.empty((num_steps, 4))
    for t in range(num_steps):
        motion[t] = *position, *velocity
        push = -position - 0.5 * velocity + 3 * rng.normal(size=2)
        velocity = velocity + _SECONDS * push
        position = position + _SECONDS * velocity
    noise = np.hstack([rng.normal(size=(num_steps, 3)), ar(rng, num_steps, 2, 0.98)])
    battery = np.maximum(battery, 0)
    rewards = -np.hypot(motion[:, 0], motion[:, 1]) - (battery < LOW_BATTERY)
    return np.column_stack([motion, battery, noise]), rewards


def _strong_and_weak(rng, number, add):
    """Return x, y, four noise channels, and the result of `add` for generator and x."""
    channels = ar(rng, NUM_STEPS, 6)
    rewards = channels[:, 0] + 0.4 * channels[:, 1] + 0.3 * rng.normal(size=NUM_STEPS)
    return np.column_stack([channels, add(rng, channels[:, 0])]), rewards


def _two_switches(rng, number):
    switches = rng.integers(0, 2, size=2)
    noise = rng.normal(size=(NUM_STEPS, 4))
    rewards = (switches[0] ^ switches[1]) + 0.03 * rng.normal(size=NUM_STEPS)
    return np.hstack([np.tile(switches, (NUM_STEPS, 1)), noise]), rewards


def _wild_readings(rng, number):
    channels = ar(rng, NUM_STEPS, 4) + 3
    rewards = channels[:, 0] + 0.3 * rng.normal(size=NUM_STEPS)
    channels[rng.random(NUM_STEPS) < 0.02, 0] = WILD_READING
    return channels, rewards


def _one_wild_reading(rng, number):
    channels = ar(rng, NUM_STEPS, 4) + 3
    rewards = channels[:, 0] + 0.3 * rng.normal(size=NUM_STEPS)
    if number == 3:
        channels[5, 0] = WILD_READING
    return channels, rewards


def _one_of_twelve(rng, number):
    channels = ar(rng, NUM_STEPS, 5)
    scan = rng.normal(size=(NUM_STEPS, 12))
    scan[:, 0] = channels[:, 0]
    rewards = channels[:, 0] + 0.4 * channels[:, 1] + 0.2 * rng.normal(size=NUM_STEPS)
    return np.hstack([scan, channels[:, 1:]]), rewards


def _twelve_of_noise(rng, number):
    channels = ar(rng, NUM_STEPS, 5)
    scan = rng.normal(size=(NUM_STEPS, 12))
    rewards = channels[:, 0] + 0.4 * channels[:, 1] + 0.2 * rng.normal(size=NUM_STEPS)
    return np.hstack([scan, channels]), rewards


def _drift(rng, number):
    age = AGEING * number
    channels = rng.normal(size=(NUM_STEPS, 5))
    channels[:, 0] = 30 + 8 * age + 0.5 * channels[:, 0]
    return channels, age + 0.4 * rng.normal(size=NUM_STEPS)


def _wandering(rng, number):
    seed, _ = rng.bit_generator.seed_seq.entropy  # All episodes share one drift.
    level = ar(np.random.default_rng(seed), number + 1, 4)[-1]
    sensors = level[:3] + 0.05 * rng.normal(size=(NUM_STEPS, 3))
    channels = np.hstack([sensors, rng.normal(size=(NUM_STEPS, 3))])
    return channels, level[3] + rng.normal(size=NUM_STEPS)


def _independent_noise(rng, number):
    return rng.normal(size=(NUM_STEPS, 6)), rng.normal(size=NUM_STEPS)


def _beside(rng, number):
    channels = ar(rng, NUM_STEPS, 2)
    noise = rng.normal(size=NUM_STEPS)
    walk = np.cumsum(rng.normal(size=NUM_STEPS))
    rewards = channels[:, 0] + 0.3 * rng.normal(size=NUM_STEPS)
    return np.column_stack([channels[:, 0], noise, walk, channels[:, 1]]), rewards


def noise_names(count: int) -> tuple[str, ...]:
    """Return names of noise channels."""
    return tuple(f'noise_{i}' for i in range(1, count + 1))


_SCAN = tuple(f'scan_{i}' for i in range(1, 13))
_X_Y_NOISE = ('x', 'y', *noise_names(4))

WORLDS = {
    'point_robot': World(
        _point_robot,
        ('x', 'y', 'vx', 'vy', 'battery', *noise_names(3), 'slow_1', 'slow_2'),
        ('x', 'y', 'battery'),
    ),
    'copy': World(
        partial(_strong_and_weak, add=lambda rng, x: x), (*_X_Y_NOISE, 'copy'), ('x', 'y')
    ),
    'noisy_copy': World(
        partial(_strong_and_weak, add=lambda rng, x: x + 0.1 * rng.normal(size=len(x))),
        (*_X_Y_NOISE, 'copy'),
        ('x', 'y'),
    ),
    'dead_channel': World(
        partial(_strong_and_weak, add=lambda rng, x: np.full(len(x), 7.0)),
        (*_X_Y_NOISE, 'dead'),
        ('x', 'y'),
    ),
    'two_switches': World(_two_switches, ('a', 'b', *noise_names(4)), ('a', 'b')),
    'wild_readings': World(_wild_readings, ('range', *noise_names(3)), ('range',)),
    'one_wild_reading': World(_one_wild_reading, ('range', *noise_names(3)), ('range',)),
    'one_of_twelve': World(
        _one_of_twelve, (*_SCAN, 'x', *noise_names(3)), ('scan', 'x'), {'scan': _SCAN}
    ),
    'twelve_of_noise': World(
        _twelve_of_noise, (*_SCAN, 'x', 'y', *noise_names(3)), ('x', 'y'), {'scan': _SCAN}
    ),
    'drift': World(_drift, ('temperature', *noise_names(4)), ()),
    'wandering': World(_wandering, ('floor', 'oil', 'light', *noise_names(3)), ()),
    'independent_noise': World(_independent_noise, noise_names(6), ()),
    'beside': World(_beside, ('x', 'noise', 'walk', 'other_x'), ('x',)),
}
