# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compressed compliances over the ranks against dense matrices and those of one rank."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mpi4py")
pytest.importorskip("numba")

from plates import compressed, kernel, plates
from whole_vectors import all_of, own_part

from dolfinx_joints.solvers.compliance.low_rank import LowRankMatrix

pytestmark = pytest.mark.mpi

# The second: a rank that owns no points, where there are others.
CASES = [*product([True, False], [None, 0, -1])]
ROUGH = 1e-4


def one_by_one(across: int, joints: int, apart: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Points of one plate of 4 x 4 after the other, along it, and the joint of each."""
    points, joint = plates(across, joints)
    points[:, 0] *= apart
    order = np.lexsort((points[:, 1], joint))
    return points[order], joint[order]


def ranked(
    comm: Any,
    matrix: np.ndarray,
    points: np.ndarray,
    joint: np.ndarray,
    *,
    empty: int | None = None,
    **options: Any,
) -> LowRankMatrix:
    """Points are dealt in equal parts to all ranks, or to all but one."""
    parts = np.ones(comm.size)
    if empty is not None and comm.size > 1:
        parts[empty] = 0.0
    ends = (len(points) * np.cumsum([0.0, *parts]) / parts.sum()).astype(int)
    mine = np.arange(*ends[comm.rank : comm.rank + 2])
    rows = (3 * mine[:, None] + np.arange(3)).ravel()
    return LowRankMatrix(
        lambda numbers: matrix[np.ix_(rows, numbers)],
        points[mine],
        comm,
        scale=np.sqrt(matrix.diagonal())[rows],
        joint=joint[mine],
        **options,
    )


def times(comm: Any, small: LowRankMatrix, vector: np.ndarray) -> np.ndarray:
    """The product of the ranks' matrix with a vector of all."""
    return all_of(comm, small.product(own_part(comm, vector, small.own.size)))


def error(comm: Any, small: LowRankMatrix, matrix: np.ndarray) -> float:
    """Error of a product relative to the vector, both scaled, and divided by what may add up.

    Each block is exact to the tolerance; those in a row or a column are at most as many as there
    are clusters.
    """
    scale = np.sqrt(matrix.diagonal())
    vector = np.random.default_rng(3).standard_normal(len(matrix))
    wrong = times(comm, small, vector / scale) - matrix @ (vector / scale)
    clusters = comm.allreduce(len(small.own.panels))
    return float(np.linalg.norm(wrong / scale) / np.linalg.norm(vector) / clusters)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-12])
@pytest.mark.parametrize(("symmetric", "empty"), CASES)
def test_product_to_the_tolerance(comm, symmetric, empty, tolerance):
    # Five joints: some have points on two ranks.
    points, joint = one_by_one(across=8, joints=5)
    matrix = kernel(points, joint, symmetric=symmetric)
    options = {"leaf": 16, "symmetric": symmetric, "empty": empty, "tolerance": tolerance}
    small = ranked(comm, matrix, points, joint, **options)
    assert error(comm, small, matrix) <= tolerance
    # No more than what is not zero, of two mirrored blocks one: 1 / 15 is on the diagonal.
    dense = np.count_nonzero(matrix) * matrix.itemsize
    assert comm.allreduce(small.nbytes) <= (0.6 if symmetric else 1.0) * dense


@pytest.mark.parametrize(("symmetric", "empty"), CASES)
def test_a_rougher_one(comm, symmetric, empty):
    # Some blocks between ranks, dense and of low rank, become of low rank and of lower.
    points, joint = one_by_one(across=10, joints=5, apart=3.0)
    matrix = kernel(points, joint, symmetric=symmetric)
    options = {"leaf": 25, "symmetric": symmetric, "empty": empty, "tolerance": 1e-8}
    fine = ranked(comm, matrix, points, joint, **options)
    vector = np.random.default_rng(4).standard_normal(len(matrix))
    before = times(comm, fine, vector)
    rough = fine.rougher(ROUGH)
    assert 1e-3 * ROUGH < error(comm, rough, matrix) <= 1.001 * ROUGH
    assert comm.allreduce(rough.nbytes) < 0.5 * comm.allreduce(fine.nbytes)
    np.testing.assert_array_equal(times(comm, fine, vector), before)


@pytest.mark.parametrize("empty", [None, 0])
def test_its_columns_are_those_of_the_products(comm, empty):
    points, joint = one_by_one(across=8, joints=5)
    small = ranked(comm, kernel(points, joint), points, joint, empty=empty, leaf=16, tolerance=1e-6)
    units = np.eye(3 * len(points))
    products = [small.product(own_part(comm, unit, small.own.size)) for unit in units]
    assert small.columns() == pytest.approx(np.array(products), rel=0, abs=1e-12)


