# SPDX-License-Identifier: Apache-2.0

"""Sums over episodes, compiled. Import it where it is used: Numba takes long to import."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, fastmath={'contract', 'reassoc', 'nsz', 'arcp'})
def sums_of_products(functions, residuals, starts):
    """Return the sums over each episode of residuals (N, q) times functions (N, k): (M, q, k)."""
    sums = np.zeros((len(starts), residuals.shape[1], functions.shape[1]))
    episode = -1
    for row in range(len(functions)):
        if episode + 1 < len(starts) and starts[episode + 1] == row:
            episode += 1
        for q in range(residuals.shape[1]):
            value = residuals[row, q]
            for k in range(functions.shape[1]):
                sums[episode, q, k] += value * functions[row, k]
    return sums
