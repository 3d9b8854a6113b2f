"""Least-squares mutual information (LSMI) between returns and features.

Section 3.2 of Hachiya & Sugiyama (2010): the density ratio p(eta, z) / p(eta) p(z) is modelled
by Gaussians around the samples, and its width and regularisation come from cross-validation.
What makes it fast, and why each is exact:

- A Gaussian of (eta, z) is a Gaussian of eta times one of z, so the double sums over pairs of
  samples are products of single sums: H = (K_eta' K_eta) * (K_z' K_z) / M^2, elementwise.
- The Gram matrices of the folds add up to that of all samples, and training on all folds but
  one subtracts that one.
- All candidates of one search round share the returns and are estimated together.
- Samples with the same (eta, z) carry the same Gaussian. Their coefficients are equal, so one
  Gaussian scaled by the root of their number stands for all of them: H, h and the penalty
  on the coefficients stay what they were.
- All regularisations of one width and fold share a Krylov space; see `shifted_solve`.
- The grid is first searched in float32. Its error is far below `TOLERANCE`, and every width
  that comes within it of the best one is evaluated again in float64.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .shifted_solve import shifted_solve

CRITERIA = ('held_out', 'plug_in')

#: Widths whose objective J in float32 lies this close to the best are evaluated in float64.
#: The greatest error of J seen in float32, on a grid point of 6 heavy-tailed samples, is a fifth
#: of it; with 30 samples or more it is a twentieth.
TOLERANCE = 4e-3
#: Relative residual of the systems solved in float32.
_COARSE_RTOL = 1e-5
#: Regularisations below this drown in the rounding of float32.
_LEAST_COARSE_REGULARIZATION = 1e-4
#: Greatest number of entries in one stack of matrices: larger ones fall out of the cache.
_STACK_ENTRIES = 500_000


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
        features: Sequence[np.ndarray],
        folds: np.ndarray,
        centers: np.ndarray,
        widths: np.ndarray | None = None,
    ) -> np.ndarray:
        """Estimate the mutual information of the returns with each of several feature sets.

        Parameters
        ----------
        returns : numpy.ndarray, shape (M,)
        features : sequence of numpy.ndarray, each of shape (M, u)
            The C candidate feature sets; u may differ.
        folds : numpy.ndarray of int, shape (M,)
            The cross-validation fold of each sample; at least two different ones.
        centers : numpy.ndarray of int
            Indices of the samples that carry a Gaussian.
        widths : numpy.ndarray of bool, shape (len(self.widths),), optional
            Restricts the grid; the best width has to be in it.

        Returns
        -------
        numpy.ndarray, shape (C,)

        """
        grid = np.array(self.widths)[slice(None) if widths is None else widths]
        objective = self._objective(returns, features, folds, centers, grid=grid, dtype=np.float64)
        best = objective.reshape(len(features), -1).argmin(axis=1)
        if self.criterion == 'held_out':
            return -2.0 * objective.reshape(len(features), -1).min(axis=1) - 1.0
        width, regularization = np.unravel_index(best, objective.shape[1:])
        return np.array(
            [
                _plug_in(returns, z, centers, grid[width[c]], self.regularizations[i])
                for c, (z, i) in enumerate(zip(features, regularization, strict=True))
            ]
        )

    def screen(
        self,
        returns: np.ndarray,
        features: Sequence[np.ndarray],
        folds: np.ndarray,
        centers: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Do the float32 part: approximate the held-out scores and narrow down the widths.

        Parameters are those of `estimate`.

        Returns
        -------
        scores : numpy.ndarray, shape (C,)
            Held-out scores, accurate to `TOLERANCE`.
        widths : numpy.ndarray of bool, shape (C, len(self.widths))
            The widths among which the best one is.

        """
        is_coarse = min(self.regularizations) >= _LEAST_COARSE_REGULARIZATION
        dtype = np.float32 if is_coarse else np.float64
        objective = self._objective(
            returns, features, folds, centers, grid=self.widths, dtype=dtype
        )
        by_width = objective.min(axis=2)
        best = by_width.min(axis=1)
        return -2.0 * best - 1.0, by_width <= best[:, None] + TOLERANCE

    def _objective(self, returns, features, folds, centers, *, grid, dtype) -> np.ndarray:
        """Return J of Equation (7), averaged over the held-out folds: shape (C, widths, L)."""
        order = np.argsort(folds, kind='stable')
        starts = np.flatnonzero(np.diff(folds[order], prepend=-1))
        eta_distances = squared_distances(returns[order, None], returns[centers, None])
        entries = max(len(starts) * len(centers), len(returns)) * len(centers)
        chunk = max(1, _STACK_ENTRIES // entries)
        objective = np.empty((len(features), len(grid), len(self.regularizations)))
        for first in range(0, len(features), chunk):
            part = slice(first, first + chunk)
            columns, counts = _merged_centers(returns, features[part], centers)
            z_distances = np.stack(
                [
                    squared_distances(z[order], z[centers[c]])
                    for z, c in zip(features[part], columns, strict=True)
                ]
            ).astype(dtype)
            # Without merging all candidates share the Gaussians of the returns.
            shared = columns.shape[1] == len(centers)
            etas = eta_distances[None] if shared else eta_distances[:, columns].transpose(1, 0, 2)
            etas = etas.astype(dtype)
            scale = np.sqrt(counts).astype(dtype)[:, None]
            for w, width in enumerate(grid):
                objective[part, w] = _held_out_objective(
                    gaussian(etas, width),
                    gaussian(z_distances, width) * scale,
                    starts,
                    np.array(self.regularizations),
                )
        return objective


def squared_distances(samples: np.ndarray, centers: np.ndarray) -> np.ndarray:
    """Return the squared Euclidean distances of samples (M, u) to centres (B, u): (M, B)."""
    total = np.zeros((len(samples), len(centers)))
    for sample, center in zip(samples.T, centers.T, strict=True):
        total += np.subtract.outer(sample, center) ** 2
    return total


def gaussian(squared_distance: np.ndarray, width: float) -> np.ndarray:
    """Return exp(-d^2 / 2 sigma^2) in the type of its argument."""
    return np.exp(squared_distance * squared_distance.dtype.type(-0.5 / width**2))


def _merged_centers(returns, features, centers) -> tuple[np.ndarray, np.ndarray]:
    """Return, for each candidate, one of each set of equal centres and how many it stands for.

    Both have shape (C, U), U the greatest number of different centres; where a candidate has
    fewer, the rest stand for 0.
    """
    merged = [
        np.unique(
            np.column_stack([returns[centers], z[centers]]),
            axis=0,
            return_index=True,
            return_counts=True,
        )[1:]
        for z in features
    ]
    size = max(len(index) for index, _ in merged)
    if size == len(centers):  # Nothing to gain for all of them together.
        shape = (len(features), size)
        return np.broadcast_to(np.arange(size), shape), np.ones(shape)
    columns = np.stack([np.pad(index, (0, size - len(index))) for index, _ in merged])
    return columns, np.stack([np.pad(count, (0, size - len(count))) for _, count in merged])


def _held_out_objective(k_eta, k_z, starts, lambdas) -> np.ndarray:
    """Return J of Equation (7) on each held-out fold, averaged over the folds.

    Parameters
    ----------
    k_eta : numpy.ndarray, shape (C, M, B) or (1, M, B)
        Kernel values of the returns of M samples at B centres, sorted by fold.
    k_z : numpy.ndarray, shape (C, M, B)
        The same for C candidate feature sets.
    starts : numpy.ndarray of int, shape (F,)
        Where each fold begins among the samples.
    lambdas : numpy.ndarray, shape (L,)

    Returns
    -------
    numpy.ndarray, shape (C, L)

    """
    dtype = k_z.dtype
    num_candidates, num_samples, num_centers = k_z.shape
    sizes = np.diff(starts, append=num_samples).astype(dtype)[:, None, None]
    rest = num_samples - sizes
    gram_eta, gram_z = _fold_grams(k_eta, starts), _fold_grams(k_z, starts)
    joint = np.add.reduceat(k_eta * k_z, starts, axis=1).transpose(1, 0, 2)

    matrix = np.subtract(gram_z.sum(axis=0), gram_z)
    matrix *= (gram_eta.sum(axis=0) - gram_eta) / rest[..., None] ** 2
    h_train = (joint.sum(axis=0) - joint) / rest
    alpha = shifted_solve(
        matrix.reshape(-1, num_centers, num_centers),
        h_train.reshape(-1, num_centers),
        lambdas,
        rtol=1e-14 if dtype == np.float64 else _COARSE_RTOL,
    ).reshape(len(starts), num_candidates, len(lambdas), num_centers)

    np.multiply(gram_z, gram_eta / sizes[..., None] ** 2, out=matrix)
    quadratic = np.einsum('fclb,fclb->fcl', np.matmul(alpha, matrix), alpha)
    linear = np.matmul(alpha, (joint / sizes)[..., None])[..., 0]
    return np.mean(0.5 * quadratic - linear, axis=0)


def _fold_grams(kernel: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Return K_f' K_f for each fold f of (C, M, B): shape (F, C, B, B)."""
    num_candidates, num_samples, num_centers = kernel.shape
    grams = np.empty((len(starts), num_candidates, num_centers, num_centers), kernel.dtype)
    for gram, first, last in zip(grams, starts, [*starts[1:], num_samples], strict=True):
        part = kernel[:, first:last]
        np.matmul(part.transpose(0, 2, 1), part, out=gram)
    return grams


def _plug_in(returns, z, centers, width: float, regularization: float) -> float:
    """Return the mutual information of Equation (10), fitted to all samples."""
    k_eta = gaussian(squared_distances(returns[:, None], returns[centers, None]), width)
    k_z = gaussian(squared_distances(z, z[centers]), width)
    matrix = (k_eta.T @ k_eta) * (k_z.T @ k_z) / len(returns) ** 2
    h = np.mean(k_eta * k_z, axis=0)
    alpha = np.linalg.solve(matrix + regularization * np.eye(len(centers)), h)
    independent = k_eta.mean(axis=0) * k_z.mean(axis=0)
    return float(alpha @ matrix @ alpha - 2.0 * alpha @ independent + 1.0)
