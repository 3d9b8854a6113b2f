# SPDX-License-Identifier: Apache-2.0

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


def direct_kdr(states, target, subset, eps=0.1):
    """Return the sum over steps of Tr[Kc_Y (Kc_Z + eps I)^-1], with H = I - 11' / m.

    `states` is a list of arrays (T, v), Y the target at the next step, Z the subset.
    """
    samples = [row for episode in states for row in episode]
    distances = [np.linalg.norm(a - b) for i, a in enumerate(samples) for b in samples[:i]]
    width = np.median(distances)
    total = 0.0
    for n in range(max(map(len, states)) - 1):
        pairs = [(s[n + 1, list(target)], s[n, list(subset)]) for s in states if len(s) > n + 1]
        y = _centred([y for y, _ in pairs], width)
        z = _centred([z for _, z in pairs], width)
        total += np.trace(y @ np.linalg.inv(z + eps * np.eye(len(pairs))))
    return total


def _centred(rows, width):
    gram = [[np.exp(-np.sum((a - b) ** 2) / (2 * width**2)) for b in rows] for a in rows]
    h = np.eye(len(rows)) - np.ones((len(rows), len(rows))) / len(rows)
    return h @ gram @ h
