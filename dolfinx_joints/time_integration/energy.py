# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energy ledger of a dynamic run: where every joule went, and how many are missing."""

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

_TOTALS = ("_at_start", "scale", "largest", "_error", "_imbalance")


@dataclass(frozen=True, kw_only=True)
class EnergyRow:
    """Energies at one time, all in [J]; works and losses count from the start of the ledger.

    Attributes:
        kinetic: v.M v / 2.
        strain: u.K u / 2, bulk and springs; in plastic cells that of the elastic strain.
        joint_elastic: Elastic energy of each joint, shape (number of joints,).
        input: Work of loads and of moving supports.
        input_by_load: Work of each load by name.
        viscous: Work done against the damping.
        joint_friction: Work done against friction in each joint, shape (number of joints,).
        joint_numerical: Energy that each joint took in besides, lost or (negative) made up by the
            time scheme where it opens, closes or slides within a step, shape (number of joints,).
            By formulae of the laws: none of a law answered over whole steps, `LawWithLosses` of
            others. Of a law that has neither it is the rest of the work on its joints, so that
            ``imbalance`` says nothing of these (`Contact.without_losses` names such laws).
        joint_imbalance: The part of ``imbalance`` that arises in each joint: its elastic energy,
            friction and numerical loss less the work of the body on it, shape (number of joints,).
        error: stored - stored at the start - input + viscous + friction + plastic + impact.
        plastic: Plastic work of the bulk.
        absorbed: Part of ``viscous`` that viscous boundaries and bounds of the water took.
        impact: Lost by joint points that strike and do not rebound.
        water: Of waves in water, rho |grad phi|^2 / 2 + p^2 / (2 rho c^2); the other lines are
            without it.
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
    absorbed: float = 0.0
    impact: float = 0.0
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
        """Numerical loss of all joints."""
        return float(self.joint_numerical.sum())

    @cached_property
    def stored(self) -> float:
        """Kinetic, strain and joint energy, and that of the water."""
        return self.kinetic + self.strain + self.joint + self.water

    @cached_property
    def imbalance(self) -> float:
        """Energy that no line accounts for: error + numerical, rounding where all is right."""
        return self.error + self.numerical

    @cached_property
    def body_imbalance(self) -> float:
        """The same with the work on the joints for their lines: rounding where solves are right."""
        return self.imbalance - float(self.joint_imbalance.sum())


class EnergyLedger:
    """Adds up energies and works step by step.

    The works are those that the scheme balances (`StepWork`), so that for schemes with
    ``conserves`` the lines of a right solve add up to rounding. Each comes from a formula of its
    own, none is what others leave.

    Attributes:
        row: The newest row.
        scale: Largest of stored energy, |input| and losses so far [J]: what rounding goes with.
        largest: The same, with what passes through viscous boundaries as the difference of what
            waves bring and take, which is much less than either [J].
    """

    def __init__(self, system: MatrixSystem) -> None:
        """Keep the system; `start` begins to count."""
        self._system = system
        self._none = np.zeros(0 if system.contact is None else len(system.contact.operator.names))

    def start(self, state: DynamicState) -> EnergyRow:
        """Begin at a state (collective)."""
        kinetic, strain, water = self._of_state(state)
        self.row = EnergyRow(
            kinetic=kinetic,
            strain=strain,
            water=water,
            joint_elastic=self._elastic(state),
            input_by_load=dict.fromkeys(self._system.names_of_works, 0.0),
            joint_friction=self._none,
            joint_numerical=self._none,
            joint_imbalance=self._none,
        )
        self._at_start = self.scale = self.largest = self.row.stored
        self._error = self._imbalance = 0.0
        return self.row

    def after(self, state: DynamicState, report: StepReport) -> EnergyRow:
        """The row that a step would lead to; the ledger stays as it is (collective)."""
        last, work = self.row, report.work
        elastic = self._elastic(state)
        joints = work.joints
        own = elastic - last.joint_elastic + joints.friction + joints.numerical + joints.impact
        entered = last.input + sum(work.loads.values()) + work.supports
        viscous = last.viscous + (work.viscous + work.absorbed)
        rubbed = last.joint_friction + joints.friction
        plastic = last.plastic + self._system.plastic_terms(state.joints)[1]
        kinetic, strain, water = self._of_state(state)
        stored = kinetic + strain + float(elastic.sum()) + water
        impact = last.impact + float(joints.impact.sum())
        losses = viscous + float(rubbed.sum()) + plastic + impact
        missing = stored - self._at_start - entered + losses
        return EnergyRow(
            kinetic=kinetic,
            strain=strain,
            joint_elastic=elastic,
            input=entered,
            input_by_load={
                name: value + work.loads.get(name, 0.0)
                for name, value in last.input_by_load.items()
            },
            viscous=viscous,
            joint_friction=rubbed,
            joint_numerical=last.joint_numerical + joints.numerical,
            joint_imbalance=last.joint_imbalance + own - joints.taken,
            error=missing if np.isfinite(missing) else float("inf"),
            plastic=plastic,
            absorbed=last.absorbed + work.absorbed,
            impact=impact,
            water=water,
        )

    def record(self, row: EnergyRow) -> EnergyRow:
        """Account for one accepted step."""
        losses = row.viscous + row.friction + row.plastic + row.impact
        self.scale = max(self.scale, row.stored, abs(row.input), losses)
        net = abs(row.input - row.absorbed)
        self.largest = max(self.largest, row.stored, net, losses - row.absorbed)
        self._error = max(self._error, abs(row.error))
        self._imbalance = max(self._imbalance, abs(row.imbalance))
        self.row = row
        return row

    def state_dict(self) -> dict[str, Any]:
        """Where the ledger stands."""
        return {"row": asdict(self.row), "totals": [getattr(self, name) for name in _TOTALS]}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Go on from what another's ``state_dict`` gave."""
        self.row = EnergyRow(**state_dict["row"])
        for name, value in zip(_TOTALS, state_dict["totals"], strict=True):
            setattr(self, name, value)

    @property
    def relative_error(self) -> float:
        """The paper's energy error: largest |error| so far over the largest energy."""
        return self._error / self.largest if self.largest else 0.0

    @property
    def relative_imbalance(self) -> float:
        """Largest |imbalance| so far over the scale."""
        return self._imbalance / self.scale if self.scale else 0.0

    def _elastic(self, state: DynamicState) -> Floats:
        if self._system.contact is None or state.joints is None:
            return self._none
        return self._system.contact.stored_energy(state.joints.state)

    def _of_state(self, state: DynamicState) -> tuple[float, float, float]:
        """Kinetic and strain energy of the body, and energy of the water."""
        kinetic, coupled = state.kinetic_energy, self._system.coupled
        strain = state.strain_energy + self._system.plastic_terms(state.joints)[0]
        if coupled is None:
            return kinetic, strain, 0.0
        of_pressure = coupled.energy(state.velocity, state.momentum)
        of_motion = coupled.energy(state.displacement, state.elastic_force)
        return kinetic - of_pressure, strain - of_motion, of_pressure + of_motion
