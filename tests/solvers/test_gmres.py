# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""PETSc's GMRES, set up as the joints need it: its tolerance, its limit, singular systems."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("petsc4py")

from dolfinx_joints.solvers.interface.gmres import Gmres

SIZE = 60


def near_identity(size: int = SIZE, share: float = 0.5, seed: int = 1) -> np.ndarray:
    """I + E, unsymmetric, E of the spectral norm ``share``: condition (1 + share)/(1 - share)."""
    e = np.random.default_rng(seed).normal(size=(size, size))
    return np.eye(size) + share / np.linalg.norm(e, 2) * e


def vector(size: int = SIZE, seed: int = 2) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=size)


def residual(matrix: np.ndarray, x: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(b - matrix @ x) / np.linalg.norm(b))


def solved(matrix: np.ndarray, b: np.ndarray, tolerance: float = 1e-12, most: int = 200):
    """Solution, and the products it took."""
    return Gmres().solve(lambda v: matrix @ v, b, tolerance=tolerance, most=most)


@pytest.mark.parametrize("size", [1, 2, 3, 17, SIZE])
@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_solves_what_numpy_solves(size, share):
    matrix, b = near_identity(size, share), vector(size)
    x, products = solved(matrix, b, 1e-14)
    exact = np.linalg.solve(matrix, b)
    np.testing.assert_allclose(x, exact, rtol=0, atol=1e-12 * (1.0 + abs(exact).max()))
    assert 1 <= products <= size


def test_sizes_may_change_from_solve_to_solve():
    gmres = Gmres()
    for size in (5, 17, 5):
        matrix, b = near_identity(size), vector(size)
        x, _ = gmres.solve(lambda v, matrix=matrix: matrix @ v, b, tolerance=1e-13, most=100)
        np.testing.assert_allclose(x, np.linalg.solve(matrix, b), rtol=1e-10)


def test_no_right_hand_side_no_work():
    for size in (0, SIZE):
        x, products = solved(near_identity(), np.zeros(size))
        np.testing.assert_array_equal(x, np.zeros(size))
        assert products == 0


@pytest.mark.parametrize("tolerance", [0.3, 1e-2, 1e-5, 1e-9])
def test_stops_at_the_tolerance(tolerance):
    # One product less does not reach it: residuals of GMRES are the smallest of their space.
    matrix, b = near_identity(), vector()
    x, products = solved(matrix, b, tolerance)
    assert residual(matrix, x, b) <= 1.000001 * tolerance
    if products > 1:
        before, spent = solved(matrix, b, 0.0, products - 1)
        assert spent == products - 1
        assert residual(matrix, before, b) > tolerance


def test_a_singular_system_gives_what_can_be_had():
    # diag(0, 1, ..., 1): b along the other axes is solved, and nothing becomes NaN where it is not.
    matrix = np.diag([0.0, *np.ones(9)])
    b = np.array([0.0, *np.arange(1.0, 10.0)])
    np.testing.assert_allclose(solved(matrix, b)[0], b, rtol=1e-12)
    b[0] = 1.0
    x, _ = solved(matrix, b)
    assert np.all(np.isfinite(x))
    assert np.linalg.norm(b - matrix @ x) <= np.linalg.norm(b)


def test_nan_is_handed_on():
    matrix = near_identity()
    matrix[3, 3] = np.nan
    assert np.isnan(solved(matrix, vector())[0]).all()
