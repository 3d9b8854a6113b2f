# SPDX-License-Identifier: Apache-2.0

"""How large a quadratic statistic becomes by chance, and several p-values in one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special

#: Greater p-values count as this one when several are combined: one near 1 would outweigh all.
_GREATEST = 0.95


def sign_flip_pvalue(statistic: float, products: np.ndarray) -> float:
    """Return the p-value of a statistic if the sign of each block's products were random.

    By chance it is the squared length of a sum of the products with random signs (the wild cluster
    bootstrap: Cameron, Gelbach & Miller, Bootstrap-based improvements for inference with clustered
    errors, 2008). Its first three moments have a closed form; a Pearson III law with these gives
    the tail. If no sign can change the statistic, the p-value is 1.

    Parameters
    ----------
    statistic : float
    products : numpy.ndarray, shape (M, k)
        One row for each block of episodes.

    """
    # With B the products and s the signs the statistic is s'BB's; its diagonal is constant.
    own = (products * products).sum(axis=1)
    gram = products.T @ products
    mean = own.sum()
    variance = 2 * ((gram * gram).sum() - own @ own)
    if variance <= 1e-12 * mean**2:
        return 1.0
    crossed = ((products @ gram) * products).sum(axis=1)
    third = 8 * ((gram @ gram * gram).sum() - 3 * own @ crossed + 2 * (own**3).sum())
    return pearson3_tail((statistic - mean) / np.sqrt(variance), third / variance**1.5)


def resampled_pvalue(statistic: float, drawn: np.ndarray) -> float:
    """Return the p-value of a statistic that was drawn by chance n times, shape (n,).

    A Pearson III law with the moments of those drawn gives the tail (Winkler et al., Faster
    permutation inference in brain imaging, 2016). If chance cannot change it, the p-value is 1.
    """
    mean, spread = drawn.mean(), drawn.std()
    if spread <= 1e-12 * mean:
        return 1.0
    skewness = float(np.mean(((drawn - mean) / spread) ** 3))
    return pearson3_tail((statistic - mean) / spread, skewness)


def square_pvalues(totals: np.ndarray, products: np.ndarray) -> np.ndarray:
    """Return the p-value of the square of each of many sums, as `sign_flip_pvalue` of one column.

    Parameters
    ----------
    totals : numpy.ndarray, shape (...)
    products : numpy.ndarray, shape (M, ...)
        One row for each block of episodes.

    """
    squares = products**2
    second, fourth, sixth = (np.sum(squares**power, axis=0) for power in (1, 2, 3))
    variance = 2 * (second**2 - fourth)
    has_chance = variance > 1e-12 * second**2
    spread = np.sqrt(np.where(has_chance, variance, 1.0))
    # So small a skewness makes no difference to that of a normal law, 0.
    skewness = np.maximum(8 * (second**3 - 3 * second * fourth + 2 * sixth) / spread**3, 1e-3)
    shape = 4 / skewness**2
    drawn = np.maximum(shape + 2 * (totals**2 - second) / (spread * skewness), 0)
    return np.where(has_chance, special.gammaincc(shape, drawn), 1.0)


def combined_pvalue(pvalues: Sequence[float]) -> float:
    """Return one p-value for all, however they depend on each other; 1 of none."""
    return float(combined_pvalues(np.asarray(pvalues, dtype=float)))


def combined_pvalues(pvalues: np.ndarray) -> np.ndarray:
    """Return one p-value for each column of p-values (n, ...): shape (...).

    The mean in the scale of a Cauchy variable (Liu & Xie, Cauchy combination test, 2020).
    """
    least = pvalues.min(axis=0, initial=1.0)
    scores = 1 / np.tan(np.pi * np.clip(pvalues, 1e-300, _GREATEST))
    mean = scores.sum(axis=0) / max(len(pvalues), 1)
    return np.where(least > _GREATEST, least, np.arctan2(1, mean) / np.pi)


def pearson3_tail(value: float, skewness: float) -> float:
    """Return scipy.stats.pearson3.sf(value, skewness); its module takes long to import."""
    if abs(skewness) < 1e-3:
        return float(special.ndtr(-value))
    shape = 4 / skewness**2
    drawn = max(shape + 2 * value / skewness, 0.0)
    tail = special.gammaincc if skewness > 0 else special.gammainc
    return float(tail(shape, drawn))
