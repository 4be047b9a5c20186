# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Explicit central differences for a jointed body, as a reference for work and error.

The mass is lumped by row sums. The joints have elastic contact with friction. Stiffness-
proportional damping acts on the velocity of the last half step:

    M a_n = f - K (u_n + beta v_{n-1/2}) - B^T (w t(B u_n)),
    v_{n+1/2} = v_{n-1/2} + dt a_n,    u_{n+1} = u_n + dt v_{n+1/2}.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from petsc4py import PETSc

import dolfinx_joints as dj
from benchmarks.shared.scenes import Acceleration
from dolfinx_joints.simulation.outcome import StaticState

Floats = NDArray[np.float64]

# Step relative to the stability limit, which the power method slightly overestimates.
SAFETY = 0.9
POWER_STEPS = 100


class CentralDifferences:
    """Jointed body with lumped mass, on one rank.

    Args:
        model: The model; all joints have the same `FrictionNoTension`.
        law: Law of the joints.
        beta: Factor of the stiffness in the damping matrix [s].
        static: Initial state, at rest.

    Attributes:
        limit: Longest stable step [s].
    """

    def __init__(
        self, model: dj.Model, law: dj.FrictionNoTension, beta: float, static: StaticState
    ) -> None:
        """Lump the mass and estimate the highest frequencies."""
        system, operator = model.system(), model.operator
        assert operator is not None
        assert static.joints is not None
        self._law, self._beta = law, beta
        self._stiffness, self._jump = _csr(system.stiffness), _csr(operator.matrix)
        self._forces = (-self._jump.T @ sp.diags(np.repeat(operator.areas, 3))).tocsr()
        mass = np.asarray(_csr(system.mass).sum(axis=1)).ravel()
        free = (mass > 0.0).astype(np.float64)
        free[system.constrained] = 0.0
        self._inverse = free / np.where(mass > 0.0, mass, 1.0)
        self._mass, self._u = mass, static.displacement.getArray().copy()
        state = static.joints.state
        self._slip = state.gap[:, 1:] - state.elastic_slip
        traction = static.joints.traction.ravel()
        self._constant = self._stiffness @ self._u - self._forces @ traction
        closed = [law.normal_stiffness, law.shear_stiffness, law.shear_stiffness]
        spring = sp.diags(np.tile(closed, operator.num_points))
        tied = self._stiffness - self._forces @ spring @ self._jump
        bulk, whole = (self._frequency(matrix.tocsr()) for matrix in (self._stiffness, tied))
        ratio = 0.5 * beta * bulk
        self.limit = min(2.0 / whole, 2.0 / bulk * (np.hypot(1.0, ratio) - ratio))

    def march(
        self, dt: float, ground: Acceleration, every: int, records: int
    ) -> Iterator[tuple[Floats, Floats, Floats]]:
        """Yield displacement [m], velocity [m/s] and gap (n, 3) [m] after each ``every`` steps."""
        u, v = self._u, np.zeros_like(self._u)
        rows = np.tile(np.eye(3), len(u) // 3) * self._mass
        for step in range(records * every + 1):
            gap = (self._jump @ u).reshape(-1, 3)
            force = self._constant + self._forces @ self._traction(gap).ravel()
            force -= self._stiffness @ (u + self._beta * v) + ground(step * dt) @ rows
            change = dt * self._inverse * force
            if step and step % every == 0:
                yield u, v + 0.5 * change, gap
            v = v + (change if step else 0.5 * change)
            u = u + dt * v

    def _traction(self, gap: Floats) -> Floats:
        """Return the tractions of a step that ends at a gap, and update the slip."""
        law = self._law
        shear = law.shear_stiffness * (gap[:, 1:] - self._slip)
        normal = law.normal_stiffness * np.minimum(gap[:, 0], 0.0)
        size = np.hypot(shear[:, 0], shear[:, 1])
        mu = np.tan(np.radians(law.friction_angle_deg))
        shear *= np.minimum(1.0, -mu * normal / np.maximum(size, np.finfo(float).tiny))[:, None]
        self._slip = gap[:, 1:] - shear / law.shear_stiffness
        return np.column_stack([normal, shear])

    def _frequency(self, stiffness: sp.csr_matrix) -> float:
        """Return the highest frequency of a stiffness with the lumped mass [rad/s]."""
        x, size = self._inverse * np.random.default_rng(0).standard_normal(len(self._u)), 1.0
        for _ in range(POWER_STEPS):
            x = self._inverse * (stiffness @ x)
            size = float(np.linalg.norm(x))
            x /= size
        return size**0.5


def _csr(matrix: PETSc.Mat) -> sp.csr_matrix:
    """Return a matrix of one rank as a SciPy matrix."""
    plain = matrix if matrix.getType() == "seqaij" else matrix.copy().convert("seqaij")
    return sp.csr_matrix(plain.getValuesCSR()[::-1], shape=plain.getSize())
