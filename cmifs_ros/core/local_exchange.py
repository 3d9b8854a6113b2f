"""Who takes whose value among neighbours, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def pick(points, jitter, priority, num_neighbours):
    """Return for each point one of its nearest, each used once where possible.

    Parameters
    ----------
    points : numpy.ndarray, shape (M, d)
    jitter : numpy.ndarray, shape (count, M, M)
        Uniform numbers that decide between equal distances and among the nearest.
    priority : numpy.ndarray, shape (count, M)
        The points choose in the order of these numbers.
    num_neighbours : int

    Returns
    -------
    numpy.ndarray of int, shape (count, M)

    """
    count, num_points = priority.shape
    distances = np.empty((num_points, num_points))
    for i in range(num_points):
        for j in range(num_points):
            total = 0.0
            for c in range(points.shape[1]):
                total += (points[i, c] - points[j, c]) ** 2
            distances[i, j] = total
    picked = np.empty((count, num_points), np.int64)
    k = min(num_neighbours, num_points - 1)
    for shadow in range(count):
        used = np.zeros(num_points, np.bool_)
        for i in np.argsort(priority[shadow]):
            row = distances[i] + 1e-9 * jitter[shadow, i]
            row[i] = np.inf
            nearest = np.argsort(row)[:k]
            order = np.argsort(jitter[shadow, i][nearest])
            choice = nearest[order[0]]
            for candidate in nearest[order]:
                if not used[candidate]:
                    choice = candidate
                    break
            used[choice] = True
            picked[shadow, i] = choice
    return picked