@pytest.mark.parametrize("symmetric", [True, False])
def test_blocks_are_those_of_one_rank(comm, symmetric):
    # A joint on each rank: clusters are the same; products add the blocks in another order.
    points, joint = one_by_one(across=10, joints=comm.size, apart=3.0)
    matrix = kernel(points, joint, symmetric=symmetric)
    options = {"leaf": 25, "symmetric": symmetric, "tolerance": 1e-6}
    fine = ranked(comm, matrix, points, joint, **options)
    of_one = compressed(matrix, points, joint=joint, **options)
    rng, scale = np.random.default_rng(5), np.sqrt(matrix.diagonal())
    vector = rng.standard_normal(len(matrix)) / scale
    pairs = [(fine, of_one, 1e-13), (fine.rougher(ROUGH), of_one.rougher(ROUGH), 1e-5)]
    for found, expected, rounding in pairs:
        assert comm.allreduce(found.nbytes) == expected.nbytes
        one, other = (y / scale for y in (times(comm, found, vector), expected.product(vector)))
        np.testing.assert_allclose(one, other, rtol=0, atol=rounding * np.abs(other).max())


def test_mirrored_blocks_are_symmetric(comm):
    points, joint = one_by_one(across=8, joints=5)
    matrix = kernel(points, joint)
    small = ranked(comm, matrix, points, joint, tolerance=1e-2, leaf=16)
    a, b = np.random.default_rng(6).standard_normal((2, len(matrix)))
    assert a @ times(comm, small, b) == pytest.approx(b @ times(comm, small, a), rel=1e-12)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6])
@pytest.mark.parametrize("symmetric", [True, False])
def test_few_numbers_pass_between_ranks_far_apart(comm, symmetric, tolerance):
    # A plate 10 off the next on each rank, and all of it one cluster: as many numbers go to a rank
    # as its block with this one has singular values above the tolerance, by NumPy.
    points, joint = one_by_one(across=14, joints=comm.size, apart=10.0)
    matrix = kernel(points, joint, symmetric=symmetric)
    options = {"leaf": 196, "symmetric": symmetric, "tolerance": tolerance}
    small = ranked(comm, matrix, points, joint, **options)
    scale = np.sqrt(matrix.diagonal())
    scaled = (matrix / scale[:, None] / scale).reshape(comm.size, 588, comm.size, 588)
    others = [rank for rank in range(comm.size) if abs(rank - comm.rank) == 1]
    values = [np.linalg.svd(scaled[rank, :, comm.rank], compute_uv=False) for rank in others]
    expected = sum(int(np.count_nonzero(each > tolerance)) for each in values)
    assert small.sent == expected
    assert (expected > 0) == (comm.size > 1)
    assert expected <= 0.1 * 588 * len(others)
    assert error(comm, small, matrix) <= tolerance


@pytest.mark.parametrize("symmetric", [True, False])
def test_unknowns_of_dense_blocks_pass_once(comm, symmetric):
    # One plate over all ranks to no tolerance: every block is dense, several in each panel. What
    # passes are the unknowns of the columns' rank, or for the mirror image the sums at these.
    points, joint = one_by_one(across=16, joints=1)
    matrix = kernel(points, joint, symmetric=symmetric)
    small = ranked(comm, matrix, points, joint, leaf=8, symmetric=symmetric, tolerance=0.0)
    sizes = comm.allgather(small.own.size)
    first = [min(comm.rank, other) if symmetric else comm.rank for other in range(comm.size)]
    assert small.sent == sum(sizes[rank] for rank in first) - sizes[comm.rank]
    assert error(comm, small, matrix) <= 1e-15


def test_nothing_passes_where_nothing_couples(comm):
    # Two apart in their order, joints share no body; points that are held have zero rows.
    points, joint = one_by_one(across=8, joints=comm.size)
    loose = ranked(comm, kernel(points, 2 * joint), points, joint, leaf=16)
    assert loose.sent == 0
    matrix, held = kernel(points, joint), slice(0, 3 * 64)
    matrix[held] = matrix[:, held] = 0.0
    small = ranked(comm, matrix, points, joint, leaf=16)
    assert small.sent == 0 or comm.rank > 0
    found = times(comm, small, np.ones(len(matrix)))
    np.testing.assert_allclose(found, matrix @ np.ones(len(matrix)), rtol=1e-10, atol=0)
    assert not found[held].any()
