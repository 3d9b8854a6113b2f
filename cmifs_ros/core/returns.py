# SPDX-License-Identifier: Apache-2.0

"""The discounted return: the rewards of a step and of the later steps of its episode."""

from __future__ import annotations

import numpy as np


def discounted_returns(rewards: np.ndarray, gamma: float) -> np.ndarray:
    """Return eta_t = sum_{t' >= t} gamma^(t' - t) r_t' within one episode.

    Equation (4) of Hachiya & Sugiyama (2010).

    Parameters
    ----------
    rewards : array_like, shape (T,)
        Rewards of the steps in temporal order.
    gamma : float
        Discount factor, 0 < gamma <= 1.

    Returns
    -------
    numpy.ndarray, shape (T,)

    Raises
    ------
    ValueError
        If gamma lies outside (0, 1].

    """
    if not 0 < gamma <= 1:
        raise ValueError(f'gamma is {gamma}; expected 0 < gamma <= 1')
    returns = np.array(rewards, dtype=np.float64)
    with np.errstate(over='ignore'):  # An overflowing return becomes infinite.
        for t in range(len(returns) - 2, -1, -1):
            returns[t] += gamma * returns[t + 1]
    return returns
