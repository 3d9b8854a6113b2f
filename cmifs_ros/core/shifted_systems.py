"""Many regularised systems for the price of one: (H + lambda I) x = b for every lambda.

A shift leaves the Krylov space of (H, b) unchanged, so one Lanczos run serves all lambdas
(Golub & Van Loan, Matrix Computations, 10.3). The matrices come in a stack and advance
together, since at a hundred rows the calls, not the arithmetic, take the time.
"""

from __future__ import annotations

import numpy as np

from .workspace import Workspace


class ShiftedSystems:
    """(H_p + lambda_l I) x_pl = b_p for all p and l, solved as closely as asked.

    Each Lanczos vector is orthogonalised against all earlier ones, which keeps the number of
    vectors small in float32 and makes the solutions exact to rounding in float64.

    Parameters
    ----------
    matrices : numpy.ndarray of float64 or float32, shape (P, B, B)
        Symmetric positive semidefinite H_p.
    rhs : numpy.ndarray of the same type, shape (P, B)
        Right-hand sides b_p.
    shifts : numpy.ndarray, shape (L,)
        Positive lambda_l.
    workspace : Workspace
        Where the Lanczos vectors are kept; one for each object in use.

    """

    def __init__(
        self, matrices: np.ndarray, rhs: np.ndarray, shifts: np.ndarray, workspace: Workspace
    ):
        dtype = rhs.dtype
        self._matrices = matrices
        self._shifts = shifts.astype(dtype)
        self._norms = np.sqrt(_dot(rhs, rhs))
        self._workspace = workspace
        self._basis = workspace.array('basis', (0, *rhs.shape), dtype)
        self._remainder, self._length = rhs, self._norms
        self._scale = np.zeros_like(self._norms)
        self._couplings: list[np.ndarray] = []
        # LDL' factors of the tridiagonal matrix, which also tell the residual of each system.
        self._pivots: list[np.ndarray] = []
        self._forward: list[np.ndarray] = []

    def extend(self, num_vectors: int) -> None:
        """Enlarge every Krylov space by so many vectors, as far as there is room."""
        done, (num_problems, size) = len(self._pivots), self._remainder.shape
        total = min(done + num_vectors, size)
        dtype = self._basis.dtype
        basis = self._workspace.array('basis', (total, num_problems, size), dtype)
        if basis.base is not self._basis.base:
            basis[:done] = self._basis
        self._basis = basis
        for k in range(done, total):
            vector = self._basis[k]
            np.divide(self._remainder, np.where(self._length > 0, self._length, 1), out=vector)
            column = np.matmul(self._matrices, vector[:, :, None])
            image = column[:, :, 0]
            diagonal = _dot(vector, image)
            image -= diagonal * vector
            if k:
                image -= self._length * self._basis[k - 1]
                factor = self._length / self._pivots[-1]
                self._pivots.append(diagonal + self._shifts - factor * self._length)
                self._forward.append(-factor * self._forward[-1])
            else:
                self._pivots.append(diagonal + self._shifts)
                self._forward.append(np.broadcast_to(self._norms, self._pivots[0].shape))
            known = self._basis[: k + 1].transpose(1, 0, 2)
            for _ in range(2 if dtype == np.float64 else 1):
                image -= np.matmul(np.matmul(known, column).transpose(0, 2, 1), known)[:, 0]
            np.maximum(self._scale, diagonal, out=self._scale)
            length = np.sqrt(_dot(image, image))
            # Below rounding the Krylov space is complete: zero vectors then add nothing.
            complete = length <= 5 * np.finfo(dtype).eps * self._scale
            image[complete[:, 0]] = 0
            length[complete] = 0
            self._remainder, self._length = image, length
            self._couplings.append(length)

    def converged(self, rtol: float) -> np.ndarray:
        """Tell where all residuals have norms of at most `rtol` times that of b_p: shape (P,)."""
        if len(self._pivots) == self._remainder.shape[1]:
            return np.ones(len(self._norms), dtype=bool)
        residual = self._length * np.abs(self._forward[-1] / self._pivots[-1])
        return np.all(residual <= rtol * self._norms, axis=1)

    def solutions(self) -> np.ndarray:
        """Return the best x_pl in the Krylov spaces so far: shape (P, L, B), in the workspace."""
        weights = np.empty((len(self._pivots), *self._pivots[0].shape), self._basis.dtype)
        weights[-1] = self._forward[-1] / self._pivots[-1]
        for i in range(len(weights) - 2, -1, -1):
            weights[i] = (self._forward[i] - self._couplings[i] * weights[i + 1]) / self._pivots[i]
        shape = (*weights.shape[1:], self._basis.shape[2])
        out = self._workspace.array('solutions', shape, self._basis.dtype)
        return np.matmul(weights.transpose(1, 2, 0), self._basis.transpose(1, 0, 2), out=out)

    def keep(self, problems: np.ndarray) -> None:
        """Drop all problems but these indices."""
        self._matrices = self._matrices[problems]
        self._norms, self._scale = self._norms[problems], self._scale[problems]
        self._remainder, self._length = self._remainder[problems], self._length[problems]
        # A fresh array: what is kept may not lie where the workspace writes.
        self._basis = self._basis[:, problems]
        for sequence in (self._couplings, self._pivots, self._forward):
            sequence[:] = [item[problems] for item in sequence]


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum('pb,pb->p', a, b)[:, None]
