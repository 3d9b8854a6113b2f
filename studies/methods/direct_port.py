# SPDX-License-Identifier: Apache-2.0

"""A direct port of the authors' program: the reference for exactness and speed.

For each subset of channels, step and width it computes the kernels again, for each fold their Gram
matrices, and for each regularisation LAPACK solves one system (Hachiya & Sugiyama, 2010, Section
3.2, with the grids of their MATLAB program). It shares with the engine in `core` only what comes
before and after: the samples of each step with their folds and centres, and the greedy search.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cmifs_ros.core import Episode
from cmifs_ros.core.samples import StepSamples, step_samples
from cmifs_ros.core.search import Sensor, forward_selection

WIDTHS = np.logspace(-2, 2, 9)
REGULARIZATIONS = np.logspace(-3, 1, 9)
NUM_FOLDS = 5


def rank_directly(
    episodes: Sequence[Episode],
    num_features: int | None = None,
    *,
    sensors: Sequence[Sensor] | None = None,
    gamma: float = 0.95,
    criterion: str = 'held_out',
    standardize: bool = True,
    max_time_bins: int | None = 32,
    tuning_window: int = 2,
    num_centers: int | None = 200,
    random_state: int = 0,
) -> tuple[list[int], list[float]]:
    """Rank sensors by forward selection.

    Parameters
    ----------
    episodes : sequence of Episode
    num_features : int, optional
        Number of sensors to rank; None ranks all.
    sensors : sequence of tuple of int, optional
        The channels of each sensor; by default each channel is one.
    gamma, criterion, standardize, max_time_bins, tuning_window, num_centers, random_state
        As of `ConditionalMISelector`.

    Returns
    -------
    ranking : list of int
        Indices of the sensors, best first.
    scores : list of float
        The criterion after each addition.

    """
    steps = step_samples(
        episodes,
        gamma=gamma,
        standardize=standardize,
        max_time_bins=max_time_bins,
        num_folds=NUM_FOLDS,
        num_centers=num_centers,
        random_state=random_state,
    )
    if sensors is None:
        sensors = [(channel,) for channel in range(episodes[0].num_channels)]
    return forward_selection(
        lambda subsets: np.array(
            [conditional_mi(steps, subset, criterion, tuning_window) for subset in subsets]
        ),
        sensors,
        len(sensors) if num_features is None else num_features,
    )


def conditional_mi(
    steps: Sequence[StepSamples], subset: Sequence[int], criterion: str, tuning_window: int
) -> float:
    """Return sum_n p(n) I(eta_n; z_n), Equation (9); a step of a single episode counts as 0.

    Each step takes the width and the regularisation that minimise the held-out objective
    averaged over the samples of the steps near it.
    """
    total = sum(len(step.returns) for step in steps)
    steps = [step for step in steps if step.folds.max() > 0]
    objectives = [held_out_objective(step, subset) for step in steps]
    score = 0.0
    for n, step in enumerate(steps):
        averaged, weight = np.zeros((len(WIDTHS), len(REGULARIZATIONS))), 0.0
        for m, objective in enumerate(objectives):
            if abs(m - n) <= tuning_window:
                nearness = (tuning_window + 1 - abs(m - n)) * len(steps[m].returns)
                averaged += nearness * objective
                weight += nearness
        w, i = np.unravel_index(np.argmin(averaged / weight), averaged.shape)
        if criterion == 'held_out':
            information = -2.0 * objectives[n][w, i] - 1.0
        else:
            information = plug_in(step, subset, WIDTHS[w], REGULARIZATIONS[i])
        score += len(step.returns) / total * information
    return score


def held_out_objective(step: StepSamples, subset: Sequence[int]) -> np.ndarray:
    """Return J of Equation (7) averaged over the held-out folds, at each width and lambda."""
    z, returns = step.states[:, list(subset)], step.returns[:, None]
    identity = np.eye(len(step.centers))
    num_folds = step.folds.max() + 1
    objective = np.zeros((len(WIDTHS), len(REGULARIZATIONS)))
    for w, width in enumerate(WIDTHS):
        k_eta = gaussian_kernel(returns, returns[step.centers], width)
        k_z = gaussian_kernel(z, z[step.centers], width)
        for fold in range(num_folds):
            held_out = step.folds == fold
            matrix, h = moments(k_eta[~held_out], k_z[~held_out])
            held_out_matrix, held_out_h = moments(k_eta[held_out], k_z[held_out])
            for i, regularization in enumerate(REGULARIZATIONS):
                alpha = np.linalg.solve(matrix + regularization * identity, h)
                objective[w, i] += 0.5 * alpha @ held_out_matrix @ alpha - held_out_h @ alpha
    return objective / num_folds


def plug_in(step: StepSamples, subset: Sequence[int], width: float, regularization: float) -> float:
    """Return Equation (10), fitted to all samples of a step."""
    z, returns = step.states[:, list(subset)], step.returns[:, None]
    k_eta = gaussian_kernel(returns, returns[step.centers], width)
    k_z = gaussian_kernel(z, z[step.centers], width)
    matrix, h = moments(k_eta, k_z)
    alpha = np.linalg.solve(matrix + regularization * np.eye(len(h)), h)
    independent = k_eta.mean(axis=0) * k_z.mean(axis=0)
    return alpha @ matrix @ alpha - 2.0 * independent @ alpha + 1.0


def gaussian_kernel(samples: np.ndarray, centers: np.ndarray, width: float) -> np.ndarray:
    """Return exp(-d^2 / 2 sigma^2) between samples (M, u) and centres (B, u): shape (M, B)."""
    differences = samples[:, None, :] - centers[None, :, :]
    return np.exp(-np.sum(differences**2, axis=2) / (2 * width**2))


def moments(k_eta: np.ndarray, k_z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the matrix H, over all pairs of a return and features, and the vector h."""
    return (k_eta.T @ k_eta) * (k_z.T @ k_z) / len(k_eta) ** 2, np.mean(k_eta * k_z, axis=0)
