"""Least-squares mutual information (LSMI) between returns and features.

Section 3.2 of Hachiya & Sugiyama (2010): the density ratio p(eta, z) / p(eta) p(z) is modelled
by Gaussians around the samples. A Gaussian of (eta, z) is a Gaussian of eta times one of z, so
every double sum over pairs of samples in the paper is a product of two single sums, and no loop
over pairs is needed: with K the kernel matrices, H = (K_eta' K_eta) * (K_z' K_z) / M^2.

All candidates of one search round share the returns, so they are estimated together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .shifted_solve import shifted_solve

CRITERIA = ('held_out', 'plug_in')

#: Greatest number of entries in one stack of matrices, 8 MB: larger ones fall out of the cache.
_STACK_ENTRIES = 1_000_000


@dataclass(frozen=True)
class Lsmi:
    """The estimator and its model selection.

    Parameters
    ----------
    criterion : {'held_out', 'plug_in'}
        What stands for the mutual information. 'plug_in' is Equation (10) at the width and
        regularisation that cross-validation picks; 'held_out' is -2 J - 1 with J the held-out
        Equation (7) there, which irrelevant features lower in place of raising.
    widths : tuple of float
        Grid of the kernel width sigma, the same for returns and features.
    regularizations : tuple of float
        Grid of lambda.
    num_folds : int
        Folds of the cross-validation.
    num_centers : int, optional
        Greatest number of kernel centres; None puts one on each sample, as the paper does.

    Raises
    ------
    ValueError
        If the criterion is unknown, a grid holds a number that is not positive, or there are
        fewer than 2 folds or 1 centre.

    """

    criterion: str = 'held_out'
    widths: tuple[float, ...] = tuple(np.logspace(-2, 2, 9))
    regularizations: tuple[float, ...] = tuple(np.logspace(-3, 1, 9))
    num_folds: int = 5
    num_centers: int | None = 200

    def __post_init__(self):
        if self.criterion not in CRITERIA:
            raise ValueError(
                f'criterion is {self.criterion!r}; expected one of {", ".join(CRITERIA)}'
            )
        for name in ('widths', 'regularizations'):
            grid = getattr(self, name)
            if len(grid) == 0 or not all(value > 0 for value in grid):
                raise ValueError(f'{name} is {grid}; expected positive numbers')
        if self.num_folds < 2:
            raise ValueError(f'num_folds is {self.num_folds}; expected at least 2')
        if self.num_centers is not None and self.num_centers < 1:
            raise ValueError(f'num_centers is {self.num_centers}; expected at least 1, or None')

    def estimate(
        self,
        returns: np.ndarray,
        features: list[np.ndarray],
        folds: np.ndarray,
        centers: np.ndarray,
    ) -> np.ndarray:
        """Estimate the mutual information of the returns with each of several feature sets.

        Parameters
        ----------
        returns : numpy.ndarray, shape (M,)
        features : list of numpy.ndarray, each of shape (M, u)
            The candidate feature sets; u may differ.
        folds : numpy.ndarray of int, shape (M,)
            The cross-validation fold of each sample; at least two different ones.
        centers : numpy.ndarray of int
            Indices of the samples that carry a Gaussian.

        Returns
        -------
        numpy.ndarray, shape (len(features),)

        """
        order = np.argsort(folds, kind='stable')
        starts = np.flatnonzero(np.diff(folds[order], prepend=-1))
        fold_slices = [slice(*ends) for ends in zip(starts, [*starts[1:], len(folds)], strict=True)]
        eta_distances = squared_distances(returns[order, None], returns[centers, None])
        chunk = max(1, _STACK_ENTRIES // (len(fold_slices) * len(centers) ** 2))
        scores = [
            self._estimate_chunk(
                eta_distances,
                np.stack([squared_distances(z[order], z[centers]) for z in part]),
                fold_slices,
            )
            for part in (features[i : i + chunk] for i in range(0, len(features), chunk))
        ]
        return np.concatenate(scores)

    def _estimate_chunk(self, eta_distances, z_distances, fold_slices):
        lambdas = np.array(self.regularizations)
        objective = np.stack(
            [
                held_out_objective(
                    gaussian(eta_distances, width),
                    gaussian(z_distances, width),
                    fold_slices,
                    lambdas,
                )
                for width in self.widths
            ],
            axis=1,
        ).reshape(len(z_distances), -1)
        best = np.argmin(objective, axis=1)
        if self.criterion == 'held_out':
            return -2.0 * objective.min(axis=1) - 1.0
        widths = np.repeat(self.widths, len(lambdas))[best]
        return np.array(
            [
                plug_in(gaussian(eta_distances, width), gaussian(z, width), lambdas[b])
                for z, width, b in zip(z_distances, widths, best % len(lambdas), strict=True)
            ]
        )


def squared_distances(samples: np.ndarray, centers: np.ndarray) -> np.ndarray:
    """Return the squared Euclidean distances of samples (M, u) to centres (B, u): (M, B)."""
    total = np.zeros((len(samples), len(centers)))
    for sample, center in zip(samples.T, centers.T, strict=True):
        total += np.subtract.outer(sample, center) ** 2
    return total


def gaussian(squared_distance: np.ndarray, width: float) -> np.ndarray:
    """Return exp(-d^2 / 2 sigma^2)."""
    return np.exp(squared_distance * (-0.5 / width**2))


def held_out_objective(
    k_eta: np.ndarray, k_z: np.ndarray, fold_slices: list[slice], lambdas: np.ndarray
) -> np.ndarray:
    """Return J of Equation (7) on each held-out fold, averaged over the folds.

    Parameters
    ----------
    k_eta : numpy.ndarray, shape (M, B)
        Kernel values of the returns of M samples at B centres, sorted by fold.
    k_z : numpy.ndarray, shape (C, M, B)
        The same for C candidate feature sets.
    fold_slices : list of slice
        Where each fold stands among the samples.
    lambdas : numpy.ndarray, shape (L,)

    Returns
    -------
    numpy.ndarray, shape (C, L)

    """
    num_candidates, num_samples, num_centers = k_z.shape
    sizes = np.array([fold.stop - fold.start for fold in fold_slices], dtype=float)
    gram_eta = np.stack([k_eta[fold].T @ k_eta[fold] for fold in fold_slices])
    gram_z = np.stack(
        [np.matmul(k_z[:, fold].transpose(0, 2, 1), k_z[:, fold]) for fold in fold_slices], axis=1
    )
    joint = np.stack(
        [np.einsum('mb,cmb->cb', k_eta[fold], k_z[:, fold]) for fold in fold_slices], axis=1
    )
    rest = num_samples - sizes
    h_train = (joint.sum(axis=1, keepdims=True) - joint) / rest[:, None]
    matrix = gram_z.sum(axis=1, keepdims=True) - gram_z
    matrix *= (gram_eta.sum(axis=0) - gram_eta) / rest[:, None, None] ** 2
    alpha = shifted_solve(
        matrix.reshape(-1, num_centers, num_centers), h_train.reshape(-1, num_centers), lambdas
    ).reshape(num_candidates, len(sizes), len(lambdas), num_centers)

    matrix = np.multiply(gram_z, gram_eta / sizes[:, None, None] ** 2, out=matrix)
    quadratic = np.sum(np.matmul(alpha, matrix) * alpha, axis=-1)
    linear = np.matmul(alpha, (joint / sizes[:, None])[..., None])[..., 0]
    return np.mean(0.5 * quadratic - linear, axis=1)


def plug_in(k_eta: np.ndarray, k_z: np.ndarray, regularization: float) -> float:
    """Return the mutual information of Equation (10), fitted to all samples."""
    num_samples, num_centers = k_eta.shape
    matrix = (k_eta.T @ k_eta) * (k_z.T @ k_z) / num_samples**2
    h = np.mean(k_eta * k_z, axis=0)
    alpha = np.linalg.solve(matrix + regularization * np.eye(num_centers), h)
    independent = k_eta.mean(axis=0) * k_z.mean(axis=0)
    return float(alpha @ matrix @ alpha - 2.0 * alpha @ independent + 1.0)
