# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""GMRES against dense solves; it stops at its tolerance and not before."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mpi4py")
pytest.importorskip("numba")

from mpi4py import MPI

from whole_vectors import all_of

from dolfinx_joints.solvers.interface.gmres import gmres

SIZE, SELF = 60, MPI.COMM_SELF


def near_identity(size: int = SIZE, share: float = 0.5, seed: int = 1) -> np.ndarray:
    """I + E, unsymmetric, E of the spectral norm ``share``: condition (1 + share)/(1 - share)."""
    e = np.random.default_rng(seed).normal(size=(size, size))
    return np.eye(size) + share / np.linalg.norm(e, 2) * e


def vector(size: int = SIZE, seed: int = 2) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=size)


class Counted:
    """A matrix that counts its products and hands out what may be overwritten, as S does."""

    def __init__(self, matrix: np.ndarray) -> None:
        self.matrix, self.products = matrix, 0

    def __call__(self, x: np.ndarray) -> np.ndarray:
        self.products += 1
        return self.matrix @ x


def residual(matrix: np.ndarray, x: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(b - matrix @ x) / np.linalg.norm(b))


@pytest.mark.parametrize("size", [1, 2, 3, 17, SIZE])
@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_solves_what_numpy_solves(size, share):
    matrix, b = near_identity(size, share), vector(size)
    x, products = gmres(Counted(matrix), b, tolerance=1e-14, most=200, comm=SELF)
    exact = np.linalg.solve(matrix, b)
    np.testing.assert_allclose(x, exact, rtol=0, atol=1e-12 * (1.0 + abs(exact).max()))
    assert 1 <= products <= size


def test_far_from_the_identity():
    # Random, of condition some hundreds: takes all the products that there are dimensions.
    matrix = np.random.default_rng(3).normal(size=(40, 40))
    b = vector(40)
    x, products = gmres(Counted(matrix), b, tolerance=1e-13, most=100, comm=SELF)
    assert residual(matrix, x, b) < 1e-12
    np.testing.assert_allclose(
        x, np.linalg.solve(matrix, b), rtol=0, atol=1e-13 * np.linalg.cond(matrix) * abs(x).max()
    )
    assert products == 40


def test_the_identity_takes_one_product():
    b = vector()
    x, products = gmres(Counted(np.eye(SIZE)), b, tolerance=1e-15, most=10, comm=SELF)
    np.testing.assert_allclose(x, b, rtol=1e-15)
    assert products == 1


@pytest.mark.parametrize("count", [1, 2, 5])
def test_as_many_products_as_there_are_eigenvalues(count):
    # The minimal polynomial of a diagonalisable matrix has that degree.
    matrix = np.diag(np.tile(np.arange(1.0, count + 1.0), 12)[:SIZE])
    b = vector()[: len(matrix)]
    x, products = gmres(Counted(matrix), b, tolerance=1e-13, most=50, comm=SELF)
    np.testing.assert_allclose(x, b / matrix.diagonal(), rtol=1e-12)
    assert products == count


def test_no_right_hand_side_no_work():
    matrix = Counted(near_identity())
    x, products = gmres(matrix, np.zeros(SIZE), tolerance=1e-10, most=10, comm=SELF)
    np.testing.assert_array_equal(x, np.zeros(SIZE))
    assert products == matrix.products == 0
    x, products = gmres(matrix, np.zeros(0), tolerance=1e-10, most=10, comm=SELF)
    assert (len(x), products) == (0, 0)


@pytest.mark.parametrize("tolerance", [0.3, 1e-2, 1e-5, 1e-9])
def test_stops_at_the_tolerance(tolerance):
    # One product less does not reach it: residuals of GMRES are the smallest of their space.
    matrix, b = near_identity(), vector()
    counted = Counted(matrix)
    x, products = gmres(counted, b, tolerance=tolerance, most=SIZE, comm=SELF)
    assert counted.products == products
    assert residual(matrix, x, b) <= 1.000001 * tolerance
    before, _ = gmres(Counted(matrix), b, tolerance=0.0, most=products - 1, comm=SELF)
    assert products == 1 or residual(matrix, before, b) > tolerance


def test_what_is_spent_buys_the_best_of_the_space():
    # The least squares over b, A b, ... A^(k-1) b, by NumPy.
    matrix, b = near_identity(), vector()
    sizes = []
    for most in range(1, 9):
        x, products = gmres(Counted(matrix), b, tolerance=0.0, most=most, comm=SELF)
        assert products == most
        space = [b]
        while len(space) < most:
            space.append(matrix @ space[-1])
        q, _ = np.linalg.qr(np.column_stack(space))
        weights = np.linalg.lstsq(matrix @ q, b, rcond=None)[0]
        np.testing.assert_allclose(x, q @ weights, rtol=0, atol=1e-11 * abs(x).max())
        sizes.append(residual(matrix, x, b))
    assert all(after < 0.7 * before for before, after in pairwise(sizes))


