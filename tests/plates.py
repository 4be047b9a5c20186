# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points on parallel plates, a smooth kernel between the points, and its compressed matrix."""

from mpi4py import MPI

import numpy as np
import pytest

pytest.importorskip("numba")
from dolfinx_joints.solvers.compliance.low_rank import LowRankMatrix


def plates(across: int = 14, joints: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Points of parallel square plates 1 apart, in random order, and the joint of each."""
    side = np.linspace(0.0, 4.0, across)
    grid = np.stack(np.meshgrid(np.arange(joints), side, side, indexing="ij"), axis=-1)
    points = grid.reshape(-1, 3)
    shuffled = np.random.default_rng(2).permutation(len(points))
    points = points[shuffled]
    return points, points[:, 0].astype(int)


def kernel(points: np.ndarray, joint: np.ndarray, *, symmetric: bool = True) -> np.ndarray:
    """Smooth positive definite matrix, zero between joints without a common body."""
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    near = np.abs(joint[:, None] - joint[None]) <= 1
    own = np.array([[2.0, 0.3, 0.1], [0.3, 1.0, 0.2], [0.1, 0.2, 1.5]])
    if not symmetric:
        own[0, 1] = -0.3
    size = 10.0 ** (points[:, 1] / 4.0)  # a diagonal that varies by a factor of 100
    blocks = near * np.exp(-distance) * np.where(distance > 0.0, 0.2, 1.0)
    return 1e-10 * np.kron(size[:, None] * blocks * size[None], own)


def compressed(matrix: np.ndarray, points: np.ndarray, **options) -> LowRankMatrix:
    options.setdefault("scale", np.sqrt(matrix.diagonal()))
    return LowRankMatrix(lambda numbers: matrix[:, numbers], points, MPI.COMM_SELF, **options)
