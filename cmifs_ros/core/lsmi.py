# SPDX-License-Identifier: Apache-2.0

"""Least-squares mutual information (LSMI) between returns and features.

Section 3.2 of Hachiya & Sugiyama (2010): Gaussians centred on the samples model the density ratio
p(eta, z) / p(eta) p(z). Cross-validation chooses their width and regularisation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from .samples import StepSamples

CRITERIA = ('held_out', 'plug_in')


@dataclass(frozen=True)
class Lsmi:
    """The estimator and its model selection.

    Parameters
    ----------
    criterion : {'held_out', 'plug_in'}
        The estimate of the mutual information, at the width and regularisation chosen by
        cross-validation. 'plug_in' is Equation (10). 'held_out' is -2 J - 1, where J is Equation
        (7) on held-out data; irrelevant channels lower it instead of raising it.
    widths : tuple of float
        Grid of the kernel width sigma, which returns and channels share.
    regularizations : tuple of float
        Grid of lambda.
    num_folds : int
        Number of cross-validation folds.
    num_centers : int, optional
        Greatest number of kernel centres; None puts one on each sample, as in the paper.

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

    def estimate(self, step: StepSamples, subsets: Sequence[Sequence[int]]) -> np.ndarray:
        """Estimate the mutual information of the returns with each of several channel sets.

        Parameters
        ----------
        step : StepSamples
            The samples, in at least two folds.
        subsets : sequence of C sequences of int
            The channels of each set.

        Returns
        -------
        numpy.ndarray, shape (C,)

        """
        objective = self.objective(step, subsets)
        return self.information(
            step, subsets, objective, objective.reshape(len(subsets), -1).argmin(axis=1)
        )

    def objective(self, step: StepSamples, subsets: Sequence[Sequence[int]]) -> np.ndarray:
        """Return the held-out objective J of Equation (7) on the grid.

        Returns
        -------
        numpy.ndarray, shape (C, len(self.widths), len(self.regularizations))

        """
        # Loaded here, so that programs that never compute do not wait for the compiled code.
        from .held_out import held_out_objective

        order = np.argsort(step.folds, kind='stable')
        folds = step.folds[order]
        starts = np.flatnonzero(np.diff(folds, prepend=-1, append=folds[-1] + 1))
        common = [c for c in subsets[0] if all(c in subset for subset in subsets)]
        rest = [[c for c in subset if c not in common] for subset in subsets]
        own = np.full((len(rest), max(1, *map(len, rest))), -1)
        for row, channels in zip(own, rest, strict=True):
            row[: len(channels)] = channels
        return held_out_objective(
            step.returns[order],
            step.states[order],
            starts,
            np.argsort(order)[step.centers],
            np.array(common, dtype=np.int64),
            own,
            np.array(self.widths),
            np.array(self.regularizations),
        )

    def information(
        self,
        step: StepSamples,
        subsets: Sequence[Sequence[int]],
        objective: np.ndarray,
        points: np.ndarray,
    ) -> np.ndarray:
        """Return the mutual information at given points of the grid.

        Parameters
        ----------
        step, subsets
            As in `estimate`.
        objective : numpy.ndarray, shape (C, len(self.widths), len(self.regularizations))
            The held-out objective; used by 'held_out' only.
        points : numpy.ndarray of int, shape (C,)
            Flat indices into the grid, one for each set.

        Returns
        -------
        numpy.ndarray, shape (C,)

        """
        if self.criterion == 'held_out':
            return -2.0 * objective.reshape(len(subsets), -1)[range(len(subsets)), points] - 1.0
        width, regularization = np.unravel_index(points, objective.shape[1:])
        return np.array(
            [
                _plug_in(step, subset, self.widths[w], self.regularizations[i])
                for subset, w, i in zip(subsets, width, regularization, strict=True)
            ]
        )


def _plug_in(step: StepSamples, subset, width: float, regularization: float) -> float:
    """Return Equation (10) fitted to all samples."""
    z, eta = step.states[:, list(subset)], step.returns[:, None]
    k_eta = np.exp(cdist(eta[step.centers], eta, 'sqeuclidean') * (-0.5 / width**2))
    k_z = np.exp(cdist(z[step.centers], z, 'sqeuclidean') * (-0.5 / width**2))
    matrix = (k_eta @ k_eta.T) * (k_z @ k_z.T) / len(eta) ** 2
    h = np.mean(k_eta * k_z, axis=1)
    alpha = np.linalg.solve(matrix + regularization * np.eye(len(h)), h)
    independent = k_eta.mean(axis=1) * k_z.mean(axis=1)
    return float(alpha @ matrix @ alpha - 2.0 * alpha @ independent + 1.0)
