# SPDX-License-Identifier: Apache-2.0

"""Episodes from which a selection takes seconds, on a fast machine too."""

import numpy as np

from cmifs_ros.core import Episode

SLOW_NAMES = [f'channel_{i}' for i in range(100)]


def slow_episodes(count, seed=0):
    """Return episodes of many channels, of which the reward depends on the first."""
    states = np.random.default_rng(seed).normal(size=(count, 20, len(SLOW_NAMES)))
    return [Episode(of_episode, of_episode[:, 0]) for of_episode in states]
