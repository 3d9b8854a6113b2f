# SPDX-License-Identifier: Apache-2.0

"""Synthetic worlds about the form of rewards, and about how much a sensor adds.

readme_reward_0.1, readme_reward_1, readme_reward_10
    The reward of the README: some centimetres of progress per step, and at the end a success or an
    abort with this weight. Success depends on the grip.
rare_goal
    A goal is reached in 4 % of the episodes, those that aim well; every step has a noisy cost.
one_great_penalty
    The third episode has a penalty of 10,000; elsewhere the reward is x with noise.
weak_sensor
    A sensor with a twentieth of the weight of another one, among ten noise sensors.
grasps
    Force readings are small and quiet in good grasps, and up to a thousand times greater in failed
    ones. Either force shows it.
three_percent
    Beside a strong sensor, which explains 40 % of the variance of the return, a weak one adds 3 %.
faint_switches, faint_product
    Two switches, or two numbers, matter only together and add 10 %.

The shares hold for the return with `GAMMA`, given the step, and are exact: see `_Discounted`.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from .synthetic import NUM_STEPS, PERSISTENCE, World, ar, noise_names

GAMMA = 0.95
STRONG_SHARE, WEAK_SHARE, PAIR_SHARE = 0.4, 0.03, 0.1
#: Of the reward in `one_great_penalty`.
GREAT_PENALTY = -10_000.0


class _Discounted:
    """Mean squares, over the steps, of discounted sums until the end of an episode.

    With x normal, of variance 1, and its correlation with itself one step later, the return of
    rewards a x + noise has variance a^2 `of_channel` + `of_noise`, of which x at this step explains
    a^2 `explained`.
    """

    def __init__(self, persistence: float):
        explained, of_channel, of_noise, of_constant = np.zeros((4, NUM_STEPS))
        for step in range(NUM_STEPS):
            k = np.arange(NUM_STEPS - step)
            discounts = GAMMA**k
            explained[step] = (discounts @ persistence**k) ** 2
            correlations = float(persistence) ** np.abs(k[:, None] - k)
            of_channel[step] = discounts @ correlations @ discounts
            of_noise[step] = discounts @ discounts
            of_constant[step] = discounts.sum() ** 2
        self.explained, self.of_channel = explained.mean(), of_channel.mean()
        self.of_noise, self.of_constant = of_noise.mean(), of_constant.mean()


def _weights_of_shares(*shares: float) -> np.ndarray:
    """Return the weights with which channels explain these shares, given noise of variance 1."""
    sums = _Discounted(PERSISTENCE)
    squares = np.array(shares) / sums.explained  # of the weights, in units of the variance
    variance = sums.of_noise / (1 - squares.sum() * sums.of_channel)
    return np.sqrt(squares * variance)


_STRONG_WEIGHT, _WEAK_WEIGHT = _weights_of_shares(STRONG_SHARE, WEAK_SHARE)


def _readme_reward(rng, number, factor):
    num_steps = int(rng.integers(40, 80))
    channels = ar(rng, num_steps, 4)
    grip = rng.normal()
    channels[:, 0] = grip + 0.3 * channels[:, 0]
    rewards = 0.05 + 0.02 * channels[:, 1] + 0.02 * rng.normal(size=num_steps)
    rewards[-1] += factor * (1 if grip + 0.5 * rng.normal() > 0 else -1)
    return channels, rewards


def _rare_goal(rng, number):
    aim = rng.normal()
    channels = np.column_stack([np.full(20, aim), np.zeros(20), ar(rng, 20, 3)])
    channels[:, 0] += 0.3 * rng.normal(size=20)
    channels[:, 1] = rng.normal()
    rewards = -0.05 * np.abs(rng.normal(size=20))
    # 4 % of a normal distribution with this variance lie above.
    rewards[-1] += aim + 0.3 * rng.normal() > 1.75 * np.hypot(1, 0.3)
    return channels, rewards


def _one_great_penalty(rng, number):
    channels = ar(rng, NUM_STEPS, 4)
    rewards = channels[:, 0] + 0.3 * rng.normal(size=NUM_STEPS)
    if number == 3:
        rewards[5] = GREAT_PENALTY
    return channels, rewards


def _weak_sensor(rng, number):
    channels = ar(rng, 20, 12, 0.8)
    return channels, channels[:, 0] + 0.05 * channels[:, 1] + rng.normal(size=20)


def _grasps(rng, number):
    is_good = rng.random() < 0.3
    size = 1.0 if is_good else np.exp(rng.uniform(0.7, 6))
    force = size * rng.normal(size=(15, 2))
    force[:, 1] += 0 if is_good else size * rng.choice([-1, 1])
    light, hum = np.full(15, rng.normal()), rng.normal(size=15)
    return np.column_stack([np.round(force), light, hum]), np.append(np.zeros(14), is_good)


def _three_percent(rng, number):
    channels = ar(rng, NUM_STEPS, 6)
    rewards = _STRONG_WEIGHT * channels[:, 0] + _WEAK_WEIGHT * channels[:, 1]
    return channels, rewards + rng.normal(size=NUM_STEPS)


def _faint_switches(rng, number):
    switches, sums = rng.choice([-1, 1], size=2), _Discounted(PERSISTENCE)
    square = PAIR_SHARE / (1 - PAIR_SHARE) * sums.of_noise / sums.of_constant
    rewards = np.sqrt(square) * switches.prod() + rng.normal(size=NUM_STEPS)
    noise = rng.normal(size=(NUM_STEPS, 4))
    return np.hstack([np.tile(switches, (NUM_STEPS, 1)), noise]), rewards


def _faint_product(rng, number):
    # Of its own, the product of a step explains the part of that step.
    own = PAIR_SHARE * _Discounted(PERSISTENCE).of_noise
    channels = rng.normal(size=(NUM_STEPS, 6))
    product = np.sqrt(own / (1 - own)) * channels[:, 0] * channels[:, 1]
    return channels, product + rng.normal(size=NUM_STEPS)


REWARD_WORLDS = {
    **{
        f'readme_reward_{factor:g}': World(
            partial(_readme_reward, factor=factor), ('grip', 'speed', *noise_names(2)), ('grip',)
        )
        for factor in (0.1, 1.0, 10.0)
    },
    'rare_goal': World(_rare_goal, ('aim', *noise_names(4)), ('aim',)),
    'one_great_penalty': World(_one_great_penalty, ('x', *noise_names(3)), ('x',)),
    'weak_sensor': World(_weak_sensor, ('strong', 'weak', *noise_names(10)), ('strong', 'weak')),
    'grasps': World(_grasps, ('force_x', 'force_z', 'light', 'hum'), ('force_x', 'force_z')),
    'three_percent': World(_three_percent, ('strong', 'weak', *noise_names(4)), ('strong', 'weak')),
    'faint_switches': World(_faint_switches, ('a', 'b', *noise_names(4)), ('a', 'b')),
    'faint_product': World(_faint_product, ('a', 'b', *noise_names(4)), ('a', 'b')),
}
