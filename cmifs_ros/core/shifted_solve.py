"""Many regularised systems for the price of one: (H + lambda I) x = b for every lambda.

A shift leaves the Krylov space of (H, b) unchanged, so one Lanczos run serves all lambdas;
reorthogonalising each vector twice against all earlier ones keeps it exact to rounding
(Golub & Van Loan, Matrix Computations, 10.3). The matrices come in a stack and advance
together, since at a hundred rows the calls, not the arithmetic, take the time.
"""

from __future__ import annotations

import numpy as np


def shifted_solve(
    matrices: np.ndarray, rhs: np.ndarray, shifts: np.ndarray, rtol: float = 1e-14
) -> np.ndarray:
    """Solve (H_p + lambda_l I) x_pl = b_p for all p and l.

    Parameters
    ----------
    matrices : numpy.ndarray, shape (P, B, B)
        Symmetric positive semidefinite H_p.
    rhs : numpy.ndarray, shape (P, B)
        Right-hand sides b_p.
    shifts : numpy.ndarray, shape (L,)
        Positive lambda_l.
    rtol : float
        Residual norm to reach, relative to that of b_p.

    Returns
    -------
    numpy.ndarray, shape (P, L, B)

    """
    num_problems, size = rhs.shape
    norms = np.linalg.norm(rhs, axis=1)
    basis = np.zeros((num_problems, size, size))
    diagonal = np.zeros((size, num_problems, 1))
    coupling = np.zeros((size, num_problems, 1))
    # LDL' factors of the tridiagonal matrix, which also tell the residual of each system.
    pivots = np.empty((size, num_problems, len(shifts)))
    forward = np.empty((size, num_problems, len(shifts)))

    vector = rhs / np.where(norms > 0, norms, 1.0)[:, None]
    for k in range(size):
        basis[:, k] = vector
        image = np.matmul(matrices, vector[:, :, None])[:, :, 0]
        diagonal[k] = np.sum(vector * image, axis=1, keepdims=True)
        known = basis[:, : k + 1]
        for _ in range(2):
            image -= np.matmul(np.matmul(known, image[:, :, None])[:, None, :, 0], known)[:, 0]
        length = np.linalg.norm(image, axis=1, keepdims=True)
        # Below rounding the Krylov space is complete: the zero vector then adds nothing.
        length[length <= 1e-15 * np.abs(diagonal[: k + 1]).max(axis=0)] = 0.0
        coupling[k] = length
        vector = np.divide(image, length, out=np.zeros_like(image), where=length > 0)

        pivots[k] = diagonal[k] + shifts
        forward[k] = norms[:, None]
        if k:
            factor = coupling[k - 1] / pivots[k - 1]
            pivots[k] -= factor * coupling[k - 1]
            forward[k] = -factor * forward[k - 1]
        residual = length * np.abs(forward[k] / pivots[k])
        if np.all(residual <= rtol * norms[:, None]):
            break

    num_vectors = k + 1
    weights = np.empty((num_problems, len(shifts), num_vectors))
    weights[:, :, k] = forward[k] / pivots[k]
    for i in range(k - 1, -1, -1):
        weights[:, :, i] = (forward[i] - coupling[i] * weights[:, :, i + 1]) / pivots[i]
    return np.matmul(weights, basis[:, :num_vectors])
