# SPDX-License-Identifier: Apache-2.0

"""Kernel principal component regression against its textbook formulas."""

import numpy as np
import pytest

from cmifs_ros.core.kernel_regression import (
    KernelRegression,
    Space,
    corrected_residual,
    residual,
    squared_distances,
)

NUM_EPISODES, NUM_STEPS = 12, 10
WIDTHS = (0.3, 0.6, 1.2, 2.4, 5.0)
RANKS = (0, 1, 2, 3, 4, 6, 8, 11, 16, 23, 32, 45, 64, 90, 128, 181)


@pytest.fixture(scope='module')
def data():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(NUM_EPISODES * NUM_STEPS, 2))
    targets = np.column_stack(
        [np.sin(2 * points[:, 0]), points[:, 0] * points[:, 1], rng.normal(size=len(points))]
    )
    targets += 0.1 * rng.normal(size=targets.shape)
    episodes = np.split(np.arange(len(points)), NUM_EPISODES)
    folds = np.repeat(np.arange(NUM_EPISODES) % 4, NUM_STEPS)
    centers = rng.permutation(len(points))[:30]
    return points, targets, episodes, folds, centers


@pytest.fixture(scope='module')
def regression(data):
    points, _, _, folds, centers = data
    constant = np.full((len(points), 1), 1 / np.sqrt(len(points)))
    return KernelRegression(points, centers, folds, constant)


def features(points, centers, width):
    gaussians = [
        [np.exp(-np.sum((p - c) ** 2) / (2 * width**2 * len(p))) for c in points[centers]]
        for p in points
    ]
    return np.column_stack([points, gaussians])


def predict(train, targets, test, rank):
    """Least squares on the constant and the leading principal components of the training set."""
    mean = train.mean(axis=0)
    _, sizes, directions = np.linalg.svd(train - mean, full_matrices=False)
    directions = directions[sizes**2 > 1e-7 * sizes[0] ** 2][:rank].T  # no rounding errors
    columns = np.column_stack([np.ones(len(train)), (train - mean) @ directions])
    weights = np.linalg.lstsq(columns, targets, rcond=None)[0]
    return np.column_stack([np.ones(len(test)), (test - mean) @ directions]) @ weights


def test_the_choice_is_that_of_leaving_out_each_fold_in_turn(data, regression):
    points, targets, _, folds, centers = data
    errors = np.zeros((len(WIDTHS), len(RANKS), targets.shape[1]))
    for w, width in enumerate(WIDTHS):
        phi = features(points, centers, width)
        for i, rank in enumerate(RANKS):
            for fold in range(4):
                out = folds == fold
                guess = predict(phi[~out], targets[~out], phi[out], rank)
                errors[w, i] += np.sum((targets[out] - guess) ** 2, axis=0)
    for k, space in enumerate(regression.tuned(targets)):
        assert errors[space.width, space.rank, k] == pytest.approx(errors[..., k].min(), rel=1e-6)
        assert errors[space.width, space.rank, k] < errors[..., k].max()
    together = (errors / targets.var(axis=0)).sum(axis=2)
    assert together[regression.jointly_tuned(targets)] == pytest.approx(together.min(), rel=1e-6)
    shares = 1 - errors.min(axis=(0, 1)) / (len(targets) * targets.var(axis=0))
    np.testing.assert_allclose(regression.predicted_shares(targets), shares, rtol=1e-6)


def test_the_residual_is_that_of_least_squares(data, regression):
    points, targets, _, _, centers = data
    left = residual(targets, regression.basis(Space(2, 6)))
    phi = features(points, centers, WIDTHS[2])
    np.testing.assert_allclose(left, targets - predict(phi, targets, phi, RANKS[6]), atol=1e-9)


def test_the_corrected_residual_of_an_episode_is_that_of_a_fit_to_the_others(data, regression):
    _, targets, episodes, _, _ = data
    basis = regression.basis(Space(2, 6))
    starts = np.array([rows[0] for rows in episodes])
    corrected = corrected_residual(residual(targets, basis), basis, starts)
    for rows in episodes:
        rest = np.setdiff1d(np.arange(len(basis)), rows)
        weights = np.linalg.lstsq(basis[rest], targets[rest], rcond=None)[0]
        expected = targets[rows] - basis[rows] @ weights
        np.testing.assert_allclose(corrected[rows], expected, rtol=1e-4, atol=1e-6)


def test_fixed_columns_are_in_every_space(data):
    points, targets, _, folds, centers = data
    owner = np.repeat([0, 1], len(points) // 2)
    fixed = np.eye(2)[owner] / np.sqrt(len(points) / 2)
    regression = KernelRegression(points, centers, folds, fixed)
    for space in (Space(0, 0), Space(1, 3), *regression.tuned(targets)):
        basis = regression.basis(space)
        np.testing.assert_allclose(basis.T @ basis, np.eye(basis.shape[1]), atol=1e-8)
        np.testing.assert_allclose(basis[:, :2], fixed)


def test_squared_distances_are_those_of_pairs():
    rng = np.random.default_rng(1)
    points, centers = rng.normal(size=(7, 3)), rng.normal(size=(4, 3))
    direct = [[np.sum((p - c) ** 2) for c in centers] for p in points]
    np.testing.assert_allclose(squared_distances(points, centers), direct, atol=1e-12)
