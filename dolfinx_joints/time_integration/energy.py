# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energy ledger of a dynamic run: stored energy, works, losses and their imbalance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from dolfinx_joints.mesh.cells import Floats
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.time_integration.scheme import StepReport
from dolfinx_joints.time_integration.states import DynamicState

_TOTALS = ("_at_start", "_fractured", "scale", "largest", "_error", "_imbalance")


@dataclass(frozen=True, kw_only=True)
class EnergyRow:
    """Energies at one time, all in [J]; works and losses count from the start of the ledger.

    Attributes:
        kinetic: Kinetic energy v.M v / 2.
        strain: Strain energy u.K u / 2 of bulk and springs, in nonlinear cells that of their law.
        joint_elastic: Elastic energy of each joint, shape (number of joints,).
        input: Work of loads and of moving supports.
        input_by_load: Work of each load by name.
        viscous: Work done against damping.
        joint_friction: Work done against friction in each joint, shape (number of joints,).
        joint_numerical: Energy lost (created if negative) by the time scheme in each joint that
            opens, closes or slides within a step, shape (number of joints,). Zero for laws that
            are evaluated over whole steps, and computed by `LawWithLosses` for others. For a law
            with neither method, it is the remaining work, and ``imbalance`` does not check joints
            with this law; `Contact.without_losses` lists these laws.
        joint_imbalance: Part of ``imbalance`` that arises in each joint: elastic energy, friction
            and losses less the work of the body on the joint, shape (number of joints,).
        error: Equation (31): stored - stored at start - input + viscous + friction + plastic +
            impact.
        plastic: Plastic work and other losses of nonlinear cells.
        bulk_numerical: Energy lost by the time scheme in reversible nonlinear cells; zero in the
            energy-consistent scheme.
        absorbed: Part of ``viscous`` absorbed by viscous boundaries and boundaries of the water.
        impact: Energy lost by joint points that close without rebound.
        fracture: Part of ``friction`` from cohesive bonds: fracture energy times the area broken.
        water: Kinetic and compression energy of water waves, not part of ``kinetic``, ``strain``.
    """

    kinetic: float
    strain: float
    joint_elastic: Floats
    input: float = 0.0
    input_by_load: Mapping[str, float]
    viscous: float = 0.0
    joint_friction: Floats
    joint_numerical: Floats
    joint_imbalance: Floats
    error: float = 0.0
    plastic: float = 0.0
    bulk_numerical: float = 0.0
    absorbed: float = 0.0
    impact: float = 0.0
    fracture: float = 0.0
    water: float = 0.0

    @cached_property
    def joint(self) -> float:
        """Elastic energy of all joints."""
        return float(self.joint_elastic.sum())

    @cached_property
    def friction(self) -> float:
        """Work done against friction in all joints."""
        return float(self.joint_friction.sum())

    @cached_property
    def numerical(self) -> float:
        """Numerical loss of all joints and of the bulk."""
        return float(self.joint_numerical.sum()) + self.bulk_numerical

    @cached_property
    def stored(self) -> float:
        """Sum of kinetic, strain, joint and water energy."""
        return self.kinetic + self.strain + self.joint + self.water

    @cached_property
    def imbalance(self) -> float:
        """Unexplained energy, error + numerical; only rounding error if all solves are accurate."""
        return self.error + self.numerical

    @cached_property
    def body_imbalance(self) -> float:
        """Imbalance without the joints' parts; only rounding error if all solves are accurate."""
        return self.imbalance - float(self.joint_imbalance.sum())


