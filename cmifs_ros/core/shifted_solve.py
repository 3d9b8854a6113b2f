"""Many regularised systems for the price of one: (H + lambda I) x = b for every lambda.

A shift leaves the Krylov space of (H, b) unchanged, so one Lanczos run serves all lambdas
(Golub & Van Loan, Matrix Computations, 10.3). The matrices come in a stack and advance
together, since at a hundred rows the calls, not the arithmetic, take the time.
"""

from __future__ import annotations

import numpy as np


def shifted_solve(
    matrices: np.ndarray, rhs: np.ndarray, shifts: np.ndarray, rtol: float = 1e-14
) -> np.ndarray:
    """Solve (H_p + lambda_l I) x_pl = b_p for all p and l.

    In float64 each Lanczos vector is orthogonalised twice against all earlier ones, which
    makes the solutions exact to rounding. In float32 it is left to the short recurrence: the
    run then takes some more steps, each far cheaper, and reaches tolerances down to about 1e-5.

    Parameters
    ----------
    matrices : numpy.ndarray of float64 or float32, shape (P, B, B)
        Symmetric positive semidefinite H_p.
    rhs : numpy.ndarray of the same type, shape (P, B)
        Right-hand sides b_p.
    shifts : numpy.ndarray, shape (L,)
        Positive lambda_l.
    rtol : float
        Residual norm to reach, relative to that of b_p.

    Returns
    -------
    numpy.ndarray of the same type, shape (P, L, B)

    """
    num_problems, size = rhs.shape
    dtype = rhs.dtype
    orthogonalize = dtype == np.float64
    max_vectors = size if orthogonalize else 2 * size
    shifts = shifts.astype(dtype)
    norms = np.sqrt(_dot(rhs, rhs))
    basis = np.empty((num_problems, max_vectors, size), dtype)
    coupling = np.zeros((max_vectors, num_problems, 1), dtype)
    # LDL' factors of the tridiagonal matrix, which also tell the residual of each system.
    pivots = np.empty((max_vectors, num_problems, len(shifts)), dtype)
    forward = np.empty_like(pivots)

    vector = rhs / np.where(norms > 0, norms, 1)
    scale = np.zeros_like(norms)
    for k in range(max_vectors):
        basis[:, k] = vector
        image = np.matmul(matrices, vector[:, :, None])[:, :, 0]
        diagonal = _dot(vector, image)
        np.maximum(scale, diagonal, out=scale)
        image -= diagonal * vector
        if k:
            image -= coupling[k - 1] * basis[:, k - 1]
        if orthogonalize:
            known = basis[:, : k + 1]
            for _ in range(2):
                image -= np.matmul(np.matmul(known, image[:, :, None])[:, None, :, 0], known)[:, 0]
        length = np.sqrt(_dot(image, image))
        # Below rounding the Krylov space is complete: the zero vector then adds nothing.
        length[length <= 5 * np.finfo(dtype).eps * scale] = 0
        coupling[k] = length
        vector = np.divide(image, length, out=np.zeros_like(image), where=length > 0)

        if k:
            factor = coupling[k - 1] / pivots[k - 1]
            np.subtract(diagonal + shifts, factor * coupling[k - 1], out=pivots[k])
            np.multiply(-factor, forward[k - 1], out=forward[k])
        else:
            pivots[k] = diagonal + shifts
            forward[k] = norms
        if np.all(length * np.abs(forward[k] / pivots[k]) <= rtol * norms):
            break

    weights = np.empty((num_problems, len(shifts), k + 1), dtype)
    weights[:, :, k] = forward[k] / pivots[k]
    for i in range(k - 1, -1, -1):
        weights[:, :, i] = (forward[i] - coupling[i] * weights[:, :, i + 1]) / pivots[i]
    return np.matmul(weights, basis[:, : k + 1])


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum('pb,pb->p', a, b)[:, None]
