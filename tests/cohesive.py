# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A cohesive law in UFL and by hand, and the energies of a run from its states.

The law is Xu and Needleman's (1994) with q = 1 and r = 0, without history:

    psi = phi - phi (1 + n/a) exp(-n/a) exp(-|s|^2/b^2).
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import ufl
from petsc4py import PETSc

from dolfinx_joints import MatrixSystem
from dolfinx_joints.laws.law import Floats, JointState, Response, Status
from dolfinx_joints.laws.path_mean import path_mean
from dolfinx_joints.simulation.record import Record

PHI, A, B = 100.0, 1e-4, 2e-4  # [J/m^2], [m], [m]: 1 MPa / e at a
K_N, K_S = PHI / A**2, 2.0 * PHI / B**2  # at the gap of zero


def cohesive(g: Any) -> Any:
    """Psi in UFL [J/m^2] of the gap (n, s1, s2)."""
    s = g[1] ** 2 + g[2] ** 2
    return PHI - PHI * (1.0 + g[0] / A) * ufl.exp(-g[0] / A) * ufl.exp(-s / B**2)


COHESIVE = {"normal_stiffness": K_N, "shear_stiffness": K_S}


class ByHand:
    """The cohesive law with traction and tangent derived by hand."""

    def closed_stiffness(self) -> tuple[float, float]:
        """k_n and k_s at the gap of zero, [Pa/m]."""
        return K_N, K_S

    def stored_energy(self, state: JointState) -> Floats:
        """Psi, shape (n,), [J/m^2]."""
        n, s = state.gap[:, 0] / A, state.elastic_slip / B
        return PHI - PHI * (1.0 + n) * np.exp(-n - (s**2).sum(axis=1))

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """Traction and tangent at a gap of shape (n, 3), [m]."""
        after = self._after(gap, state)
        return self._response(after, *self._tractions(self._seen(after)))

    def discrete_gradient(self, gap: Floats, state: JointState) -> Response:
        """Mean traction over the path to a gap of shape (n, 3), [m]."""
        after = self._after(gap, state)
        mean = path_mean(self._tractions, self._seen(state), self._seen(after))
        return self._response(after, *mean)

    def _tractions(self, g: Floats) -> tuple[Floats, Floats]:
        n, s = g[:, 0] / A, g[:, 1:] / B
        bell = PHI * np.exp(-n - (s**2).sum(axis=1))
        t = np.column_stack([bell * n / A, 2.0 * (bell * (1.0 + n))[:, None] * s / B])
        d = np.empty((len(g), 3, 3))
        d[:, 0, 0] = bell * (1.0 - n) / A**2
        d[:, 0, 1:] = d[:, 1:, 0] = -2.0 * (bell * n)[:, None] * s / (A * B)
        both = np.eye(2) - 2.0 * s[:, :, None] * s[:, None, :]
        d[:, 1:, 1:] = 2.0 * (bell * (1.0 + n))[:, None, None] * both / B**2
        return t, d

    def _seen(self, state: JointState) -> Floats:
        return np.column_stack([state.gap[:, 0], state.elastic_slip])

    def _after(self, gap: Floats, state: JointState) -> JointState:
        return JointState(gap=gap, elastic_slip=state.elastic_slip + (gap - state.gap)[:, 1:])

    def _response(self, after: JointState, traction: Floats, tangent: Floats) -> Response:
        status = np.where(after.gap[:, 0] > 0.0, Status.OPEN, Status.STICK).astype(np.int8)
        nothing = np.zeros(len(after.gap))
        return Response(
            traction=traction, tangent=tangent, state=after, dissipation=nothing, status=status
        )


def random_steps(count: int = 3000, seed: int = 1, *, size: float = A) -> tuple[Floats, JointState]:
    """Random gaps at the end of a step, and states at its start."""
    rng = np.random.default_rng(seed)
    before = size * rng.normal(size=(count, 3))
    slip = before[:, 1:] + size * rng.normal(size=(count, 2))
    return before + size * rng.normal(size=(count, 3)), JointState(gap=before, elastic_slip=slip)


def energy_lines(
    system: MatrixSystem, records: Sequence[Record], density: Callable[[JointState], Floats]
) -> list[dict[str, float]]:
    """Energies and works of each record from matrices and states, [J] (collective).

    Args:
        system: The system, without moving supports.
        records: All steps of a run of the energy-consistent scheme, from its start on.
        density: Stored energy of the joint points, shape (n,), [J/m^2].
    """

    def product(matrix: PETSc.Mat, vector: PETSc.Vec) -> float:
        out = vector.duplicate()
        matrix.mult(vector, out)
        return float(out.dot(vector))

    viscous, given, lines = 0.0, 0.0, []
    for before, now in pairwise([records[0], *records]):
        moved = now.displacement.copy()
        moved.axpy(-1.0, before.displacement)
        force = 0.5 * sum(system.load(r.time, moved.duplicate()).dot(moved) for r in (before, now))
        given += force
        if now is not before:
            viscous += product(system.damping, moved) / (now.time - before.time)
        areas = system.contact.operator.areas
        lines.append(
            {
                "kinetic": 0.5 * product(system.mass, now.velocity),
                "strain": 0.5 * product(system.stiffness, now.displacement),
                "joint": moved.comm.tompi4py().allreduce(areas @ density(now.joints.state)),
                "input": given,
                "viscous": viscous,
                "friction": 0.0,
                "numerical": 0.0,
            }
        )
    return lines


def left_over(first: dict[str, float], line: dict[str, float]) -> float:
    """Return the energy error of a record: the sum of its lines since the first record, [J]."""
    stored = sum(line[name] - first[name] for name in ("kinetic", "strain", "joint"))
    return stored - line["input"] + line["viscous"] + line["friction"]
