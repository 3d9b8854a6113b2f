# SPDX-License-Identifier: Apache-2.0

"""Cyclic shifts of the episodes: what a sensor and other episodes have in common by chance.

The products of all shifts together are a circular cross-correlation, so the fast Fourier transform
gives all of them at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import fft

#: More shifts hardly change the moments of the statistic.
_MAX_SHIFTS = 300


class _Cells(NamedTuple):
    """Cells of the same number of episodes n: the rows (c, n) of each, and its shifts (S,)."""

    rows: np.ndarray
    shifts: np.ndarray


class CyclicShifts:
    """Shift episodes that stand in an order, step by step.

    All rows of one step and one source form a cell. In each shift a row takes the values of the row
    that comes so many episodes later in its cell, cyclically. A cell of fewer episodes is shifted
    by proportionally fewer, but at least by one. Each source goes through the shifts in an order of
    its own.

    Parameters
    ----------
    starts, lengths : numpy.ndarray of int, shape (M,)
        The first row and the number of rows of each episode.
    sources : numpy.ndarray, shape (M,)
        The source of each episode.
    order : numpy.ndarray of int, shape (M,)
        The episodes in their order.
    rng : numpy.random.Generator
        Draws the order of the shifts of all sources but the first.

    """

    def __init__(
        self,
        starts: np.ndarray,
        lengths: np.ndarray,
        sources: np.ndarray,
        order: np.ndarray,
        rng: np.random.Generator,
    ):
        longest = len(order) - 1
        by = np.linspace(1, longest, min(_MAX_SHIFTS, longest)).round().astype(int)
        self._num_shifts = len(by)
        self._cells = []
        for k, source in enumerate(np.unique(sources)):
            by_source = rng.permutation(by) if k else by
            episodes = order[sources[order] == source]
            counts = np.bincount(lengths[episodes])[::-1].cumsum()[::-1][1:]
            for count in np.unique(counts):
                steps = np.flatnonzero(counts == count)
                reach = episodes[lengths[episodes] > steps[-1]]
                rows = starts[reach] + steps[:, None]
                self._cells.append(_Cells(rows, 1 + (by_source - 1) * (count - 1) // longest))

    def products(self, residuals: np.ndarray, functions: np.ndarray) -> np.ndarray:
        """Return the sums of functions (N, k) times shifted residuals (N, q): shape (S, q, k)."""
        products = np.zeros((self._num_shifts, residuals.shape[1], functions.shape[1]))
        for rows, shifts in self._cells:
            count = rows.shape[1]
            left = fft.rfft(residuals[rows], axis=1).transpose(1, 2, 0)
            right = fft.rfft(functions[rows], axis=1).conj().transpose(1, 0, 2)
            products += fft.irfft(left @ right, n=count, axis=0)[shifts % count]
        return products
