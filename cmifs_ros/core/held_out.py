"""The held-out objective of LSMI over a grid of widths and regularisations, compiled.

J of Equation (7) of Hachiya & Sugiyama (2010), for one time step and many channel subsets.
What makes it fast, and why each is exact:

- A Gaussian of (eta, z) is a Gaussian of eta times one of z, so the double sums over pairs of
  samples are products of single sums: H = (K_eta' K_eta) * (K_z' K_z) / M^2, elementwise.
- The Gram matrices of the folds add up to that of all samples, and training on all folds but
  one subtracts that one.
- All subsets share the returns, and the squared distances of the channels they have in common.
- A shift leaves the Krylov space of (H, h) unchanged, so one Lanczos run serves all
  regularisations (Golub & Van Loan, Matrix Computations, 10.3). Each vector is orthogonalised
  against all earlier ones, which makes the solutions exact to `_RTOL`.
- The held-out H is needed on the Krylov space only.
"""

from __future__ import annotations

import numpy as np
from numba import njit

#: Residual of the systems, relative to h.
_RTOL = 1e-9
_COMPILED = {'cache': True, 'nogil': True, 'fastmath': {'contract', 'reassoc', 'nsz', 'arcp'}}


@njit(**_COMPILED)
def held_out_objective(returns, states, starts, centers, common, own, widths, regularizations):
    """Return J, averaged over the held-out folds.

    Parameters
    ----------
    returns : numpy.ndarray, shape (M,)
        Samples ordered by fold.
    states : numpy.ndarray, shape (M, v)
    starts : numpy.ndarray of int, shape (F + 1,)
        Where each fold begins, and M.
    centers : numpy.ndarray of int, shape (B,)
        The samples that carry a kernel.
    common : numpy.ndarray of int, shape (k,)
        The channels that all subsets have.
    own : numpy.ndarray of int, shape (C, j)
        The further channels of each subset; -1 stands for none.
    widths : numpy.ndarray, shape (W,)
    regularizations : numpy.ndarray, shape (L,)
        Positive lambdas.

    Returns
    -------
    numpy.ndarray, shape (C, W, L)

    """
    num_samples, size = len(returns), len(centers)
    num_folds, num_lambdas = len(starts) - 1, len(regularizations)
    objective = np.zeros((len(own), len(widths), num_lambdas))
    eta_distances = np.empty((num_samples, size))
    shared = np.zeros((num_samples, size))
    for m in range(num_samples):
        for b in range(size):
            difference = returns[m] - returns[centers[b]]
            eta_distances[m, b] = difference * difference
            for channel in common:
                difference = states[m, channel] - states[centers[b], channel]
                shared[m, b] += difference * difference
    distances = np.empty((len(own), num_samples, size))
    for c in range(len(own)):
        for m in range(num_samples):
            for b in range(size):
                total = shared[m, b]
                for channel in own[c]:
                    if channel >= 0:
                        difference = states[m, channel] - states[centers[b], channel]
                        total += difference * difference
                distances[c, m, b] = total

    k_z = np.empty((num_samples, size))
    eta_grams = np.empty((num_folds, size, size))
    z_grams = np.empty((num_folds, size, size))
    h = np.empty((num_folds, size))
    train = np.empty((size, size))
    test = np.empty((size, size))
    for w in range(len(widths)):
        factor = -0.5 / widths[w] ** 2
        k_eta = np.exp(eta_distances * factor)
        for f in range(num_folds):
            part = k_eta[starts[f] : starts[f + 1]]
            eta_grams[f] = np.dot(part.T, part)
        eta_total = eta_grams.sum(axis=0)
        for c in range(len(own)):
            for m in range(num_samples):
                for b in range(size):
                    k_z[m, b] = np.exp(distances[c, m, b] * factor)
            h[:] = 0.0
            for f in range(num_folds):
                part = k_z[starts[f] : starts[f + 1]]
                z_grams[f] = np.dot(part.T, part)
                for m in range(starts[f], starts[f + 1]):
                    for b in range(size):
                        h[f, b] += k_eta[m, b] * k_z[m, b]
            z_total = z_grams.sum(axis=0)
            h_total = h.sum(axis=0)
            for f in range(num_folds):
                held_out = starts[f + 1] - starts[f]
                rest = num_samples - held_out
                for i in range(size):
                    for j in range(size):
                        test[i, j] = z_grams[f, i, j] * eta_grams[f, i, j] / held_out**2
                        train[i, j] = (
                            (z_total[i, j] - z_grams[f, i, j])
                            * (eta_total[i, j] - eta_grams[f, i, j])
                            / rest**2
                        )
                objective[c, w] += (
                    _fold_objective(
                        train, (h_total - h[f]) / rest, test, h[f] / held_out, regularizations
                    )
                    / num_folds
                )
    return objective


@njit(**_COMPILED)
def _fold_objective(train, h_train, test, h_test, regularizations):
    """Return alpha' H alpha / 2 - h' alpha on the test fold for each lambda: shape (L,)."""
    size, num_lambdas = len(h_train), len(regularizations)
    objective = np.zeros(num_lambdas)
    norm = np.sqrt(_dot(h_train, h_train))
    if norm < 1e-150:  # No Gaussian reaches any sample: the model is 0.
        return objective
    basis = np.empty((size, size))
    image = np.empty((size, size))  # of the basis under the test matrix
    quadratic = np.empty((size, size))
    linear = np.empty(size)
    diagonal, coupling = np.empty(size), np.empty(size)
    pivots, forward = np.empty((size, num_lambdas)), np.empty((size, num_lambdas))
    vector = h_train / norm
    worst = np.argmin(regularizations)
    count, scale = 0, 0.0
    while True:
        k = count
        basis[k] = vector
        column = np.dot(train, vector)
        for i in range(k, -1, -1):
            component = _dot(basis[i], column)
            if i == k:
                diagonal[k] = component
            for b in range(size):
                column[b] -= component * basis[i, b]
        for i in range(num_lambdas):
            pivots[k, i] = diagonal[k] + regularizations[i]
            forward[k, i] = norm
            if k:
                ratio = coupling[k - 1] / pivots[k - 1, i]
                pivots[k, i] -= ratio * coupling[k - 1]
                forward[k, i] = -ratio * forward[k - 1, i]
        image[k] = np.dot(test, basis[k])
        for i in range(k + 1):
            quadratic[i, k] = quadratic[k, i] = _dot(basis[i], image[k])
        linear[k] = _dot(basis[k], h_test)
        count = k + 1
        coupling[k] = np.sqrt(_dot(column, column))
        scale = max(scale, diagonal[k])
        residual = coupling[k] * abs(forward[k, worst] / pivots[k, worst])
        # Below rounding the Krylov space is complete.
        is_complete = count == size or coupling[k] <= 1e-15 * scale
        if is_complete or residual <= _RTOL * norm:
            break
        vector = column / coupling[k]
    weights = np.empty(count)
    for i in range(num_lambdas):
        weights[count - 1] = forward[count - 1, i] / pivots[count - 1, i]
        for k in range(count - 2, -1, -1):
            weights[k] = (forward[k, i] - coupling[k] * weights[k + 1]) / pivots[k, i]
        total = 0.0
        for a in range(count):
            row = 0.0
            for b in range(count):
                row += quadratic[a, b] * weights[b]
            total += weights[a] * (0.5 * row - linear[a])
        objective[i] = total
    return objective


@njit(**_COMPILED)
def _dot(a, b):
    """Return the product of two short vectors, for which a call of BLAS is too long a way."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total