def test_scales_with_the_right_hand_side():
    # Relative to b: forces may be of any size.
    matrix, b = near_identity(), vector()
    x, products = gmres(Counted(matrix), b, tolerance=1e-8, most=SIZE, comm=SELF)
    for factor in (1e-150, 1e-20, 1e20, 1e150):
        scaled, again = gmres(Counted(matrix), factor * b, tolerance=1e-8, most=SIZE, comm=SELF)
        np.testing.assert_allclose(scaled / factor, x, rtol=0, atol=1e-13 * abs(x).max())
        assert again == products


def test_leaves_the_right_hand_side_alone():
    b = vector()
    given = b.copy()
    gmres(Counted(near_identity()), b, tolerance=1e-10, most=50, comm=SELF)
    x, _ = gmres(Counted(near_identity()), np.zeros(3), tolerance=1e-10, most=50, comm=SELF)
    x += 1.0
    np.testing.assert_array_equal(b, given)


def test_a_singular_system_gives_what_can_be_had():
    # diag(0, 1, ..., 1): b along the other axes is solved, and nothing becomes NaN where it is not.
    matrix = np.diag([0.0, *np.ones(9)])
    b = np.array([0.0, *np.arange(1.0, 10.0)])
    x, _ = gmres(Counted(matrix), b, tolerance=1e-12, most=10, comm=SELF)
    np.testing.assert_allclose(x, b, rtol=1e-12)
    b[0] = 1.0
    x, _ = gmres(Counted(matrix), b, tolerance=1e-12, most=10, comm=SELF)
    assert np.all(np.isfinite(x))
    assert np.linalg.norm(b - matrix @ x) <= np.linalg.norm(b)


@pytest.mark.parametrize("factor", [1e-150, 1e-20, 1e20, 1e150])
def test_scales_with_the_matrix(factor):
    # Compliances may be of any size: the solution is that of the matrix itself over the factor.
    matrix, b = near_identity(), vector()
    x, products = gmres(Counted(matrix), b, tolerance=1e-8, most=SIZE, comm=SELF)
    scaled, again = gmres(Counted(factor * matrix), b, tolerance=1e-8, most=SIZE, comm=SELF)
    np.testing.assert_allclose(factor * scaled, x, rtol=0, atol=1e-13 * abs(x).max())
    assert again == products


def test_what_a_matrix_makes_zero_cannot_be_had():
    # A b = 0: one product tells that, and x = 0 is as good as any multiple of b.
    x, products = gmres(
        Counted(np.diag([0.0, 1.0, 1.0])), np.eye(3)[0], tolerance=1e-12, most=3, comm=SELF
    )
    np.testing.assert_array_equal(x, np.zeros(3))
    assert products == 1


def test_a_nilpotent_matrix_does_not_break_it_down():
    # A shift: no progress until the last product, which then solves (a cycle of n).
    size = 8
    matrix = np.roll(np.eye(size), 1, axis=0)
    b = np.eye(size)[0]
    x, products = gmres(Counted(matrix), b, tolerance=1e-12, most=20, comm=SELF)
    np.testing.assert_allclose(x, np.linalg.solve(matrix, b), atol=1e-12)
    assert products == size


class Counting:
    """A communicator that counts what is asked of it but for its size."""

    def __init__(self, comm: Any) -> None:
        self._comm, self.size, self.calls = comm, comm.size, 0

    def __getattr__(self, name: str) -> Any:
        self.calls += 1
        return getattr(self._comm, name)


def part_of(comm: Any, owner: int | None) -> slice:
    """The rank's unknowns: an equal part, or all on one rank and none on the others."""
    ends = np.linspace(0, SIZE, comm.size + 1).astype(int)
    if owner is not None:
        ends[1:-1] = SIZE if owner == 0 else 0
    return slice(ends[comm.rank], ends[comm.rank + 1])


@pytest.mark.mpi
@pytest.mark.parametrize("owner", [None, 0, -1])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-13])
@pytest.mark.parametrize("share", [0.1, 0.99, 10.0])
def test_ranks_do_not_matter(comm, share, tolerance, owner):
    # 10: far from the identity, of condition some hundreds.
    matrix, b, part = near_identity(share=share), vector(), part_of(comm, owner)
    limits = {"tolerance": tolerance, "most": 2 * SIZE}
    mine, products = gmres(lambda x: matrix[part] @ all_of(comm, x), b[part], comm=comm, **limits)
    x, expected = gmres(Counted(matrix), b, **limits, comm=SELF)
    error = 1e-13 * np.linalg.cond(matrix) * abs(x).max()
    np.testing.assert_allclose(all_of(comm, mine), x, rtol=0, atol=error)
    assert products == expected


@pytest.mark.mpi
@pytest.mark.parametrize(("share", "more"), [(0.5, 1), (1e-3, 2)])
def test_the_ranks_wait_once_in_a_product(comm, share, more):
    # Once more for the size of b; and for the first direction, of which next to nothing is left
    # beside b where the matrix is that near to the identity.
    matrix, b, part = near_identity(share=share), vector(), part_of(comm, None)
    counting = Counting(comm)
    apply = Counted(matrix[part])
    _, products = gmres(
        lambda x: apply(all_of(comm, x)), b[part], tolerance=1e-9, most=SIZE, comm=counting
    )
    assert apply.products == products > 2
    assert counting.calls == (products + more if comm.size > 1 else 0)