class EnergyLedger:
    """Accumulates energies and works step by step.

    Works are evaluated as in the energy balance of the scheme (`StepWork`). If the scheme conserves
    energy and the solve is accurate, the balance closes to rounding error. Each term has its own
    formula; none is computed as the remainder of the others.

    Attributes:
        row: The newest row.
        scale: Largest stored energy, |input| or losses so far, reference for rounding errors [J].
        largest: Maximum as for ``scale``, with the absorbed energy subtracted from input and
            losses, because incoming and outgoing waves nearly cancel; denominator of (32) [J].
    """

    def __init__(self, system: MatrixSystem) -> None:
        """Store the system; `start` begins the accounting."""
        self._system = system
        self._zeros = np.zeros(0 if system.contact is None else len(system.contact.operator.names))

    def start(self, state: DynamicState) -> EnergyRow:
        """Start the accounting at a state (collective)."""
        kinetic, strain, water = self._energies(state)
        self.row = EnergyRow(
            kinetic=kinetic,
            strain=strain,
            water=water,
            joint_elastic=self._joint_energy(state),
            input_by_load=dict.fromkeys(self._system.names_of_works, 0.0),
            joint_friction=self._zeros,
            joint_numerical=self._zeros,
            joint_imbalance=self._zeros,
        )
        self._at_start = self.scale = self.largest = self.row.stored
        self._fractured = self._fracture(state)
        self._error = self._imbalance = 0.0
        return self.row

    def after(self, state: DynamicState, report: StepReport) -> EnergyRow:
        """Return the row after a step without adding it to the ledger (collective)."""
        last, work = self.row, report.work
        elastic = self._joint_energy(state)
        joints = work.joints
        change = elastic - last.joint_elastic + joints.friction + joints.numerical + joints.impact
        input_work = last.input + sum(work.loads.values()) + work.supports
        viscous = last.viscous + (work.viscous + work.absorbed)
        friction = last.joint_friction + joints.friction
        _, dissipated, numerical = self._system.bulk_terms(state.joints)
        plastic = last.plastic + dissipated
        kinetic, strain, water = self._energies(state)
        stored = kinetic + strain + float(elastic.sum()) + water
        impact = last.impact + float(joints.impact.sum())
        losses = viscous + float(friction.sum()) + plastic + impact
        missing = stored - self._at_start - input_work + losses
        return EnergyRow(
            kinetic=kinetic,
            strain=strain,
            joint_elastic=elastic,
            input=input_work,
            input_by_load={
                name: value + work.loads.get(name, 0.0)
                for name, value in last.input_by_load.items()
            },
            viscous=viscous,
            joint_friction=friction,
            joint_numerical=last.joint_numerical + joints.numerical,
            joint_imbalance=last.joint_imbalance + change - joints.total,
            error=missing if np.isfinite(missing) else float("inf"),
            plastic=plastic,
            bulk_numerical=last.bulk_numerical + numerical,
            absorbed=last.absorbed + work.absorbed,
            impact=impact,
            fracture=self._fracture(state) - self._fractured,
            water=water,
        )

    def record(self, row: EnergyRow) -> EnergyRow:
        """Add the row of an accepted step to the ledger."""
        losses = row.viscous + row.friction + row.plastic + row.impact
        self.scale = max(self.scale, row.stored, abs(row.input), losses)
        net_input = abs(row.input - row.absorbed)
        self.largest = max(self.largest, row.stored, net_input, losses - row.absorbed)
        self._error = max(self._error, abs(row.error))
        self._imbalance = max(self._imbalance, abs(row.imbalance))
        self.row = row
        return row

    def state_dict(self) -> dict[str, Any]:
        """Return the row and the totals, for a restart."""
        return {"row": asdict(self.row), "totals": [getattr(self, name) for name in _TOTALS]}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Restore the ledger from ``state_dict``."""
        self.row = EnergyRow(**state_dict["row"])
        for name, value in zip(_TOTALS, state_dict["totals"], strict=True):
            setattr(self, name, value)

    @property
    def relative_error(self) -> float:
        """Energy error (32): largest |error| so far, divided by ``largest``."""
        return self._error / self.largest if self.largest else 0.0

    @property
    def relative_imbalance(self) -> float:
        """Largest |imbalance| so far, divided by ``scale``."""
        return self._imbalance / self.scale if self.scale else 0.0

    def _joint_energy(self, state: DynamicState) -> Floats:
        if self._system.contact is None or state.joints is None:
            return self._zeros
        return self._system.contact.stored_energy(state.joints.state)

    def _fracture(self, state: DynamicState) -> float:
        contact = self._system.contact
        if contact is None or state.joints is None or not contact.softens:
            return 0.0
        return contact.fracture_energy(state.joints.state)

    def _energies(self, state: DynamicState) -> tuple[float, float, float]:
        """Return kinetic and strain energy of the body, and the energy of the water."""
        kinetic, coupled = state.kinetic_energy, self._system.coupled
        strain = state.strain_energy + self._system.bulk_terms(state.joints)[0]
        if coupled is None:
            return kinetic, strain, 0.0
        of_pressure = coupled.energy(state.velocity, state.momentum)
        of_motion = coupled.energy(state.displacement, state.elastic_force)
        return kinetic - of_pressure, strain - of_motion, of_pressure + of_motion
