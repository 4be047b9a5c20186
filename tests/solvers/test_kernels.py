# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled kernels of the solvers against NumPy."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mpi4py")
pytest.importorskip("numba")

from mpi4py import MPI

from dolfinx_joints.solvers.compliance.blocks_between_ranks import (
    DENSE,
    FACTOR,
    PLACE,
    add_at_places,
    expand,
    expand_and_return,
    reduce,
)
from dolfinx_joints.solvers.compliance.low_rank import Shares
from dolfinx_joints.solvers.compliance.row_matrix import RowMatrix
from dolfinx_joints.solvers.interface import corrections, joint_step

RANDOM = np.random.default_rng(20)


def test_products_between_ranks():
    # 12 unknowns: a factor of the first six, two dense blocks of one panel, the places of three.
    factor, dense = RANDOM.normal(size=(2, 6)), RANDOM.normal(size=(2, 3, 6))
    shares = Shares(np.float64)
    shares.add(0, 6, factor, FACTOR, 0)
    shares.add(3, 6, dense[0], DENSE, 0)
    shares.add(0, 6, dense[1], DENSE, 0)
    shares.add(9, 3, None, PLACE, 1)
    matrix = np.zeros((8, 12))
    matrix[:2, :6], matrix[2:5, 3:9], matrix[5:, 9:] = factor, dense[0], np.eye(3)
    matrix[2:5, :6] += dense[1]
    x, values = RANDOM.normal(size=12), RANDOM.normal(size=8)
    reduced, expanded = np.zeros(shares.length), np.ones(12)
    reduce(*shares.arrays, x, reduced, True)
    expand(*shares.arrays, values, expanded)
    # The same with dense blocks read once.
    gone, once, back = np.zeros(shares.length), np.ones(12), np.zeros(shares.length)
    reduce(*shares.arrays, x, gone, False)
    expand_and_return(*shares.arrays, values, x, once, back)
    add_at_places(shares.arrays[0], values, once)
    for down, up in ((reduced, expanded), (gone + back, once)):
        np.testing.assert_allclose(down, matrix @ x, atol=1e-14)
        np.testing.assert_allclose(up, 1.0 + matrix.T @ values, atol=1e-14)


@pytest.mark.parametrize("count", [0, 1, 4, 7])
def test_products_with_few_rows(count):
    whole = RANDOM.normal(size=(9, 9))
    whole += whole.T
    matrix = RowMatrix.of(whole, MPI.COMM_SELF, 9)
    rows = np.sort(RANDOM.permutation(9)[:count])
    values = np.zeros(9)
    values[rows] = RANDOM.normal(size=count)
    np.testing.assert_allclose(matrix.product(values, rows), whole @ values, atol=1e-12)


def test_blocks_of_points():
    tangent, values = RANDOM.normal(size=(5, 3, 3)), RANDOM.normal(size=15)
    turned = corrections._times_blocks(tangent, values)
    np.testing.assert_allclose(
        turned, np.einsum("nij,nj->ni", tangent, values.reshape(5, 3)).ravel()
    )


def test_scaled_residuals():
    force, coupled, scale, areas = RANDOM.normal(size=12), *RANDOM.random((3, 12))
    carried, tangent = RANDOM.normal(size=(4, 3)), RANDOM.normal(size=(4, 3, 3))
    root = np.where(np.isin(np.arange(12), [5, 9, 10, 11]), 0.0, areas * scale)  # dead directions
    scale[root == 0.0] = 0.0
    given = (force, coupled, 2.0 * carried, carried, tangent, scale, root)
    residual, scaled, sizes = np.empty(12), np.empty((4, 3, 3)), np.zeros(6)
    joint_step._residual(*given, residual, scaled, sizes)
    assert not residual[root == 0.0].any()
    assert not scaled[3].any()
    assert residual[0] == pytest.approx(force[0] - root[0] * carried[0, 0])
    assert scaled[1, 0, 1] == pytest.approx(root[3] * tangent[1, 0, 1] * scale[4])
    largest = np.abs(2.0 * root * carried.ravel()).max()
    expected = [largest, *(np.abs(each).max() for each in (residual, force, coupled))]
    np.testing.assert_allclose(sizes[:4], expected)
    assert sizes[4] == pytest.approx(residual @ residual)
