# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compressed compliances against the dense matrices that they stand for."""

from __future__ import annotations

from itertools import pairwise

from mpi4py import MPI

import numpy as np
import pytest

pytest.importorskip("numba")

from plates import compressed, kernel, plates

from dolfinx_joints.solvers.compliance.low_rank import LowRankMatrix
from dolfinx_joints.solvers.compliance.own_blocks import clusters


def scaled_error(matrix: np.ndarray, small: LowRankMatrix) -> float:
    """Spectral norm of the error of the matrix scaled to a unit diagonal."""
    scale = np.sqrt(matrix.diagonal())
    scale[scale == 0.0] = 1.0
    identity = np.eye(len(matrix))
    error = np.column_stack([small.product(column) for column in identity]) - matrix
    return float(np.linalg.norm(error / scale[:, None] / scale, 2))


@pytest.mark.parametrize("leaf", [1, 7, 48])
def test_clusters_are_a_partition(leaf):
    points, joint = plates()
    order, trees = clusters(points, leaf, joint)
    assert sorted(order) == list(range(len(points)))
    leaves = [cluster for tree in trees for cluster in tree.leaves()]
    assert leaves[0].start == 0
    assert leaves[-1].stop == len(points)
    for before, after in pairwise(leaves):
        assert before.stop == after.start
    for cluster in leaves:
        inside = points[order[cluster.start : cluster.stop]]
        assert 1 <= len(inside) <= leaf
        np.testing.assert_array_equal(inside.min(axis=0), cluster.low)
        np.testing.assert_array_equal(inside.max(axis=0), cluster.high)
        assert len(set(joint[order[cluster.start : cluster.stop]])) == 1


def test_clusters_are_cut_across_their_longest_edge():
    # 2 x 8 x 3 points 1 apart: first across y, 7 long; then 2 x 4 x 3 across y again, 3 long; then
    # 2 x 2 x 3 across z, 2 long, where the middle of 12 sorted points is within a layer.
    grid = np.stack(np.meshgrid(range(2), range(8), range(3), indexing="ij"), axis=-1)
    points = grid.reshape(-1, 3).astype(float)
    _, (tree,) = clusters(points, 6)
    lower, upper = tree.halves
    assert (lower.high[1], upper.low[1]) == (3.0, 4.0)
    for half in tree.halves:
        first, second = half.halves
        assert second.low[1] - first.high[1] == 1.0
        for quarter in half.halves:
            down, up = quarter.halves
            assert (down.high[2], up.low[2]) == (1.0, 1.0)
            np.testing.assert_array_equal(down.low[:2], up.low[:2])


def test_points_in_one_place_are_cut_all_the_same():
    order, (tree,) = clusters(np.zeros((10, 3)), 3)
    assert sorted(order) == list(range(10))
    assert max(cluster.stop - cluster.start for cluster in tree.leaves()) <= 3


def test_no_points():
    assert clusters(np.empty((0, 3)))[1] == []
    small = compressed(np.empty((0, 0)), np.empty((0, 3)))
    assert small.product(np.empty(0)).shape == (0,)
    assert small.columns().shape == (0, 0)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-8, 1e-12])
@pytest.mark.parametrize("symmetric", [True, False])
def test_product_to_the_tolerance(tolerance, symmetric):
    # Each block is exact to the tolerance in the spectral norm; those of a row of clusters add up,
    # and there are fewer than 25 clusters.
    points, joint = plates()
    matrix = kernel(points, joint, symmetric=symmetric)
    options = {"joint": joint, "tolerance": tolerance, "leaf": 32, "symmetric": symmetric}
    small = compressed(matrix, points, **options)
    scale = np.sqrt(matrix.diagonal())
    vector = np.random.default_rng(3).standard_normal(len(matrix)) / scale
    error = (small.product(vector) - matrix @ vector) / scale
    assert np.linalg.norm(error) <= 25 * tolerance * np.linalg.norm(vector * scale)


def test_single_precision():
    # The unit diagonal rounds to 6e-8, the tolerance is 1e-4 for each of at most 12 clusters.
    points, joint = plates(across=10)
    matrix = kernel(points, joint)
    small = compressed(matrix, points, joint=joint, tolerance=1e-4, dtype=np.float32, leaf=32)
    assert 1e-8 < scaled_error(matrix, small) <= 12e-4
    double = compressed(matrix, points, joint=joint, tolerance=1e-4, leaf=32)
    assert small.nbytes == double.nbytes // 2


