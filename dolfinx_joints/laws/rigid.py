# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A joint without compliance: no overlap, no elastic slip."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import annotated_types as at
import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.laws.angle import coefficient_of, set_friction
from dolfinx_joints.laws.discrete_gradient import solve_discrete_gradient
from dolfinx_joints.laws.friction import solve_backward_euler
from dolfinx_joints.laws.law import Floats, JointState, Losses, Response
from dolfinx_joints.laws.losses import losses_on, way_with_friction
from dolfinx_joints.laws.return_mapping import Coulomb, response_of


@dataclass(frozen=True, kw_only=True)
@checked
class RigidJoint:
    """`FrictionNoTension` with k_n and k_s infinite, their ratio given.

    Its tractions follow from the structure alone, so it is a `CondensedLaw` only. With the
    energy-consistent scheme, what a point brings into contact in a step is stored and given back
    when it leaves, so that impacts are elastic; in statics and with schemes that take
    the law at the end of a step it stores nothing.

    Internal variables: the energy stored in normal contact [J/m^2] and the root of that in shear,
    two components [(J/m^2)^(1/2)].

    Attributes:
        friction_angle_deg: alpha; exactly one of this and the next is given.
        friction_coefficient: Mu = tan(alpha).
        stiffness_ratio: k_n / k_s, which sets how much of the shear energy of a point that loses
            pressure can stay.

    Raises:
        ValueError: Angle and coefficient are both given, or both missing.
    """

    internal_variables: ClassVar[tuple[str, ...]] = (
        "normal_energy",
        "shear_root_1",
        "shear_root_2",
    )

    friction_angle_deg: Annotated[float, at.Ge(0), at.Lt(90), at.Unit("degrees")] | None = None
    friction_coefficient: Annotated[float, at.Ge(0)] | None = None
    stiffness_ratio: Annotated[float, at.Gt(0)] = 1.0

    def __post_init__(self) -> None:
        """Take the friction."""
        set_friction(self)

    def initial_variables(self, gap: Floats) -> Floats:
        """No energy at rest, shape (n, 3)."""
        return np.zeros((len(gap), 3))

    def closed_stiffness(self) -> tuple[float, float]:
        """Infinite, both."""
        return math.inf, math.inf

    def stored_energy(self, state: JointState) -> Floats:
        """Energy of each point, shape (n,), [J/m^2]."""
        return state.internal[:, 0] + 0.5 * np.sum(state.internal[:, 1:] ** 2, axis=1)

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Losses of an end-point step (30); what was stored before it is let go."""
        way = way_with_friction(before, answer.state)
        lost = losses_on(way, traction, answer.traction, answer.dissipation)
        return lost._replace(numerical=lost.numerical + self.stored_energy(before))

    def condensed_backward_euler(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """Return mapping at the end of a step (21), no energy stored; see `CondensedLaw`."""
        law = Coulomb(0.0, 0.0, self.stiffness_ratio, coefficient_of(self))
        answer = solve_backward_euler(trial_gap, compliance, state, law)
        return response_of(
            answer, elastic_slip=answer.history, internal=np.zeros_like(state.internal)
        )

    def condensed_discrete_gradient(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """Energy-consistent answer over a whole step (17); see `CondensedLaw`."""
        law = Coulomb(0.0, 0.0, self.stiffness_ratio, coefficient_of(self))
        answer = solve_discrete_gradient(trial_gap, compliance, state, state.internal, law)
        return response_of(
            answer,
            elastic_slip=np.zeros((len(trial_gap), 2)),
            internal=answer.history[:, :3],
            slips=answer.history[:, 3:],
        )
