# SPDX-License-Identifier: Apache-2.0

"""Least squares in the leading directions of a Gaussian kernel's features.

Gaussians around some of the points, and the points themselves, are reduced to their first
principal components, as many as cross-validation asks for (kernel principal component regression:
Rosipal, Girolami, Trejo & Cichocki, 2001). The fit is a projection: what it leaves of one variable
is orthogonal to all that it could explain of another (Frisch & Waugh 1933, Lovell 1963). A ridge
leaves some of what it should explain in both, and their product then looks like dependence.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .threads import in_threads

#: Kernel widths, in standard deviations of a channel times the root of their number.
_WIDTHS = (0.3, 0.6, 1.2, 2.4, 5.0)
_RANKS = np.array([0, 1, 2, 3, 4, 6, 8, 11, 16, 23, 32, 45, 64, 90, 128, 181])
#: Directions of less variance, as a share of the greatest, are rounding errors.
_LEAST_VARIANCE = 1e-7
#: A direction that only one episode spans cannot be fitted without it; this keeps the equations
#: solvable.
_LEAST_LEFT = 1e-6
#: Episodes whose equations are solved together.
_MAX_TOGETHER = 256
#: Share of a column's length below which what another basis leaves of it is a rounding error.
_LEAST_NEW = 1e-6


class Space(NamedTuple):
    """A space of functions of the points, by the indices of its width and of its rank."""

    width: int
    rank: int


class _Fold(NamedTuple):
    """A fold left out, in the directions (d, r) of the other folds' features."""

    num_here: int
    num_others: int
    directions: np.ndarray
    variances: np.ndarray  # (r,)
    mean: np.ndarray  # of the others' features, (d,)
    level: np.ndarray  # sum of this fold's features, (d,)
    with_before: np.ndarray  # the fold's products of directions, doubled with those before, (r, r)


