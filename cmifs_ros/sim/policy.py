# SPDX-License-Identifier: Apache-2.0

"""The stochastic policy of Hachiya & Sugiyama (2010), Section 4.1."""

from __future__ import annotations

import numpy as np

from .grid_world import DOWN, MOVES, RIGHT, UP

PREFERRED_PROBABILITY = 0.7
OTHER_PROBABILITY = 0.1


def preferred_action(state: np.ndarray) -> int:
    """Return a*: right, except along the wall in column 4 towards the gap at rows 5 and 6."""
    column, row = state[0], state[1]
    if column == 4 and row <= 4:
        return DOWN
    if column == 4 and row >= 7:
        return UP
    return RIGHT


def sample_action(state: np.ndarray, rng: np.random.Generator) -> int:
    """Draw a* with probability 0.7 and each other action with probability 0.1."""
    probabilities = np.full(len(MOVES), OTHER_PROBABILITY)
    probabilities[preferred_action(state)] = PREFERRED_PROBABILITY
    return int(rng.choice(len(MOVES), p=probabilities))
