"""Kernel ridge regression on a few channels, its width and penalty by cross-validation."""

from __future__ import annotations

import numpy as np

#: Kernel widths, in standard deviations of a channel times the root of their number.
_WIDTHS = (0.3, 0.6, 1.2, 2.4, 5.0)
_PENALTIES = np.logspace(-5, 1, 13)


class KernelRidge:
    """Regress any number of targets on the same points.

    The model is a sum of Gaussians around some points, a linear function and a constant, all
    penalised (Rifkin, Yeo & Poggio, Regularized least-squares classification, 2003). One
    eigendecomposition a fold and width serves all penalties and targets.

    Parameters
    ----------
    points : numpy.ndarray, shape (N, d)
        Channels of mean 0 and variance 1.
    centers : numpy.ndarray of int
        Indices of the points that carry a Gaussian.
    folds : numpy.ndarray of int, shape (N,)
        Cross-validation fold of each point; those of one episode share it.

    """

    def __init__(self, points: np.ndarray, centers: np.ndarray, folds: np.ndarray):
        distances = squared_distances(points, points[centers])
        rest = np.column_stack([points, np.ones(len(points))])
        self._folds = [np.flatnonzero(folds == k) for k in range(folds.max() + 1)]
        self._features = [
            np.hstack([np.exp(distances / (-2 * width**2 * points.shape[1])), rest])
            for width in _WIDTHS
        ]
        self._spectra = [self._decompose(features) for features in self._features]

    def _decompose(self, features):
        """Return the Gram matrix of each fold, and eigenvalues and vectors of all without it."""
        grams = [features[fold].T @ features[fold] for fold in self._folds]
        total = sum(grams)
        sizes = [len(features) - len(fold) for fold in self._folds]
        left = [(total - gram) / size for gram, size in zip(grams, sizes, strict=True)]
        return grams, [np.linalg.eigh(gram) for gram in (*left, total / len(features))]

    def tuned(self, targets: np.ndarray) -> list[tuple[int, int]]:
        """Return the best width and penalty, as indices, for each of the targets (N, k)."""
        errors = np.zeros((len(_WIDTHS), len(_PENALTIES), targets.shape[1]))
        for w, (features, (grams, spectra)) in enumerate(
            zip(self._features, self._spectra, strict=True)
        ):
            moments = [features[fold].T @ targets[fold] for fold in self._folds]
            total = sum(moments)
            for fold, moment, gram, (values, vectors) in zip(
                self._folds, moments, grams, spectra[:-1], strict=True
            ):
                projected = vectors.T @ ((total - moment) / (len(features) - len(fold)))
                shrunk = projected[:, None] / _shrinkage(values, _PENALTIES)[:, :, None]
                weights = np.tensordot(vectors, shrunk, axes=1)
                # The square of what is left, less that of the target.
                change = np.tensordot(gram, weights, axes=1) - 2 * moment[:, None]
                errors[w] += (change * weights).sum(axis=0)
        best = errors.reshape(-1, targets.shape[1]).argmin(axis=0)
        return [divmod(int(i), len(_PENALTIES)) for i in best]

    def residual(self, targets: np.ndarray, choice: tuple[int, int]) -> np.ndarray:
        """Return what is left of targets (N, k) after a fit to all points."""
        w, penalty = choice
        features, (values, vectors) = self._features[w], self._spectra[w][1][-1]
        projected = vectors.T @ (features.T @ targets) / len(features)
        weights = vectors @ (projected / _shrinkage(values, _PENALTIES[[penalty]]))
        return targets - features @ weights

    def left_out(
        self, residual: np.ndarray, choice: tuple[int, int], episodes: list[np.ndarray]
    ) -> np.ndarray:
        """Return the residual (N,) that each episode has after a fit to all the others.

        That of a fit to all hides a part of the errors. This is the jackknife's, CR3 of Bell &
        McCaffrey, Bias reduction in standard errors for linear regression with multi-stage
        samples, 2002; `episodes` are the rows of each.
        """
        w, penalty = choice
        values, vectors = self._spectra[w][1][-1]
        scale = np.sqrt(len(residual) * _shrinkage(values, _PENALTIES[[penalty]])[:, 0])
        root = self._features[w] @ (vectors / scale)  # the hat matrix is root root'
        left = np.empty_like(residual)
        for rows in episodes:
            kept = np.eye(len(rows)) - root[rows] @ root[rows].T
            left[rows] = np.linalg.solve(kept, residual[rows])
        return left


def squared_distances(points: np.ndarray, centers: np.ndarray) -> np.ndarray:
    """Return those of points (N, d) to centers (B, d): shape (N, B)."""
    squares = (points**2).sum(axis=1)[:, None] + (centers**2).sum(axis=1)
    return np.maximum(squares - 2 * points @ centers.T, 0)


def _shrinkage(values: np.ndarray, penalties: np.ndarray) -> np.ndarray:
    return np.maximum(values, 0)[:, None] + penalties
