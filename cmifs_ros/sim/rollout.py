# SPDX-License-Identifier: Apache-2.0

"""Roll out the paper's policy in the grid world."""

from __future__ import annotations

import numpy as np

from cmifs_ros.core import Episode

from .grid_world import GridWorld
from .policy import sample_action


def rollout(
    scenario: str, num_episodes: int, seed: int, make_world: type[GridWorld] = GridWorld
) -> list[Episode]:
    """Return episodes of 20 steps, bit for bit the same for the same seed.

    They have no actions, because the paper's criterion does not use them.

    Parameters
    ----------
    scenario : {'without_gravel', 'with_gravel'}
    num_episodes : int
    seed : int
        Seed of the world and, independently, of the policy.
    make_world : type
        The class of the world, if it is a variant.

    """
    world_seed, policy_seed = np.random.SeedSequence(seed).spawn(2)
    world = make_world(scenario, seed=world_seed)
    rng = np.random.default_rng(policy_seed)
    episodes = []
    for _ in range(num_episodes):
        states, rewards = [], []
        state, _ = world.reset()
        truncated = False
        while not truncated:
            states.append(state)
            state, reward, _, truncated, _ = world.step(sample_action(state, rng))
            rewards.append(reward)
        episodes.append(Episode(states, rewards))
    return episodes
