"""The return: what a step leads to, not only what it pays."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter


def discounted_returns(rewards: np.ndarray, gamma: float) -> np.ndarray:
    """Return eta_t = sum_{t' >= t} gamma^(t' - t) r_t' within one episode.

    Equation (4) of Hachiya & Sugiyama (2010).

    Parameters
    ----------
    rewards : array_like, shape (T,)
        Rewards of the steps, in the order of time.
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
    # Backwards in time it is the recursion eta_t = r_t + gamma eta_{t+1}.
    return lfilter([1.0], [1.0, -gamma], np.asarray(rewards, dtype=np.float64)[::-1])[::-1]
