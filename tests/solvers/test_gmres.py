# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The compiled GMRES against dense solves; it stops at its tolerance and not before.

Its directions are in single precision, of which 1e-6 is left of a right-hand side of one.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mpi4py")
pytest.importorskip("numba")

from mpi4py import MPI

from whole_vectors import all_of

from dolfinx_joints.common.kernels import njit
from dolfinx_joints.solvers.interface import corrections
from dolfinx_joints.solvers.interface.compiled import krylov, products

SIZE, SELF = 60, MPI.COMM_SELF
SINGLE = 2e-6


def gmres(
    matrix: np.ndarray, b: np.ndarray, *, tolerance: float, most: int, comm: Any = SELF
) -> tuple[np.ndarray, int]:
    """Solution of this rank and number of products; of (I + T S) x = b with T = I.

    Args:
        matrix: Rows of this rank, shape (unknowns of the rank, all unknowns).
        b: Right-hand side, of the rank.
        tolerance: Relative to b.
        most: Products.
        comm: Communicator.
    """
    size, first = len(b), comm.exscan(len(b)) or 0
    s = matrix.T.copy()
    s[first + np.arange(size), np.arange(size)] -= 1.0
    split = corrections._columns_of(s, False, comm)
    kept = products.kept_of(size // 3, len(s) // 3, split)
    space = krylov.space_of(size, most)
    space.blocks[:] = np.eye(3)
    found = np.empty(size)
    return found, _solve(split, kept, b, tolerance, space, found)


@njit
def _solve(split, kept, b, tolerance, space, found):  # type: ignore[no-untyped-def]
    every = np.arange(len(b) // 3)
    products.keep(split, kept, every, len(every))
    return krylov.gmres(split, kept, b, tolerance, space, found)


def near_identity(share: float = 0.5, seed: int = 1) -> np.ndarray:
    """I + E, unsymmetric, E of the spectral norm ``share``: condition (1 + share)/(1 - share)."""
    e = np.random.default_rng(seed).normal(size=(SIZE, SIZE))
    return np.eye(SIZE) + share / np.linalg.norm(e, 2) * e


def vector(seed: int = 2) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=SIZE)


def residual(matrix: np.ndarray, x: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(b - matrix @ x) / np.linalg.norm(b))


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_solves_what_numpy_solves(share):
    matrix, b = near_identity(share), vector()
    x, count = gmres(matrix, b, tolerance=1e-6, most=200)
    assert residual(matrix, x, b) <= SINGLE
    assert 1 <= count <= SIZE


@pytest.mark.parametrize("count", [1, 2, 5])
def test_as_many_products_as_there_are_eigenvalues(count):
    # The minimal polynomial of a diagonalisable matrix has that degree.
    matrix = np.diag(np.tile(np.arange(1.0, count + 1.0), SIZE // count))
    x, products = gmres(matrix, vector(), tolerance=1e-6, most=50)
    np.testing.assert_allclose(x, vector() / matrix.diagonal(), rtol=0, atol=1e-5)
    assert products == count


def test_no_right_hand_side_no_work():
    x, products = gmres(near_identity(), np.zeros(SIZE), tolerance=1e-10, most=10)
    np.testing.assert_array_equal(x, np.zeros(SIZE))
    assert products == 0


@pytest.mark.parametrize("tolerance", [0.3, 1e-2, 1e-5])
def test_stops_at_the_tolerance(tolerance):
    # One product less does not reach it: residuals of GMRES are the smallest of their space.
    matrix, b = near_identity(), vector()
    x, products = gmres(matrix, b, tolerance=tolerance, most=SIZE)
    assert residual(matrix, x, b) <= tolerance + SINGLE
    before, _ = gmres(matrix, b, tolerance=0.0, most=products - 1)
    assert residual(matrix, before, b) > tolerance


def test_what_is_spent_buys_the_best_of_the_space():
    # The least squares over b, A b, ... A^(k-1) b, by NumPy.
    matrix, b = near_identity(), vector()
    sizes = []
    for most in range(1, 9):
        x, products = gmres(matrix, b, tolerance=0.0, most=most)
        assert products == most
        space = [b]
        while len(space) < most:
            space.append(matrix @ space[-1])
        q, _ = np.linalg.qr(np.column_stack(space))
        weights = np.linalg.lstsq(matrix @ q, b, rcond=None)[0]
        np.testing.assert_allclose(x, q @ weights, rtol=0, atol=SINGLE * abs(x).max())
        sizes.append(residual(matrix, x, b))
    assert all(after < 0.7 * before for before, after in pairwise(sizes))


def test_scales_with_the_right_hand_side():
    # Relative to b: forces may be of any size.
    matrix, b = near_identity(), vector()
    x, products = gmres(matrix, b, tolerance=1e-4, most=SIZE)
    for factor in (1e-150, 1e-20, 1e20, 1e150):
        scaled, again = gmres(matrix, factor * b, tolerance=1e-4, most=SIZE)
        np.testing.assert_allclose(scaled / factor, x, rtol=0, atol=SINGLE * abs(x).max())
        assert again == products


def test_a_singular_system_gives_what_can_be_had():
    # diag(0, 1, ..., 1): b along the other axes is solved, and nothing becomes NaN where it is not.
    matrix = np.diag([0.0, *np.ones(SIZE - 1)])
    b = np.array([0.0, *np.arange(1.0, SIZE)])
    x, _ = gmres(matrix, b, tolerance=1e-6, most=10)
    np.testing.assert_allclose(x, b, rtol=1e-6)
    b[0] = 1.0
    x, _ = gmres(matrix, b, tolerance=1e-6, most=10)
    assert np.all(np.isfinite(x))
    assert np.linalg.norm(b - matrix @ x) <= np.linalg.norm(b)


def test_what_a_matrix_makes_zero_cannot_be_had():
    # A b = 0: one product tells that, and x = 0 is as good as any multiple of b.
    x, products = gmres(np.diag([0.0, 1.0, 1.0]), np.eye(3)[0], tolerance=1e-6, most=3)
    np.testing.assert_array_equal(x, np.zeros(3))
    assert products == 1


def test_a_nilpotent_matrix_does_not_break_it_down():
    # A shift: no progress until the last product, which then solves (a cycle of n).
    matrix, b = np.roll(np.eye(9), 1, axis=0), np.eye(9)[0]
    x, products = gmres(matrix, b, tolerance=1e-6, most=20)
    np.testing.assert_allclose(x, np.linalg.solve(matrix, b), atol=1e-6)
    assert products == 9


@pytest.mark.parametrize("seed", [1, 2])
def test_directions_stay_orthogonal(seed):
    # Far from the identity, where all products are needed. Made orthogonal once, directions in
    # single precision leave 2e-5 and 4e-5.
    matrix, b = near_identity(10.0, seed), vector()
    x, _ = gmres(matrix, b, tolerance=1e-6, most=SIZE)
    assert residual(matrix, x, b) <= 5e-6


def part_of(comm: Any, owner: int | None) -> slice:
    """The rank's unknowns: whole points in equal parts, or all on one rank."""
    ends = 3 * np.linspace(0, SIZE // 3, comm.size + 1).astype(int)
    if owner is not None:
        ends[1:-1] = SIZE if owner == 0 else 0
    return slice(ends[comm.rank], ends[comm.rank + 1])


@pytest.mark.mpi
@pytest.mark.parametrize("owner", [None, 0, -1])
@pytest.mark.parametrize("share", [0.1, 0.99, 10.0])
def test_ranks_do_not_matter(comm, share, owner):
    # 10: far from the identity, of condition some hundreds.
    matrix, b, part = near_identity(share), vector(), part_of(comm, owner)
    given = {"tolerance": 1e-5, "most": 2 * SIZE}
    mine, products = gmres(matrix[part], b[part], comm=comm, **given)
    assert residual(matrix, all_of(comm, mine), b) <= 3e-5
    _, expected = gmres(matrix, b, **given)
    assert abs(products - expected) <= 1
