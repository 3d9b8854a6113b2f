# SPDX-License-Identifier: Apache-2.0

"""The held-out objective of LSMI over a grid of widths and regularisations, compiled.

J of Equation (7) of Hachiya & Sugiyama (2010), for one time step and many channel subsets.
What makes it fast, and why each part is exact:

- A Gaussian of (eta, z) is a Gaussian of eta times one of z, so the double sums over pairs of
  samples are products of single sums: H = (K_eta' K_eta) * (K_z' K_z) / M^2, elementwise.
- The Gram matrices of the folds add up to that of all samples, and training on all folds but
  one subtracts that one.
- All subsets share the returns, and the squared distances of the channels they have in common.
- A shift leaves the Krylov space of (H, h) unchanged, so one Lanczos run serves all
  regularisations (Golub & Van Loan, Matrix Computations, 10.3). Each vector is orthogonalised
  against all earlier ones, which makes the solutions exact to `_RTOL`.
- Matrix-vector products and exponentials are written out, so that they compile to vector
  instructions. For products this small a BLAS call takes longer, and the library's exp is scalar.
"""

from __future__ import annotations

import numpy as np
from numba import njit

#: Residual of the linear systems, relative to h. With 1e-9 scores of a step were off by up to 1e-8.
_RTOL = 1e-10
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
        The samples with a kernel.
    common : numpy.ndarray of int, shape (k,)
        The channels common to all subsets.
    own : numpy.ndarray of int, shape (C, j)
        The other channels of each subset, padded with -1.
    widths : numpy.ndarray, shape (W,)
    regularizations : numpy.ndarray, shape (L,)
        Positive lambdas.

    Returns
    -------
    numpy.ndarray, shape (C, W, L)

    """
    num_samples, size, num_folds = len(returns), len(centers), len(starts) - 1
    eta_distances = np.zeros((num_samples, size))
    _add_distances(returns, centers, eta_distances)
    shared = np.zeros((num_samples, size))
    for channel in common:
        _add_distances(states[:, channel], centers, shared)
    distances = np.empty((len(own), num_samples, size))
    for c in range(len(own)):
        distances[c] = shared
        for channel in own[c]:
            if channel >= 0:
                _add_distances(states[:, channel], centers, distances[c])

    objective = np.zeros((len(own), len(widths), len(regularizations)))
    k_eta, k_z = np.empty((num_samples, size)), np.empty((num_samples, size))
    eta_train = np.empty((num_folds, size, size))
    eta_test = np.empty((num_folds, size, size))
    z_test, z_total = np.empty((num_folds, size, size)), np.empty((size, size))
    h_test, h_total = np.empty((num_folds, size)), np.empty(size)
    for w in range(len(widths)):
        factor = -0.5 / widths[w] ** 2
        _gaussians(eta_distances, factor, k_eta)
        for f in range(num_folds):
            part = k_eta[starts[f] : starts[f + 1]]
            np.dot(part.T, part, eta_test[f])
        eta_total = eta_test.sum(axis=0)
        for f in range(num_folds):
            held_out = starts[f + 1] - starts[f]
            eta_train[f] = (eta_total - eta_test[f]) / (num_samples - held_out) ** 2
            eta_test[f] /= held_out**2
        for c in range(len(own)):
            _gaussians(distances[c], factor, k_z)
            z_total[:] = 0.0
            h_test[:] = 0.0
            h_total[:] = 0.0
            for f in range(num_folds):
                part = k_z[starts[f] : starts[f + 1]]
                np.dot(part.T, part, z_test[f])
                for m in range(starts[f], starts[f + 1]):
                    for b in range(size):
                        h_test[f, b] += k_eta[m, b] * k_z[m, b]
                z_total += z_test[f]
                h_total += h_test[f]
            for f in range(num_folds):
                held_out = starts[f + 1] - starts[f]
                alphas = _solutions(
                    (z_total - z_test[f]) * eta_train[f],
                    (h_total - h_test[f]) / (num_samples - held_out),
                    regularizations,
                )
                images = np.dot(alphas, z_test[f] * eta_test[f])
                for i in range(len(alphas)):
                    total = 0.0
                    for b in range(size):
                        total += alphas[i, b] * (0.5 * images[i, b] - h_test[f, b] / held_out)
                    objective[c, w, i] += total / num_folds
    return objective


@njit(**_COMPILED)
def _add_distances(values, centers, distances):
    """Add the squared distances of values (M,) to those at the centres to distances (M, B)."""
    for m in range(len(values)):
        for b in range(len(centers)):
            difference = values[m] - values[centers[b]]
            distances[m, b] += difference * difference


@njit(**_COMPILED)
def _gaussians(distances, factor, out):
    """Set out to exp(factor * distances), with an absolute error below 1e-13.

    The argument is divided by 256, where a short Taylor series is accurate; the sum is then
    squared 8 times.
    """
    flat, flat_out = distances.reshape(-1), out.reshape(-1)
    for i in range(len(flat)):
        x = max(flat[i] * (factor / 256), -3.0)
        tail = x * (1 / 120 + x * (1 / 720 + x * (1 / 5040 + x / 40320)))
        value = 1 + x * (1 + x * (1 / 2 + x * (1 / 6 + x * (1 / 24 + tail))))
        for _ in range(8):
            value *= value
        flat_out[i] = value


@njit(**_COMPILED)
def _solutions(matrix, h, regularizations):
    """Return (matrix + lambda I)^-1 h for each lambda: shape (L, B)."""
    norm = np.sqrt(_dot(h, h))
    if norm < 1e-150:  # No kernel reaches any sample: the model is 0.
        return np.zeros((len(regularizations), len(h)))
    basis, diagonal, coupling = _lanczos(matrix, h / norm, regularizations.min())
    # Solve the tridiagonal systems from below: only the first row has a right-hand side.
    weights = np.empty((len(diagonal), len(regularizations)))
    for k in range(len(diagonal) - 1, -1, -1):
        for i in range(len(regularizations)):
            weights[k, i] = diagonal[k] + regularizations[i]
            if k < len(diagonal) - 1:
                weights[k, i] -= coupling[k] ** 2 / weights[k + 1, i]
    weights[0] = norm / weights[0]
    for k in range(1, len(diagonal)):
        for i in range(len(regularizations)):
            weights[k, i] = -coupling[k - 1] * weights[k - 1, i] / weights[k, i]
    return np.dot(weights.T, basis)


@njit(**_COMPILED)
def _lanczos(matrix, start, shift):
    """Return a Krylov space of a unit vector (B,), large enough to solve the shifted system.

    The result is an orthonormal basis (k, B) and the matrix in this basis, which is tridiagonal:
    its diagonal (k,) and its off-diagonal (k,), whose last entry leads out of the space. The unit
    vector is overwritten.
    """
    size = len(start)
    basis, numbers = np.empty((size, size)), np.empty((3, size))
    diagonal, coupling, components = numbers[0], numbers[1], numbers[2]
    vector, length, scale, count = start, 1.0, 0.0, 0
    pivot, last = np.inf, -1.0  # of the elimination; last component of the solution
    while True:
        k = count
        count += 1
        for b in range(size):
            basis[k, b] = vector[b] / length
        _multiply(matrix, basis[k], vector)
        _multiply(basis[:count], vector, components)
        for i in range(count):
            for b in range(size):
                vector[b] -= components[i] * basis[i, b]
        diagonal[k] = components[k]
        pivot = diagonal[k] + shift - length**2 / pivot
        last *= -length / pivot
        coupling[k] = length = np.sqrt(_dot(vector, vector))
        scale = max(scale, diagonal[k])
        # Below rounding error the Krylov space is complete.
        if count == size or length <= 1e-15 * scale or length * abs(last) <= _RTOL:
            return basis[:count], diagonal[:count], coupling[:count]


@njit(**_COMPILED)
def _multiply(matrix, vector, out):
    """Set out to matrix @ vector, four rows at a time."""
    whole = len(matrix) - len(matrix) % 4
    for i in range(0, whole, 4):
        p = q = r = s = 0.0
        for b in range(len(vector)):
            p += matrix[i, b] * vector[b]
            q += matrix[i + 1, b] * vector[b]
            r += matrix[i + 2, b] * vector[b]
            s += matrix[i + 3, b] * vector[b]
        out[i], out[i + 1], out[i + 2], out[i + 3] = p, q, r, s
    for i in range(whole, len(matrix)):
        out[i] = _dot(matrix[i], vector)


@njit(**_COMPILED)
def _dot(a, b):
    """Return a @ b."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total
