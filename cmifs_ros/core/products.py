# SPDX-License-Identifier: Apache-2.0

"""Products of residuals of the target with functions of a sensor, and their p-values."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from .chance import (
    combined_pvalue,
    combined_pvalues,
    resampled_pvalue,
    sign_flip_pvalue,
    square_pvalues,
)
from .cyclic_shifts import CyclicShifts
from .kernel_regression import corrected_residual

#: Whitening gives all directions of the functions the same weight, but for the weakest, which rest
#: on few episodes: those with less than this share of the greatest variance count less.
_LEAST_VARIANCE = 1e-2
#: The parts of the test.
PARTS = SIGNS, SHIFTS = ('signs', 'shifts')


class _Whitened(NamedTuple):
    """A family of functions (N, k) along principal axes of what the basis does not explain."""

    functions: np.ndarray
    coefficients: np.ndarray  # of the functions on the basis, (r, k)
    axes: np.ndarray  # (k, a)
    products: np.ndarray  # of each block with each residual, (B, q, a)
    statistics: np.ndarray  # (q,)


class Products:
    """Residuals of the target, to be multiplied with functions of a sensor.

    Parameters
    ----------
    left : numpy.ndarray, shape (N, q)
        Residuals, orthogonal to the basis.
    basis : numpy.ndarray, shape (N, r)
        Orthonormal columns that the given channels span.
    starts : numpy.ndarray of int, shape (M,)
        The first row of each episode.
    blocks : numpy.ndarray of int, shape (B,)
        The first row of each block of episodes whose products have one sign.
    shifts : CyclicShifts
    level : float
        p-value by signs up to which episodes are shifted as well.
    parts : collection of str
        Which of `PARTS` count.

    """

    def __init__(
        self,
        left: np.ndarray,
        basis: np.ndarray,
        starts: np.ndarray,
        blocks: np.ndarray,
        shifts: CyclicShifts,
        *,
        level: float,
        parts: Collection[str] = PARTS,
    ):
        from .episode_sums import sums_of_products

        lengths = np.diff(starts, append=len(left))
        # The deviation of an episode's sum grows faster than the root of its number of steps.
        weights = np.repeat(np.sqrt(lengths.mean() / lengths), lengths)[:, None]
        self._left = left * weights
        self._errors = corrected_residual(left, basis, blocks) * weights
        self._basis = basis
        self._in_basis = basis.T @ self._left
        self._sums_of_products = sums_of_products
        self._basis_products = sums_of_products(basis, self._errors, blocks)
        self._blocks, self._shifts, self._level, self._parts = blocks, shifts, level, parts

    def pvalues(
        self, families: Sequence[np.ndarray], variables: Sequence[Sequence[int]]
    ) -> list[float]:
        """Return the p-value of each variable of the target.

        Parameters
        ----------
        families : sequence of numpy.ndarray, shapes (N, k)
            Functions of a sensor, each family whitened by itself.
        variables : sequence of sequence of int
            The columns of the residuals that belong to each variable.

        """
        whitened = [self._whitened(functions) for functions in families]
        pvalues = []
        for columns in variables:
            pvalue = self._by_signs(whitened, columns) if SIGNS in self._parts else 0.0
            if SHIFTS in self._parts and pvalue <= self._level:
                pvalue = max(pvalue, self._by_shifts(whitened, columns))
            pvalues.append(pvalue)
        return pvalues

    def single_pvalues(
        self, functions: np.ndarray, variables: Sequence[Sequence[int]]
    ) -> list[np.ndarray]:
        """Return the p-values of functions (N, k) by themselves, by signs: (k,) of each variable.

        The parameters are as of `pvalues`.
        """
        coefficients = self._basis.T @ functions
        products = self._sums_of_products(functions, self._errors, self._blocks)
        products -= self._basis_products @ coefficients
        totals = self._left.T @ functions - self._in_basis.T @ coefficients
        found = square_pvalues(totals, products)
        return [combined_pvalues(found[columns]) for columns in variables]

    def _whitened(self, functions: np.ndarray) -> _Whitened:
        coefficients = self._basis.T @ functions
        gram = (functions.T @ functions - coefficients.T @ coefficients) / len(functions)
        variances, axes = np.linalg.eigh(gram)
        axes = axes / np.sqrt(np.maximum(variances, 0) + variances[-1] * _LEAST_VARIANCE)
        products = self._sums_of_products(functions, self._errors, self._blocks)
        products = (products - self._basis_products @ coefficients) @ axes
        total = (self._left.T @ functions - self._in_basis.T @ coefficients) @ axes
        return _Whitened(functions, coefficients, axes, products, (total**2).sum(axis=1))

    def _by_signs(self, whitened: Sequence[_Whitened], columns: Sequence[int]) -> float:
        return combined_pvalue(
            [
                sign_flip_pvalue(w.statistics[column], w.products[:, column])
                for column in columns
                for w in whitened
            ]
        )

    def _by_shifts(self, whitened: Sequence[_Whitened], columns: Sequence[int]) -> float:
        pvalues: list[float] = []
        for w in whitened:
            functions = w.functions @ w.axes - self._basis @ (w.coefficients @ w.axes)
            products = self._shifts.products(self._errors[:, columns], functions)
            drawn = (products**2).sum(axis=2)
            pvalues += map(resampled_pvalue, w.statistics[columns], drawn.T)
        return combined_pvalue(pvalues)
