# SPDX-License-Identifier: Apache-2.0

"""Effect sizes: the share of the target's variance that a sensor predicts beyond others."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import special

from .kernel_regression import corrected_residual, residual

#: Directions with less than this share of the greatest variance are left out: they add noise.
_LEAST_VARIANCE = 1e-2


class Effect(NamedTuple):
    """Share of the target's variance that a sensor adds, and its standard error.

    The estimate is unbiased, so it is negative half of the time for an uninformative sensor.
    """

    share: float
    error: float

    @property
    def low(self) -> float:
        """Lower end of the 95 % confidence interval."""
        return self.share + special.ndtri(0.025) * self.error

    @property
    def high(self) -> float:
        """Upper end of the 95 % confidence interval."""
        return self.share + special.ndtri(0.975) * self.error

    @property
    def upper_bound(self) -> float:
        """Upper bound of the share, with 95 % confidence."""
        return self.share + special.ndtri(0.95) * self.error


class EffectEstimator:
    """Estimate what functions of a sensor add to the prediction of a target.

    Parameters
    ----------
    target : numpy.ndarray, shape (N,)
        With mean 0 and variance 1.
    basis : numpy.ndarray, shape (N, r)
        Orthonormal columns that predict the target from the given variables.
    starts : numpy.ndarray of int, shape (M,)
        The first row of each episode, or of each block of episodes that depend on each other.

    """

    def __init__(self, target: np.ndarray, basis: np.ndarray, starts: np.ndarray):
        self._left = residual(target[:, None], basis)
        self._errors = corrected_residual(self._left, basis, starts)
        self._basis, self._starts = basis, starts
        self._squares = np.add.reduceat(target**2, starts)

    def effect(self, functions: np.ndarray) -> Effect:
        """Return the share of the target's variance that functions (N, k) add.

        With coefficients b on functions of variance 1 that are orthogonal to the basis, the share
        is b'b. The square of each episode's own part of b is left out, so that noise adds nothing
        on average (a U-statistic, Hoeffding 1948). Its variance is that of the episodes' influence
        on the share, plus the part that remains at a share of 0.
        """
        from .episode_sums import sums_of_products

        if not functions.size:
            return Effect(0.0, 0.0)
        functions = self._own(functions)
        coefficients = functions.T @ self._left[:, 0] / len(functions)
        parts = sums_of_products(functions, self._errors, self._starts)[:, 0] / len(functions)
        share = coefficients @ coefficients - (parts * parts).sum()
        predicted = functions @ coefficients
        gains = 2 * predicted * self._left[:, 0] - predicted**2
        influence = np.add.reduceat(gains, self._starts) - share * self._squares
        influence = (influence - influence.mean()) / len(functions)
        parts = parts - parts.mean(axis=0)
        gram, own = parts.T @ parts, (parts * parts).sum(axis=1)
        at_zero = 2 * ((gram * gram).sum() - own @ own)
        return Effect(float(share), float(np.sqrt(max(at_zero, 0.0) + influence @ influence)))

    def added(self, functions: np.ndarray) -> np.ndarray:
        """Return what functions (N, k) add to the prediction of the target in each row: (N,)."""
        if not functions.size:
            return np.zeros(len(self._left))
        functions = self._own(functions)
        return functions @ (functions.T @ self._left[:, 0]) / len(functions)

    def _own(self, functions: np.ndarray) -> np.ndarray:
        """Return orthogonal columns of variance 1 that span what the basis leaves of functions."""
        functions = residual(functions, self._basis)
        variances, axes = np.linalg.eigh(functions.T @ functions / len(functions))
        kept = variances > _LEAST_VARIANCE * variances[-1]
        return functions @ (axes[:, kept] / np.sqrt(variances[kept]))

    def pair_bounds(self, own: np.ndarray) -> np.ndarray:
        """Return upper bounds, with 95 % confidence, for products of two columns (N, k): (k, k).

        Each bound is for one pair, like `Effect.upper_bound`.
        """
        num_columns, weighted = own.shape[1], own * self._errors
        total, squares, fourth = (np.zeros((num_columns, num_columns)) for _ in range(3))
        for rows in np.split(np.arange(len(own)), self._starts[1:]):
            part = own[rows].T @ weighted[rows] / len(own)
            total += part
            squares += part**2
            fourth += part**4
        variances = np.maximum((own**2).T @ own**2 / len(own), np.finfo(float).tiny)
        shares = (total**2 - squares) / variances
        errors = np.sqrt(np.maximum(2 * (squares**2 - fourth), 0)) / variances
        return shares + special.ndtri(0.95) * errors
