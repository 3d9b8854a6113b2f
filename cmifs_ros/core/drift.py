# SPDX-License-Identifier: Apache-2.0

"""Slow drift over the episodes: a policy learns, a floor gets wet, a motor warms up.

If a task drifts, the returns of neighbouring episodes resemble each other, and so do the readings
of any slow sensor, related or not. So slow functions of the episode's number are regressed out, as
in functional MRI (Friston et al., To smooth or not to smooth?, 2000): the number, its normal score,
which a steady drift of a channel becomes, and slow cosines. Akaike's criterion for small samples
(Hurvich & Tsai 1989), with a higher price, chooses how many; for independent episodes, mostly none.
"""

from __future__ import annotations

import numpy as np
from scipy import special

_NUM_TRENDS = (0, 2, 4, 8)
#: Price of a function; 2, as by Akaike, removes too much from data without drift.
_PRICE = 3.0


def cosines(place: np.ndarray, count: int) -> np.ndarray:
    """Return the slowest cosines of places (N,) between 0 and 1, shape (N, count)."""
    return np.cos(np.pi * np.outer(place, np.arange(1, count + 1)))


def trends(num_episodes: int, count: int) -> np.ndarray:
    """Return slow functions of the episode's number, shape (num_episodes, count)."""
    place = (np.arange(num_episodes) + 0.5) / num_episodes
    return np.column_stack([place - 0.5, special.ndtri(place), cosines(place, count)])[:, :count]


def num_trends(means: np.ndarray, weights: np.ndarray) -> int:
    """Return the number of trends in columns of episode means (M, k), weighted by (M,)."""
    root = np.sqrt(weights)[:, None]
    best, least = 0, np.inf
    for count in _NUM_TRENDS:
        if count > len(means) // 4:
            break
        left = _detrended(means, root, count)
        squares = np.maximum((left**2).sum(axis=0), np.finfo(float).tiny)
        cost = np.log(squares).mean() + _PRICE * count / max(len(means) - count - 1, 1)
        if cost < least:
            best, least = count, cost
    return best


def share_of_drift(means: np.ndarray, weights: np.ndarray) -> float:
    """Return the share of the variance of episode means (M,) that is slow drift."""
    root, columns = np.sqrt(weights)[:, None], means[:, None]
    left = _detrended(columns, root, num_trends(columns, weights))
    total = (_detrended(columns, root, 0) ** 2).sum()
    return float(1 - (left**2).sum() / total) if total > 0 else 0.0


def independent_episodes(means: np.ndarray) -> float:
    """Return the number of independent episodes that episodes with these means (M,) count as.

    This is their number divided by the integrated autocorrelation time, whose sum is cut where two
    neighbouring autocorrelations have a negative sum (Geyer, Practical Markov chain Monte Carlo,
    1992). It is M unless neighbours correlate by more than three standard errors of white noise.
    """
    means = means - means.mean()
    count, variance = len(means), means @ means
    if means[1:] @ means[:-1] <= 3 / np.sqrt(count) * variance:
        return float(count)
    padded = np.fft.rfft(means, 2 * count)
    correlations = np.fft.irfft(padded * padded.conj())[:count] / variance
    pairs = correlations[: count // 2 * 2].reshape(-1, 2).sum(axis=1)
    cut = int(np.argmax(pairs <= 0)) if (pairs <= 0).any() else len(pairs)
    time = max(2 * pairs[:cut].sum() - 1, 1.0)
    return float(max(count / time, 1.0))


def _detrended(means, root, count):
    columns = np.column_stack([np.ones(len(means)), trends(len(means), count)]) * root
    basis = np.linalg.qr(columns)[0]
    return root * means - basis @ (basis.T @ (root * means))
