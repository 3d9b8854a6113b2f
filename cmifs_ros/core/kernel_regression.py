# SPDX-License-Identifier: Apache-2.0

"""Least squares in the leading directions of a Gaussian kernel's features.

Gaussians around some of the points, and the points themselves, are reduced to their first
principal components, as many as cross-validation asks for (kernel principal component regression:
Rosipal, Girolami, Trejo & Cichocki, 2001). The fit is a projection: what it leaves of one variable
is orthogonal to all that it could explain of another (Frisch & Waugh 1933, Lovell 1963). A ridge
leaves some of what it should explain in both, and their product then looks like dependence.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

#: Kernel widths, in standard deviations of a channel times the root of their number.
_WIDTHS = (0.3, 0.6, 1.2, 2.4, 5.0)
_RANKS = np.array([0, 1, 2, 3, 4, 6, 8, 11, 16, 23, 32, 45, 64, 90, 128, 181])
#: Directions of less variance, as a share of the greatest, are rounding errors.
_LEAST_VARIANCE = 1e-7
#: What a single episode decides has no fit to the others; this keeps their equations solvable.
_LEAST_LEFT = 1e-6


#: Share of a column's length below which what another basis leaves of it is a rounding error.
_LEAST_NEW = 1e-6


class Space(NamedTuple):
    """A space of functions of the points, by the indices of its width and of its rank."""

    width: int
    rank: int


class _Fold(NamedTuple):
    """What the other folds give, and the moments of the one left out."""

    rows: np.ndarray
    variances: np.ndarray
    directions: np.ndarray
    mean: np.ndarray
    gram: np.ndarray
    total: np.ndarray


class KernelRegression:
    """Regress any number of targets on the same points.

    Parameters
    ----------
    points : numpy.ndarray, shape (N, d)
        Channels of mean 0 and variance 1.
    centers : numpy.ndarray of int
        Indices of the points that carry a Gaussian.
    folds : numpy.ndarray of int, shape (N,)
        Cross-validation fold of each point; those of one episode share it.
    fixed : numpy.ndarray, shape (N, p)
        Orthonormal columns that every space contains; they span the constant.

    """

    def __init__(
        self,
        points: np.ndarray,
        centers: np.ndarray,
        folds: np.ndarray,
        fixed: np.ndarray,
    ):
        distances = squared_distances(points, points[centers])
        self._fixed = fixed
        self._folds = [np.flatnonzero(folds == k) for k in range(folds.max() + 1)]
        self._features = [
            residual(
                np.hstack([points, np.exp(distances / (-2 * width**2 * points.shape[1]))]), fixed
            )
            for width in _WIDTHS
        ]
        self._spectra = [_spectrum(f.T @ f / len(f)) for f in self._features]
        self._left_out = [[self._without(rows, f) for rows in self._folds] for f in self._features]

    def tuned(self, targets: np.ndarray) -> list[Space]:
        """Return the best space for each of the targets (N, k)."""
        errors = self._errors(targets)
        return [self._best(errors[:, :, k]) for k in range(errors.shape[2])]

    def jointly_tuned(self, targets: np.ndarray) -> Space:
        """Return the space that is best for all targets (N, k) together."""
        spread = np.maximum(targets.var(axis=0), np.finfo(float).tiny)
        return self._best((self._errors(targets) / spread).sum(axis=2))

    def predicted_shares(self, targets: np.ndarray) -> np.ndarray:
        """Return the share of each target's variance that folds left out show, at most: (k,)."""
        least = self._errors(targets).min(axis=(0, 1))
        return 1 - least / (len(targets) * targets.var(axis=0))

    def basis(self, space: Space) -> np.ndarray:
        """Return orthonormal columns (N, p + rank) that span a space."""
        variances, directions = self._spectra[space.width]
        features = self._features[space.width]
        rank = min(_RANKS[space.rank], len(variances))
        scale = np.sqrt(len(features) * variances[:rank])
        return np.hstack([self._fixed, features @ (directions[:, :rank] / scale)])

    def _without(self, rows: np.ndarray, features: np.ndarray) -> _Fold:
        part = features[rows]
        gram, total, size = part.T @ part, part.sum(axis=0), len(features) - len(rows)
        mean = -total / size  # The features have mean 0 over all rows.
        others = (features.T @ features - gram) / size - np.outer(mean, mean)
        return _Fold(rows, *_spectrum(others), mean, gram, total)

    def _errors(self, targets: np.ndarray) -> np.ndarray:
        """Return the squared errors in folds left out, shape (widths, ranks, k)."""
        targets = residual(targets, self._fixed)
        errors = np.zeros((len(_WIDTHS), len(_RANKS), targets.shape[1]))
        for w, (features, folds) in enumerate(zip(self._features, self._left_out, strict=True)):
            moments = features.T @ targets
            for fold in folds:
                errors[w] += self._fold_errors(features, targets, moments, fold)
        return errors

    def _fold_errors(self, features, targets, moments, fold: _Fold) -> np.ndarray:
        """Return the squared errors of all ranks in one fold, shape (ranks, k)."""
        here = targets[fold.rows]
        num_here, num_others = len(here), len(targets) - len(here)
        moment, level = features[fold.rows].T @ here, here.sum(axis=0)
        mean = -level / num_others  # So do the targets.
        slopes = fold.directions.T @ ((moments - moment) / num_others - np.outer(fold.mean, mean))
        slopes /= fold.variances[:, None]
        # The prediction is mean + (features - fold.mean) directions slopes.
        shift = np.outer(fold.total, fold.mean)
        gram = fold.gram - shift - shift.T + num_here * np.outer(fold.mean, fold.mean)
        gram = fold.directions.T @ gram @ fold.directions
        cross = moment - np.outer(fold.total, mean) - np.outer(fold.mean, level - num_here * mean)
        cross = fold.directions.T @ cross
        # One direction after another: its square, twice its products with those before, its moment.
        with_before = 2 * np.tril(gram, -1) @ slopes + gram.diagonal()[:, None] * slopes
        changes = np.vstack([((here - mean) ** 2).sum(axis=0), slopes * (with_before - 2 * cross)])
        return changes.cumsum(axis=0)[np.minimum(_RANKS, len(slopes))]

    def _best(self, errors: np.ndarray) -> Space:
        return Space(*divmod(int(errors.argmin()), len(_RANKS)))


