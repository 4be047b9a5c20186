# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Drucker-Prager plasticity for rock and soil, with its return mapping."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import annotated_types as at
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.materials.bulk_law import BulkResponse, BulkState, BulkStatus, product
from dolfinx_joints.materials.elastic import Elastic

_TRACE = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
# Matrix from strains (with shear angles) to the strain deviator, as tensor components.
_DEVIATOR = np.diag([1.0, 1.0, 1.0, 0.5, 0.5, 0.5]) - np.outer(_TRACE, _TRACE) / 3.0
_DOUBLE = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])


@dataclass(frozen=True, kw_only=True)
@checked
class DruckerPrager:
    """Elastic, perfectly plastic material with the Drucker-Prager cone and a dilatancy angle.

    Yield function F = sqrt(J2) + alpha I1 - k, plastic potential sqrt(J2) + beta I1. The fit gives
    alpha and k for the Mohr-Coulomb friction angle and cohesion, and beta for the dilatancy angle.
    I1 is the trace of the stress s, J2 = dev(s) : dev(s) / 2.

    Attributes:
        elastic: Elastic part of the material.
        cohesion: c, positive if phi is zero.
        friction_angle_deg: phi.
        dilatancy_angle_deg: psi, at most phi (default: phi, associated flow).
        fit: Stress states with the strength of Mohr-Coulomb: ``compression`` or ``extension``
            (triaxial tests), or ``plane strain`` (collapse at psi = phi).

    Raises:
        ValueError: Parameters contradict each other.
    """

    elastic: Elastic
    cohesion: Annotated[float, at.Ge(0), at.Unit("Pa")]
    friction_angle_deg: Annotated[float, at.Ge(0), at.Lt(90), at.Unit("degrees")]
    dilatancy_angle_deg: Annotated[float, at.Ge(0), at.Lt(90), at.Unit("degrees")] | None = None
    fit: Literal["compression", "extension", "plane strain"] = "compression"

    def __post_init__(self) -> None:
        """Check the elastic part, strengths and angles."""
        if not isinstance(self.elastic, Elastic):
            raise ValueError(
                f"DruckerPrager: elastic is {shown(self.elastic)}; it must be an Elastic."
            )
        phi = self.friction_angle_deg
        if self.cohesion == 0.0 and phi == 0.0:
            raise ValueError(
                "DruckerPrager: cohesion is 0 Pa; it must be positive if the friction angle is 0."
            )
        if self.dilatancy_angle_deg is not None and self.dilatancy_angle_deg > phi:
            raise ValueError(
                f"DruckerPrager: dilatancy_angle_deg is {self.dilatancy_angle_deg:g} degrees; it "
                f"must be at most the friction angle, {phi:g} degrees."
            )

    @property
    def slope(self) -> float:
        """Slope alpha of the cone."""
        return self._slope(self.friction_angle_deg)

    @property
    def dilatancy(self) -> float:
        """Factor beta of the plastic potential."""
        angle = self.dilatancy_angle_deg
        return self.slope if angle is None else self._slope(angle)

    @property
    def strength(self) -> float:
        """Yield stress k in pure shear [Pa]."""
        phi = math.radians(self.friction_angle_deg)
        if self.fit == "plane strain":
            return 3.0 * self.cohesion / math.sqrt(9.0 + 12.0 * math.tan(phi) ** 2)
        side = -1.0 if self.fit == "compression" else 1.0
        return 6.0 * self.cohesion * math.cos(phi) / (math.sqrt(3.0) * (3.0 + side * math.sin(phi)))

    def _slope(self, angle_deg: float) -> float:
        angle = math.radians(angle_deg)
        if self.fit == "plane strain":
            return math.tan(angle) / math.sqrt(9.0 + 12.0 * math.tan(angle) ** 2)
        side = -1.0 if self.fit == "compression" else 1.0
        return 2.0 * math.sin(angle) / (math.sqrt(3.0) * (3.0 + side * math.sin(angle)))

    def yield_function(self, stress: Floats) -> Floats:
        """Return F of stresses (n, 6), shape (n,), [Pa]; positive outside the cone."""
        _, radius, trace = _invariants(stress)
        return radius + self.slope * trace - self.strength

    @property
    def internal_variables(self) -> Mapping[str, tuple[int, ...]]:
        """Plastic strain, and the sum of sqrt(2/3) |d eps_p| over all steps."""
        return {"plastic strain [-]": (6,), "accumulated plastic strain [-]": ()}

    def initial_variables(self, sizes: Floats) -> Floats:
        """Return the variables without plastic strain, shape (n, 7)."""
        return np.zeros((len(sizes), 7))

    def backward_euler(self, strain: Floats, state: BulkState, dt: float = 0.0) -> BulkResponse:
        """Compute the return mapping at the end of a step (backward Euler, closed form).

        Args:
            strain: Trial strain, shape (n, 6).
            state: State at the start of the step.
            dt: Not used.
        """
        matrix = self.elastic.stiffness_matrix()
        before = state.internal[:, :6]
        stress, increment, tangent, status = self._return_mapping((strain - before) @ matrix)
        start = (state.strain - before) @ matrix
        return BulkResponse(
            stress=stress,
            tangent=tangent,
            state=self._state(strain, state, increment, _amount(increment)),
            dissipation=0.5 * product(start + stress, increment),
            numerical=np.zeros(len(strain)),
            status=status,
        )

    def discrete_gradient(self, strain: Floats, state: BulkState, dt: float = 0.0) -> BulkResponse:
        """Compute the return mapping at mid-step, with an energy balance (docs/theory).

        The stress at mid-step is admissible. The end stress is extrapolated from the mid-step
        stress and also returned to the cone; the energy that this return releases is dissipated.

        Args:
            strain: Trial strain at the end of the step, shape (n, 6).
            state: State at the start of the step.
            dt: Not used.
        """
        matrix = self.elastic.stiffness_matrix()
        before = state.internal[:, :6]
        trial = (0.5 * (state.strain + strain) - before) @ matrix
        stress, half, tangent, status = self._return_mapping(trial)
        beyond = (strain - before - 2.0 * half) @ matrix
        end, released, _, _ = self._return_mapping(beyond)
        grown = _amount(2.0 * half) + _amount(released)
        return BulkResponse(
            stress=stress,
            tangent=0.5 * tangent,
            state=self._state(strain, state, 2.0 * half + released, grown),
            dissipation=2.0 * product(stress, half) + 0.5 * product(beyond + end, released),
            numerical=np.zeros(len(strain)),
            status=status,
        )

    def _state(
        self, strain: Floats, state: BulkState, increment: Floats, grown: Floats
    ) -> BulkState:
        """Return the state at a strain after an increment of the plastic strain."""
        plastic = state.internal[:, :6] + increment
        internal = np.column_stack([plastic, state.internal[:, 6] + grown])
        elastic = BulkState.elastic(strain - plastic, self.elastic.stiffness_matrix(), internal)
        return replace(elastic, strain=strain.copy())

    def _return_mapping(self, trial: Floats) -> tuple[Floats, Floats, Floats, NDArray[np.int8]]:
        """Return admissible stress, plastic strain increment, d stress / d strain and status."""
        matrix = self.elastic.stiffness_matrix()
        status = np.zeros(len(trial), dtype=np.int8)
        stress, increment = trial.copy(), np.zeros_like(trial)
        tangent = np.broadcast_to(matrix, (len(trial), 6, 6)).copy()
        deviator, radius, trace = _invariants(trial)
        excess = radius + self.slope * trace - self.strength
        shear, bulk = self._moduli()
        flow = excess / (shear + 9.0 * bulk * self.slope * self.dilatancy)
        # NaN compares as false, so it stays in the stress and is reported later.
        yields = np.flatnonzero(excess > 0.0)
        if not len(yields):
            return stress, increment, tangent, status
        at_apex = (radius < shear * flow) & (excess > 0.0)
        apex, cone = np.flatnonzero(at_apex), yields[~at_apex[yields]]
        status[cone], status[apex] = BulkStatus.YIELD, BulkStatus.APEX
        part = flow[cone] / radius[cone]
        increment[cone] = 0.5 * part[:, None] * _DOUBLE * deviator[cone]
        increment[cone] += np.outer(self.dilatancy * flow[cone], _TRACE)
        stress[cone] -= (shear * part)[:, None] * deviator[cone]
        stress[cone] -= np.outer(3.0 * bulk * self.dilatancy * flow[cone], _TRACE)
        tangent[cone] = self._cone_tangent(deviator[cone] / radius[cone, None], shear * part)
        if len(apex):
            stress[apex] = self.strength / (3.0 * self.slope) * _TRACE
            increment[apex] = (trial[apex] - stress[apex]) @ np.linalg.inv(matrix)
            tangent[apex] = 0.0
        return stress, increment, tangent, status

    def _cone_tangent(self, direction: Floats, part: Floats) -> Floats:
        """Return the derivative of the stress on the cone by the strain, (n, 6, 6), [Pa].

        ``direction`` is deviator / sqrt(J2), ``part`` the subtracted fraction of the deviator.
        """
        shear, bulk = self._moduli()
        side = np.einsum("ni,nj->nij", direction, direction)
        tangent = bulk * np.outer(_TRACE, _TRACE) + shear * part[:, None, None] * side
        tangent += 2.0 * shear * (1.0 - part)[:, None, None] * _DEVIATOR
        flow = shear * direction + 3.0 * bulk * self.dilatancy * _TRACE
        normal = shear * direction + 3.0 * bulk * self.slope * _TRACE
        hardness = shear + 9.0 * bulk * self.slope * self.dilatancy
        tangent -= np.einsum("ni,nj->nij", flow, normal) / hardness
        return tangent

    def _moduli(self) -> tuple[float, float]:
        """Return shear and bulk modulus [Pa]."""
        shear = float(self.elastic.shear_modulus)
        return shear, float(self.elastic.first_lame("strain")) + 2.0 * shear / 3.0


def _invariants(stress: Floats) -> tuple[Floats, Floats, Floats]:
    trace = stress[:, :3].sum(axis=1)
    deviator = stress - np.outer(trace / 3.0, _TRACE)
    return deviator, np.sqrt(0.5 * (deviator**2 @ _DOUBLE)), trace


def _amount(strain: Floats) -> Floats:
    """Return sqrt(2/3) times the norm of the strain tensors."""
    return np.sqrt(2.0 / 3.0 * (strain**2 @ (1.0 / _DOUBLE)))
