# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A joint without compliance: no overlap, no elastic slip."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import annotated_types as at
import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.laws.angle import coefficient_of, set_friction
from dolfinx_joints.laws.friction import LOOPS
from dolfinx_joints.laws.law import BACKWARD_EULER, Floats, JointState, Losses, Response, Rule
from dolfinx_joints.laws.losses import losses_on, way_with_friction
from dolfinx_joints.laws.points.compiled_law import CompiledEnergyConsistentLaw
from dolfinx_joints.laws.points.discrete_gradient import whole_step_from
from dolfinx_joints.laws.points.return_mapping import Answer, Coulomb, Start, response_of


@dataclass(frozen=True, kw_only=True)
@checked
class RigidJoint(CompiledEnergyConsistentLaw):
    """`FrictionNoTension` with k_n and k_s infinite, their ratio given.

    Its tractions follow from the structure alone, so it is a `CondensedLaw` only. With the
    energy-consistent scheme, what a point brings into contact in a step is stored and given back
    when it leaves (restitution 1), or the point stops and its kinetic energy is lost (restitution
    0). In statics and with schemes that take the law at the end of a step it stores nothing.

    Nodes with mass that rebound do so over and over in an order that no step is short enough to
    settle: friction work is uncertain by some per cent. It converges with restitution 0, or without
    mass at the joint nodes (`Body(redistribute_mass=True)`).

    Internal variables: the energy stored in normal contact [J/m^2] and the root of that in shear,
    two components [(J/m^2)^(1/2)]; with restitution 0 whether the point was pressed in the last
    step, 0 or 1.

    Attributes:
        friction_angle_deg: alpha; exactly one of this and the next is given.
        friction_coefficient: Mu = tan(alpha).
        stiffness_ratio: k_n / k_s, which sets how much of the shear energy of a point that loses
            pressure can stay.
        restitution: Speed of a point after an impact over that before, 0 or 1; with 0 a point that
            strikes overlaps by at most half the way of a step.

    Raises:
        ValueError: Angle and coefficient are both given, or both missing.
    """

    loops: ClassVar[Mapping[str, Any]] = LOOPS

    friction_angle_deg: Annotated[float, at.Ge(0), at.Lt(90), at.Unit("degrees")] | None = None
    friction_coefficient: Annotated[float, at.Ge(0)] | None = None
    stiffness_ratio: Annotated[float, at.Gt(0)] = 1.0
    restitution: Literal[0, 1] = 1

    def __post_init__(self) -> None:
        """Take the friction."""
        set_friction(self)

    @property
    def internal_variables(self) -> tuple[str, ...]:
        """Names of the internal variables."""
        if self.restitution:
            return "normal_energy", "shear_root_1", "shear_root_2"
        return ("pressed",)

    def initial_variables(self, gap: Floats) -> Floats:
        """No energy and no pressure at rest, shape (n, variables)."""
        return np.zeros((len(gap), len(self.internal_variables)))

    def closed_stiffness(self) -> tuple[float, float]:
        """Infinite, both."""
        return math.inf, math.inf

    def stored_energy(self, state: JointState) -> Floats:
        """Energy of each point, shape (n,), [J/m^2]."""
        if not self.restitution:
            return np.zeros(len(state.gap))
        return state.internal[:, 0] + 0.5 * np.sum(state.internal[:, 1:] ** 2, axis=1)

    def impact(self, before: JointState, answer: Response) -> Floats:
        """Loss of a whole step without rebound, all its normal work: nothing is stored [J/m^2]."""
        lost: Floats = answer.traction[:, 0] * (answer.state.gap - before.gap)[:, 0]
        return lost

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Losses of an end-point step (30); what was stored before it is let go."""
        way = way_with_friction(before, answer.state)
        lost = losses_on(way, traction, answer.traction, answer.dissipation)
        return lost._replace(numerical=lost.numerical + self.stored_energy(before))

    def loop_start(self, rule: Rule, state: JointState) -> Start:
        """No energy stored at the end of a step (21); over a whole one (17) the variables."""
        law = Coulomb(0.0, 0.0, self.stiffness_ratio, coefficient_of(self), self.restitution == 1)
        if rule.name == BACKWARD_EULER.name:
            return Start(state.gap, state.elastic_slip, np.array(law, dtype=np.float64))
        if self.restitution:
            return whole_step_from(state, state.internal, law)
        way = state.approach if len(state.approach) else np.zeros(len(state.gap))
        return whole_step_from(state, None, law, np.column_stack([way, state.internal[:, 0]]))

    def loop_response(self, rule: Rule, answer: Answer, state: JointState) -> Response:
        """Return the answer with the variables at the end."""
        if rule.name == BACKWARD_EULER.name:
            internal = np.zeros((len(answer.traction), len(self.internal_variables)))
            if not self.restitution:
                internal[:, 0] = answer.traction[:, 0] < 0.0
            return response_of(answer, elastic_slip=answer.history, internal=internal)
        return response_of(
            answer,
            elastic_slip=np.zeros((len(answer.traction), 2)),
            internal=answer.history[:, :3] if self.restitution else answer.history[:, 9:],
            slips=answer.history[:, 3:8],
        )