def residual(targets: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Return targets (N, k) less their projection on orthonormal columns (N, r)."""
    return targets - basis @ (basis.T @ targets)


def extended(basis: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return orthonormal columns (N, r) and further ones that span what is new in columns (N, k).

    A direction of which less than a millionth is new is left out: it is a rounding error.
    """
    if not columns.size:
        return basis
    columns = columns / np.sqrt((columns**2).sum(axis=0))
    directions, sizes, _ = np.linalg.svd(residual(columns, basis), full_matrices=False)
    return np.hstack([basis, directions[:, sizes > _LEAST_NEW]])


def corrected_residual(left: np.ndarray, basis: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Return the residual (N, k) that each episode has after a fit to all the others.

    A fit to all hides a part of the errors (the jackknife, CR3: Bell & McCaffrey, Bias reduction in
    standard errors for linear regression with multi-stage samples, 2002).

    Parameters
    ----------
    left : numpy.ndarray, shape (N, k)
        Residuals of a fit to all episodes.
    basis : numpy.ndarray, shape (N, r)
        The orthonormal columns of that fit.
    starts : numpy.ndarray of int, shape (M,)
        The first row of each episode.

    """
    episodes = np.split(np.arange(len(left)), starts[1:])
    grams = np.array([basis[rows].T @ basis[rows] for rows in episodes])
    moments = np.array([basis[rows].T @ left[rows] for rows in episodes])
    eye = (1 + _LEAST_LEFT) * np.eye(basis.shape[1])
    corrected = left.copy()
    for rows, coefficients in zip(episodes, np.linalg.solve(eye - grams, moments), strict=True):
        corrected[rows] += basis[rows] @ coefficients
    return corrected


def squared_distances(points: np.ndarray, centers: np.ndarray) -> np.ndarray:
    """Return those of points (N, d) to centers (B, d): shape (N, B)."""
    squares = (points**2).sum(axis=1)[:, None] + (centers**2).sum(axis=1)
    return np.maximum(squares - 2 * points @ centers.T, 0)


def _spectrum(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return variances, greatest first, and directions of a covariance, without rounding errors."""
    variances, directions = np.linalg.eigh(covariance)
    variances, directions = variances[::-1], directions[:, ::-1]
    kept = variances > max(_LEAST_VARIANCE * variances[0], np.finfo(float).tiny)
    return variances[kept], directions[:, kept]
