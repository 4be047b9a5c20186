# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compliance and tangents of random joint points: open, sticking and sliding."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mpi4py")
pytest.importorskip("numba")
pytest.importorskip("scipy")

from whole_vectors import all_of, own_part

from dolfinx_joints.solvers.compliance.row_matrix import RowMatrix
from dolfinx_joints.solvers.interface.corrections import (
    CompiledCorrections,
    Correction,
    KrylovCorrections,
)

POINTS = 40


def scaled_compliance(seed: int = 1, *, dead: np.ndarray | None = None) -> np.ndarray:
    """Return S = G - I of random points on a plate, with positive definite G, diagonal about 1."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0.0, 4.0, (POINTS, 2))
    distance = np.linalg.norm(places[:, None] - places[None], axis=2)
    own = np.array([[1.0, 0.2, -0.1], [0.2, 0.9, 0.1], [-0.1, 0.1, 1.1]])
    s = np.kron(np.exp(-2.0 * distance), own) - np.eye(3 * POINTS)
    if dead is not None:
        s[dead.ravel()] = 0.0
        s[:, dead.ravel()] = 0.0
    return s


def stuck_tangent(stiffness: float, *, shear: float = 0.4) -> np.ndarray:
    """T0 = c / (c + 1/k) for c = 1, shape (points, 3)."""
    k = np.array([stiffness, shear * stiffness, shear * stiffness])
    with np.errstate(divide="ignore"):
        return np.tile(1.0 / (1.0 + 1.0 / k), (POINTS, 1))


def tangents(status: np.ndarray, stuck: np.ndarray, seed: int = 3) -> np.ndarray:
    """Tangents of open (0), sticking (1) and sliding (2) points; sliding ones with mu = tan 30."""
    rng = np.random.default_rng(seed)
    angle, part = rng.uniform(0.0, 2.0 * np.pi, POINTS), rng.uniform(0.0, 1.0, POINTS)
    along = np.column_stack([np.cos(angle), np.sin(angle)])
    blocks = np.zeros((POINTS, 3, 3))
    for i in np.flatnonzero(status):
        blocks[i] = np.diag(stuck[i])
        if status[i] == 2:
            m = along[i]
            blocks[i, 1:, 0] = -0.577 * stuck[i, 0] * m
            blocks[i, 1:, 1:] = part[i] * stuck[i, 1] * (np.eye(2) - np.outer(m, m))
    return blocks


def states(kind: str, seed: int = 4) -> np.ndarray:
    """Random status of the points, with given shares of open, sticking and sliding points."""
    shares = {
        "open": [1.0, 0.0, 0.0],
        "one closed": [1.0, 0.0, 0.0],
        "mostly open": [0.8, 0.1, 0.1],
        "mixed": [0.3, 0.4, 0.3],
        "mostly stuck": [0.05, 0.9, 0.05],
        "stuck": [0.0, 1.0, 0.0],
        "sliding": [0.0, 0.0, 1.0],
    }[kind]
    status = np.random.default_rng(seed).choice(3, POINTS, p=shares)
    if kind == "one closed":
        status[7] = 2
    return status


def row_matrix(whole: np.ndarray, comm: Any, local: int | None = None) -> RowMatrix:
    """Distribute a symmetric matrix: ``local`` rows on this rank, or equal numbers of points."""
    if local is None:
        ends = 3 * np.linspace(0, len(whole) // 3, comm.size + 1).astype(int)
        local = int(np.diff(ends)[comm.rank])
    return RowMatrix.of(whole, comm, local)


def right_side(kind: str = "all", seed: int = 5) -> np.ndarray:
    r = np.random.default_rng(seed).normal(size=3 * POINTS)
    if kind == "few":
        r[np.random.default_rng(seed).permutation(3 * POINTS)[9:]] = 0.0
    return r


class WholeCorrections:
    """Corrections on several ranks, with vectors of all points as input and output.

    Args:
        split: S.
        stuck: T0 of all points for compiled corrections with W, or None without W.
        comm: Communicator.
        krylov: Whether PETSc's GMRES solves for the corrections.
        rough: A less accurate S for GMRES.
        rigid: Whether joints are rigid.
    """

    def __init__(
        self,
        split: Any,
        stuck: np.ndarray | None,
        comm: Any,
        *,
        krylov: bool = False,
        rough: Any = None,
        rigid: bool = False,
    ) -> None:
        self._comm, self._points = comm, split.local // 3
        given: Any = SimpleNamespace(
            split=split,
            rough=rough,
            keeps_rows=False,
            effective=SimpleNamespace(symmetric=True),
            forms=None,
        )
        self.of_rank: CompiledCorrections | KrylovCorrections
        if krylov:
            self.of_rank = KrylovCorrections(given, rigid, comm)
        else:
            own_stuck = None if stuck is None else self._own(stuck)
            self.of_rank = CompiledCorrections(given, own_stuck, comm)

    def _own(self, every: np.ndarray) -> np.ndarray:
        return own_part(self._comm, every, self._points)

    def solve(self, residual: np.ndarray, tangent: np.ndarray, tolerance: float) -> Correction:
        own_residual = self._own(residual.reshape(-1, 3)).ravel()
        own = self.of_rank.solve(own_residual, self._own(tangent), 0.0, tolerance, couples=True)
        step, coupled = (all_of(self._comm, part) for part in (own.step, own.coupled))
        return Correction(step, coupled, own.error)
