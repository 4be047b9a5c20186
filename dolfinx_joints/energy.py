# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energy ledger of a dynamic run: where every joule went, and how many are missing."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dolfinx_joints.integrators import DynamicState
from dolfinx_joints.laws import Response
from dolfinx_joints.system import MatrixSystem


@dataclass(frozen=True, kw_only=True)
class EnergyRow:
    """Energies at one time, all in [J]; works and losses count from the start of the ledger.

    Attributes:
        kinetic: v.M v / 2.
        strain: u.K u / 2, bulk and springs.
        joint: Elastic energy of the joints.
        input: Work of loads and of moving supports.
        viscous: Work done against the damping.
        friction: Work done against friction.
        error: stored - stored at the start - input + viscous + friction.
    """

    kinetic: float
    strain: float
    joint: float
    input: float
    viscous: float
    friction: float
    error: float

    @property
    def stored(self) -> float:
        """Kinetic, strain and joint energy."""
        return self.kinetic + self.strain + self.joint


class EnergyLedger:
    """Adds up energies and works step by step.

    Works are taken by the trapezoidal rule, du . (F0 + F1) / 2, viscous losses as du.C du / dt:
    with the average-acceleration rule the balance of a linear system is then exact, and what is
    missing comes from joints that opened or closed within a step.

    Attributes:
        row: The newest row.
        relative_error: Largest |error| so far over the largest of stored energy, |input| and
            losses so far.
    """

    def __init__(self, system: MatrixSystem) -> None:
        """Nothing is counted before `start`."""
        self._system = system
        self._work = system.stiffness.createVecRight()

    def start(self, state: DynamicState) -> EnergyRow:
        """Begin at a state (collective)."""
        row = self._stored(state, 0.0, 0.0, 0.0, 0.0)
        self.row = replace(row, error=0.0)
        self._stored_at_start = row.stored
        self._largest_error, self._scale = 0.0, self.row.stored
        return self.row

    def record(self, before: DynamicState, after: DynamicState) -> EnergyRow:
        """Account for one accepted step (collective)."""
        last, dt = self.row, after.time - before.time
        moved = after.displacement.copy()
        moved.axpy(-1.0, before.displacement)
        forces = (before.load, after.load, before.reaction, after.reaction)
        work = 0.5 * sum(force.dot(moved) for force in forces)
        self._system.damping.mult(moved, self._work)
        viscous = moved.dot(self._work) / dt
        friction = 0.0
        if self._system.contact is not None and after.joints is not None:
            friction = self._system.contact.integral(after.joints.dissipation)
        self.row = self._stored(
            after,
            last.input + float(work),
            last.viscous + float(viscous),
            last.friction + friction,
            self._stored_at_start,
        )
        losses = self.row.viscous + self.row.friction
        self._scale = max(self._scale, self.row.stored, abs(self.row.input), losses)
        self._largest_error = max(self._largest_error, abs(self.row.error))
        return self.row

    @property
    def relative_error(self) -> float:
        """The paper's energy error: max |error| over the running maximum of the energies."""
        return self._largest_error / self._scale if self._scale else 0.0

    def _stored(
        self, state: DynamicState, work: float, viscous: float, friction: float, start: float
    ) -> EnergyRow:
        system = self._system
        system.mass.mult(state.velocity, self._work)
        kinetic = 0.5 * float(state.velocity.dot(self._work))
        system.stiffness.mult(state.displacement, self._work)
        strain = 0.5 * float(state.displacement.dot(self._work))
        joint = _joint_energy(system, state.joints)
        missing = kinetic + strain + joint - start - work + viscous + friction
        return EnergyRow(
            kinetic=kinetic,
            strain=strain,
            joint=joint,
            input=work,
            viscous=viscous,
            friction=friction,
            error=missing if np.isfinite(missing) else float("inf"),
        )


def _joint_energy(system: MatrixSystem, joints: Response | None) -> float:
    if system.contact is None or joints is None:
        return 0.0
    return system.contact.stored_energy(joints.state)
