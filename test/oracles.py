"""Slow, literal evaluations to hold the fast code against."""

import numpy as np


def direct_lsmi(returns, z, folds, centers, *, widths, regularizations):
    """Equations (7) to (10) of Hachiya & Sugiyama (2010), with the literal double sums.

    Returns the held-out objective J at its minimum over the grid, and Equation (10) there.
    """
    joint = np.column_stack([returns, z])
    best = (np.inf, None, None)
    for width in widths:
        for lam in regularizations:
            objectives = []
            for fold in np.unique(folds):
                alpha = _fit(joint[folds != fold], joint[centers], width, lam)
                h_matrix, h = _moments(joint[folds == fold], joint[centers], width)
                objectives.append(0.5 * alpha @ h_matrix @ alpha - h @ alpha)
            if np.mean(objectives) < best[0]:
                best = (np.mean(objectives), width, lam)
    objective, width, lam = best
    alpha = _fit(joint, joint[centers], width, lam)
    ratios = [
        alpha @ _basis(np.append(eta, row), joint[centers], width) for eta in returns for row in z
    ]
    return objective, np.mean((np.array(ratios) - 1) ** 2)


def _basis(point, centers, width):
    return np.exp(-np.sum((centers - point) ** 2, axis=1) / (2 * width**2))


def _moments(joint, centers, width):
    h_matrix = np.zeros((len(centers), len(centers)))
    for a in joint:
        for b in joint:
            psi = _basis(np.append(a[0], b[1:]), centers, width)
            h_matrix += np.outer(psi, psi)
    h = np.mean([_basis(a, centers, width) for a in joint], axis=0)
    return h_matrix / len(joint) ** 2, h


def _fit(joint, centers, width, lam):
    h_matrix, h = _moments(joint, centers, width)
    return np.linalg.solve(h_matrix + lam * np.eye(len(centers)), h)