def test_looser_and_larger_take_less():
    # Ranks grow with the digits and hardly with the points; half of the matrix is mirrored.
    parts = {}
    for across in (14, 28):
        points, joint = plates(across, joints=1)
        matrix = kernel(points, joint)
        for tolerance in (1e-3, 1e-6, 1e-12):
            small = compressed(matrix, points, joint=joint, tolerance=tolerance, leaf=16)
            parts[across, tolerance] = small.nbytes / matrix.nbytes
    for across in (14, 28):
        assert parts[across, 1e-3] < parts[across, 1e-6] < parts[across, 1e-12] <= 0.55
    for tolerance in (1e-3, 1e-6, 1e-12):
        assert parts[28, tolerance] < parts[14, tolerance]


def test_no_memory_for_what_is_zero():
    # Of three joints the outer two share no body; each of the others meets one or two, and one of
    # two mirrored blocks is held: 5 of 9 parts, of which the diagonal ones count in full at most.
    points, joint = plates(across=8)
    matrix = kernel(points, joint)
    small = compressed(matrix, points, joint=joint, tolerance=0.0, leaf=64)
    assert small.nbytes == matrix.nbytes * 5 // 9
    np.testing.assert_allclose(small.columns(), matrix, rtol=1e-13, atol=0)


def test_blocks_are_as_small_as_they_can_be():
    # Two clusters of 4 points far from each other, coupled by one product of vectors: two dense
    # blocks of 12 x 12, and between them, once for both mirror images, two factors of 12.
    x = np.array([0.0, 1.0, 2.0, 3.0, 100.0, 101.0, 102.0, 103.0])
    points = np.column_stack([x, np.zeros((8, 2))])
    near = np.eye(12) + 0.02 * np.ones((12, 12))
    matrix = np.block([[near, 0.01 * np.ones((12, 12))], [0.01 * np.ones((12, 12)), near]])
    small = compressed(matrix, points, leaf=4)
    assert small.nbytes == 8 * (2 * 12 * 12 + 2 * 12)
    assert scaled_error(matrix, small) <= 1e-12
    rough = small.rougher(1e-4)
    # The dense blocks, of the identity and one more product, stay what they are.
    assert rough.nbytes == 4 * (2 * 12 * 12 + 2 * 12)
    assert scaled_error(matrix, rough) <= 1e-4


def test_mirrored_blocks_are_symmetric():
    points, joint = plates()
    matrix = kernel(points, joint)
    small = compressed(matrix, points, joint=joint, tolerance=1e-3, leaf=16)
    rng = np.random.default_rng(4)
    a, b = rng.standard_normal((2, len(matrix)))
    assert a @ small.product(b) == pytest.approx(b @ small.product(a), rel=1e-12)


@pytest.mark.parametrize("symmetric", [True, False])
def test_the_whole_is_that_of_the_products(symmetric):
    points, joint = plates(across=10)
    matrix = kernel(points, joint, symmetric=symmetric)
    options = {"joint": joint, "tolerance": 1e-4, "leaf": 16, "symmetric": symmetric}
    small = compressed(matrix, points, **options)
    units = list(np.eye(len(matrix)))
    products = np.column_stack([small.product(column) for column in units])
    size = np.abs(matrix).max()
    for found in (small.columns(), np.column_stack(small.products(units))):
        np.testing.assert_allclose(found, products, rtol=0, atol=1e-12 * size)


def test_points_that_are_held():
    # A clamped point has zero rows and columns, and no scale.
    points, joint = plates(across=8)
    matrix = kernel(points, joint)
    matrix[:, 30:36] = matrix[30:36] = 0.0
    small = compressed(matrix, points, joint=joint, leaf=16)
    assert scaled_error(matrix, small) <= 1e-10
    assert not small.columns()[30:36].any()


def test_panels_are_narrow():
    # The dense matrix never exists: no panel is wider than a leaf, and each column is asked once.
    points, joint = plates()
    matrix, asked = kernel(points, joint), []

    def columns(numbers):
        asked.append(numbers)
        return matrix[:, numbers]

    scale = np.sqrt(matrix.diagonal())
    LowRankMatrix(columns, points, MPI.COMM_SELF, scale=scale, joint=joint, leaf=20)
    assert max(len(numbers) for numbers in asked) <= 60
    np.testing.assert_array_equal(np.sort(np.concatenate(asked)), np.arange(len(matrix)))


def test_a_scale_that_is_an_estimate_will_do():
    points, joint = plates(across=8)
    matrix = kernel(points, joint)
    scale = np.full(len(matrix), np.sqrt(matrix.diagonal().min()))
    small = compressed(matrix, points, scale=scale, joint=joint, leaf=16)
    assert scaled_error(matrix, small) <= 1e-10
