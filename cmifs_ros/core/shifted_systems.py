"""Many regularised systems for the price of one: (H + lambda I) x = b for every lambda.

A shift leaves the Krylov space of (H, b) unchanged, so one Lanczos run serves all lambdas
(Golub & Van Loan, Matrix Computations, 10.3). The matrices come in a stack and advance
together, since at a hundred rows the calls, not the arithmetic, take the time.
"""

from __future__ import annotations

import numpy as np

from .workspace import Workspace

#: In the place of a norm of 0, so that it can divide.
_TRACE = np.float32(1e-30)


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
        self._matrices = matrices
        self._shifts = shifts.astype(rhs.dtype)
        self._remainder = rhs
        self._scale = np.zeros((len(rhs), 1), rhs.dtype)
        self._workspace = workspace
        self._basis = workspace.array('basis', (0, *rhs.shape), rhs.dtype)
        self._couplings: list[np.ndarray] = [_norms(rhs)]
        # LDL' factors of the tridiagonal matrix, which also tell the residual of each system.
        self._pivots: list[np.ndarray] = []
        self._forward: list[np.ndarray] = []

    def extend(self, num_vectors: int) -> None:
        """Enlarge every Krylov space by so many vectors, as far as there is room."""
        done, (num_problems, size) = len(self._pivots), self._remainder.shape
        total = min(done + num_vectors, size)
        basis = self._workspace.array('basis', (total, num_problems, size), self._basis.dtype)
        if basis.base is not self._basis.base:  # The workspace had to make room.
            basis[:done] = self._basis
        self._basis = basis
        for k in range(done, total):
            length = self._couplings[-1]
            np.divide(self._remainder, length, out=basis[k])
            column = np.matmul(self._matrices, basis[k][:, :, None])
            self._remainder = column[:, :, 0]
            known = basis[: k + 1].transpose(1, 0, 2)
            components = np.matmul(known, column)
            diagonal = components[:, k]
            self._remainder -= np.matmul(components.transpose(0, 2, 1), known)[:, 0]
            # Once more, for what rounding left.
            components = np.matmul(known, column)
            self._remainder -= np.matmul(components.transpose(0, 2, 1), known)[:, 0]
            if k:
                factor = length / self._pivots[-1]
                self._pivots.append(diagonal + self._shifts - factor * length)
                self._forward.append(-factor * self._forward[-1])
            else:
                self._pivots.append(diagonal + self._shifts)
                self._forward.append(np.broadcast_to(length, self._pivots[0].shape))
            np.maximum(self._scale, diagonal, out=self._scale)
            length = _norms(self._remainder)
            # Below rounding the Krylov space is complete: zero vectors then add nothing.
            complete = length <= 5 * np.finfo(basis.dtype).eps * self._scale
            self._remainder[complete[:, 0]] = 0
            self._couplings.append(np.where(complete, _TRACE, length))

    def converged(self, rtol: float) -> np.ndarray:
        """Tell where all residuals have norms of at most `rtol` times that of b_p: shape (P,)."""
        if len(self._pivots) == self._remainder.shape[1]:
            return np.ones(len(self._remainder), dtype=bool)
        residual = self._couplings[-1] * np.abs(self._forward[-1] / self._pivots[-1])
        return np.all(residual <= rtol * self._couplings[0], axis=1)

    def solutions(self) -> np.ndarray:
        """Return the best x_pl in the Krylov spaces so far: shape (P, L, B), in the workspace."""
        weights = np.empty((len(self._pivots), *self._pivots[0].shape), self._basis.dtype)
        weights[-1] = self._forward[-1] / self._pivots[-1]
        for i in range(len(weights) - 2, -1, -1):
            weights[i] = (
                self._forward[i] - self._couplings[i + 1] * weights[i + 1]
            ) / self._pivots[i]
        shape = (*weights.shape[1:], self._basis.shape[2])
        out = self._workspace.array('solutions', shape, self._basis.dtype)
        return np.matmul(weights.transpose(1, 2, 0), self._basis.transpose(1, 0, 2), out=out)


def _norms(vectors: np.ndarray) -> np.ndarray:
    """Return the norms of (P, B), shape (P, 1), or a trace of a number in the place of 0."""
    return np.maximum(np.sqrt(np.einsum('pb,pb->p', vectors, vectors))[:, None], _TRACE)
