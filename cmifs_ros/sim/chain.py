# SPDX-License-Identifier: Apache-2.0

"""The chain of Figures 1 and 2 of Hachiya & Sugiyama (2010): s3 -> s2 -> s1 -> reward.

Each arrow between channels takes one step. So s3 determines the reward two steps later, and affects
s1, on which the reward depends, only through s2. s4 is irrelevant. A criterion that looks one step
ahead of s1 finds s1 and s2; a criterion based on the return also finds s3.
"""

from __future__ import annotations

import itertools

import numpy as np

from cmifs_ros.core import Episode

CHANNEL_NAMES = ('s1', 's2', 's3', 's4')
NUM_STEPS = 5
#: Share of s1 that persists to the next step, so that KDR finds s1 itself, as in the paper.
PERSISTENCE = 0.5
#: Standard deviation of the noise in s1 and s2; s3 and s4 are pure noise.
NOISE = 0.3


def rollout_chain(num_episodes: int, seed: int) -> list[Episode]:
    """Return episodes of 5 steps, bit for bit the same for the same seed.

    s1 at n + 1 is half of s1 at n plus s2 at n, and s2 at n + 1 is s3 at n, both with some noise.
    s3 and s4 are drawn anew at each step. The reward of a step is s1.

    Parameters
    ----------
    num_episodes : int
    seed : int

    """
    rng = np.random.default_rng(seed)
    episodes = []
    for _ in range(num_episodes):
        states = rng.normal(size=(NUM_STEPS, len(CHANNEL_NAMES)))
        for before, after in itertools.pairwise(states):
            after[0] = PERSISTENCE * before[0] + before[1] + NOISE * after[0]
            after[1] = before[2] + NOISE * after[1]
        episodes.append(Episode(states, states[:, 0]))
    return episodes
