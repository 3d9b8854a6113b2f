"""Kernel ridge regression against its textbook formulas."""

import numpy as np
import pytest

from cmifs_ros.core.kernel_ridge import KernelRidge, squared_distances

NUM_EPISODES, NUM_STEPS = 12, 10


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


def features(points, centers, width):
    gaussians = [
        [np.exp(-np.sum((p - c) ** 2) / (2 * width**2 * len(p))) for c in points[centers]]
        for p in points
    ]
    return np.column_stack([gaussians, points, np.ones(len(points))])


def predict(train, targets, test, penalty):
    gram = train.T @ train + len(train) * penalty * np.eye(train.shape[1])
    return test @ np.linalg.solve(gram, train.T @ targets)


WIDTHS = (0.3, 0.6, 1.2, 2.4, 5.0)
PENALTIES = np.logspace(-5, 1, 13)


def test_the_choice_is_that_of_leaving_out_each_fold_in_turn(data):
    points, targets, _, folds, centers = data
    chosen = KernelRidge(points, centers, folds).tuned(targets)
    for target, choice in zip(targets.T, chosen, strict=True):
        errors = np.zeros((len(WIDTHS), len(PENALTIES)))
        for w, width in enumerate(WIDTHS):
            phi = features(points, centers, width)
            for i, penalty in enumerate(PENALTIES):
                for fold in range(4):
                    out = folds == fold
                    guess = predict(phi[~out], target[~out], phi[out], penalty)
                    errors[w, i] += np.sum((target[out] - guess) ** 2)
        assert errors[choice] == pytest.approx(errors.min(), rel=1e-6)
        assert errors[choice] < errors.max()


def test_the_residual_is_that_of_the_normal_equations(data):
    points, targets, _, folds, centers = data
    residual = KernelRidge(points, centers, folds).residual(targets, (2, 6))
    phi = features(points, centers, WIDTHS[2])
    np.testing.assert_allclose(
        residual, targets - predict(phi, targets, phi, PENALTIES[6]), atol=1e-9
    )


def test_an_episode_left_out_has_the_residual_of_a_fit_to_the_others(data):
    points, targets, episodes, folds, centers = data
    regression = KernelRidge(points, centers, folds)
    residual = regression.residual(targets[:, :1], (2, 6))[:, 0]
    left_out = regression.left_out(residual, (2, 6), episodes)
    phi = features(points, centers, WIDTHS[2])
    others = len(phi) - NUM_STEPS
    for rows in episodes:
        rest = np.setdiff1d(np.arange(len(phi)), rows)
        penalty = PENALTIES[6] * len(phi) / others  # the same in all
        guess = predict(phi[rest], targets[rest, 0], phi[rows], penalty)
        np.testing.assert_allclose(left_out[rows], targets[rows, 0] - guess, rtol=1e-6)


def test_squared_distances_are_those_of_pairs():
    rng = np.random.default_rng(1)
    points, centers = rng.normal(size=(7, 3)), rng.normal(size=(4, 3))
    direct = [[np.sum((p - c) ** 2) for c in centers] for p in points]
    np.testing.assert_allclose(squared_distances(points, centers), direct, atol=1e-12)