class _Width(NamedTuple):
    """The features (N, d) of one width, in the order of the folds, and their directions."""

    features: np.ndarray
    variances: np.ndarray  # (r,)
    directions: np.ndarray  # (d, r)
    left_out: list[_Fold]


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
    n_jobs : int
        Threads that share the widths.

    """

    def __init__(
        self,
        points: np.ndarray,
        centers: np.ndarray,
        folds: np.ndarray,
        fixed: np.ndarray,
        n_jobs: int = 1,
    ):
        distances = squared_distances(points, points[centers])
        self._fixed = fixed
        # Features are in the order of the folds, so that each of these is a slice.
        self._order = np.argsort(folds, kind='stable')
        ends = np.cumsum(np.bincount(folds))
        self._folds = [slice(start, end) for start, end in zip([0, *ends[:-1]], ends, strict=True)]

        def of_width(width: float) -> _Width:
            bumps = np.exp(distances / (-2 * width**2 * points.shape[1]))
            features = residual(np.hstack([points, bumps]), fixed)[self._order]
            grams = [features[fold].T @ features[fold] for fold in self._folds]
            total = np.sum(grams, axis=0)
            left_out = [
                _without(features[fold], gram, total, len(features))
                for fold, gram in zip(self._folds, grams, strict=True)
            ]
            return _Width(features, *_spectrum(total / len(features)), left_out)

        self._widths = in_threads(of_width, _WIDTHS, n_jobs)

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
        features, axes = self._axes(space)
        columns = np.empty((len(features), axes.shape[1]))
        columns[self._order] = features @ axes
        return np.hstack([self._fixed, columns])

    def residuals(self, targets: np.ndarray, spaces: Sequence[Space]) -> np.ndarray:
        """Return what each of the targets (N, k) keeps after its projection on its own space."""
        left = residual(targets, self._fixed)
        for space in set(spaces):
            features, axes = self._axes(space)
            of_space = [k for k, one in enumerate(spaces) if one == space]
            rows = np.ix_(self._order, of_space)
            left[rows] -= features @ (axes @ (axes.T @ (features.T @ left[rows])))
        return left

    def _axes(self, space: Space) -> tuple[np.ndarray, np.ndarray]:
        """Return features (N, d) and the axes (d, rank) by which they become orthonormal."""
        features, variances, directions, _ = self._widths[space.width]
        rank = min(_RANKS[space.rank], len(variances))
        return features, directions[:, :rank] / np.sqrt(len(features) * variances[:rank])

    def _errors(self, targets: np.ndarray) -> np.ndarray:
        """Return the squared errors in folds left out, shape (widths, ranks, k)."""
        targets = residual(targets, self._fixed)[self._order]
        parts = [targets[fold] for fold in self._folds]
        squares = [(part**2).sum(axis=0) for part in parts]
        levels = [part.sum(axis=0) for part in parts]
        errors = np.zeros((len(_WIDTHS), len(_RANKS), targets.shape[1]))
        for w, width in enumerate(self._widths):
            moments = [
                width.features[fold].T @ part for fold, part in zip(self._folds, parts, strict=True)
            ]
            total = np.sum(moments, axis=0)
            for fold, *here in zip(width.left_out, moments, squares, levels, strict=True):
                errors[w] += _errors_of_ranks(fold, total, *here)
        return errors

    def _best(self, errors: np.ndarray) -> Space:
        return Space(*divmod(int(errors.argmin()), len(_RANKS)))


def _without(features: np.ndarray, gram: np.ndarray, total: np.ndarray, size: int) -> _Fold:
    """Return a fold of features (n, d) with its Gram matrix; that of all, `size`, is given."""
    num_here, num_others = len(features), size - len(features)
    level = features.sum(axis=0)
    mean = -level / num_others  # The features have mean 0 over all rows.
    variances, directions = _spectrum((total - gram) / num_others - np.outer(mean, mean))
    shift = np.outer(level, mean)
    gram = directions.T @ (gram - shift - shift.T + num_here * np.outer(mean, mean)) @ directions
    with_before = 2 * np.tril(gram, -1) + np.diag(gram.diagonal())
    return _Fold(num_here, num_others, directions, variances, mean, level, with_before)


def _errors_of_ranks(fold: _Fold, total, moment, squares, level) -> np.ndarray:
    """Return the squared errors in a fold by the number of directions, shape (ranks, k).

    Given are the moments of features and targets in all folds, and the targets in this one: their
    moments, squares and sum.
    """
    mean = -level / fold.num_others  # The targets have mean 0 over all rows, too.
    slopes = fold.directions.T @ ((total - moment) / fold.num_others - np.outer(fold.mean, mean))
    slopes /= fold.variances[:, None]
    # The prediction is mean + (features - fold.mean) directions slopes.
    own = level - fold.num_here * mean
    cross = fold.directions.T @ (moment - np.outer(fold.level, mean) - np.outer(fold.mean, own))
    # One direction after another: its square, twice its products with those before, its moment.
    changes = slopes * (fold.with_before @ slopes - 2 * cross)
    first = squares - mean * (2 * level - fold.num_here * mean)
    return np.vstack([first, changes]).cumsum(axis=0)[np.minimum(_RANKS, len(slopes))]


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
    lengths, least = np.diff(starts, append=len(left)), 1 + _LEAST_LEFT
    corrected = np.empty_like(left)
    for length in np.unique(lengths):
        rows = starts[lengths == length, None] + np.arange(length)
        for block in np.array_split(rows, -(-len(rows) // _MAX_TOGETHER)):
            part, here = basis[block], left[block]
            across = part.transpose(0, 2, 1)
            # The smaller of two systems of equations with the same solution.
            if length < basis.shape[1]:
                eye = least * np.eye(length)
                corrected[block] = least * np.linalg.solve(eye - part @ across, here)
            else:
                eye = least * np.eye(basis.shape[1])
                corrected[block] = here + part @ np.linalg.solve(eye - across @ part, across @ here)
    return corrected


def squared_distances(points: np.ndarray, centers: np.ndarray) -> np.ndarray:
    """Return those of points (N, d) to centers (B, d): shape (N, B)."""
    distances = points @ (-2 * centers.T)
    distances += (points**2).sum(axis=1)[:, None]
    distances += (centers**2).sum(axis=1)
    return np.maximum(distances, 0, out=distances)


def _spectrum(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return variances, greatest first, and directions of a covariance, without rounding errors."""
    variances, directions = np.linalg.eigh(covariance)
    variances, directions = variances[::-1], directions[:, ::-1]
    kept = variances > max(_LEAST_VARIANCE * variances[0], np.finfo(float).tiny)
    return variances[kept], directions[:, kept]
