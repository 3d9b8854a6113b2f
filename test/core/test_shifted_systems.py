import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmifs_ros.core.shifted_systems import ShiftedSystems
from cmifs_ros.core.workspace import Workspace

SHIFTS = np.logspace(-3, 1, 9)


def shifted_solve(matrices, rhs, rtol=1e-13, step=4):
    systems = ShiftedSystems(matrices, rhs, SHIFTS, Workspace())
    while True:
        systems.extend(step)
        if systems.converged(rtol).all():
            return systems.solutions()


@given(
    size=st.integers(1, 40),
    rank=st.integers(0, 40),
    scale=st.floats(1e-6, 1e3),
    seed=st.integers(0, 2**32 - 1),
)
def test_solutions_satisfy_every_shifted_system(size, rank, scale, seed):
    rng = np.random.default_rng(seed)
    factors = scale * rng.normal(size=(3, size, rank))
    matrices = factors @ factors.transpose(0, 2, 1)
    rhs = rng.normal(size=(3, size))
    solutions = shifted_solve(matrices, rhs)
    identity = np.eye(size)
    for matrix, b, solution in zip(matrices, rhs, solutions, strict=True):
        for shift, x in zip(SHIFTS, solution, strict=True):
            residual = (matrix + shift * identity) @ x - b
            assert np.linalg.norm(residual) <= 1e-9 * (1 + np.linalg.norm(matrix)) * np.linalg.norm(
                b
            )


@pytest.mark.parametrize('kind', ['zero right-hand side', 'identity', 'low rank', 'mixed'])
@pytest.mark.parametrize(('dtype', 'tolerance'), [(np.float64, 1e-8), (np.float32, 1e-2)])
def test_problems_that_end_early_do_not_disturb_their_neighbours(kind, dtype, tolerance):
    rng = np.random.default_rng(0)
    factor = rng.normal(size=(30, 30))
    matrices = np.stack([factor @ factor.T, np.eye(30), np.zeros((30, 30))])
    rhs = rng.normal(size=(3, 30))
    if kind == 'zero right-hand side':
        rhs[1] = 0
    if kind == 'identity':
        matrices[0] = 2 * np.eye(30)
    if kind == 'low rank':
        matrices[1] = 30 * np.outer(factor[0], factor[0])
        rhs[1] = matrices[1] @ rhs[1]
    expected = np.linalg.solve(
        matrices[:, None] + SHIFTS[:, None, None] * np.eye(30),
        np.broadcast_to(rhs[:, None, :, None], (3, 9, 30, 1)),
    )[..., 0]
    rtol = 1e-13 if dtype == np.float64 else 1e-6
    found = shifted_solve(matrices.astype(dtype), rhs.astype(dtype), rtol)
    size = np.linalg.norm(expected, axis=2, keepdims=True)
    assert np.all(np.abs(found - expected) <= tolerance * size + 1e-30)


@given(size=st.integers(1, 60), rank=st.integers(0, 60), seed=st.integers(0, 2**32 - 1))
def test_float32_reaches_its_tolerance(size, rank, seed):
    rng = np.random.default_rng(seed)
    factors = rng.normal(size=(3, size, rank)) / np.sqrt(size)
    matrices = factors @ factors.transpose(0, 2, 1)
    rhs = rng.normal(size=(3, size))
    exact = shifted_solve(matrices, rhs)
    coarse = shifted_solve(matrices.astype(np.float32), rhs.astype(np.float32), rtol=1e-5)
    assert coarse.dtype == np.float32
    error = np.linalg.norm(coarse - exact, axis=2)
    # A residual of r leaves an error of at most r / lambda.
    assert np.all(error <= 1e-3 * np.linalg.norm(rhs, axis=1)[:, None] / SHIFTS)
