# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint without compliance: no overlap, no elastic slip."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import annotated_types as at
import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.laws.friction import LOOPS, coefficient_of, set_friction
from dolfinx_joints.laws.law import BACKWARD_EULER, Floats, JointState, Losses, Response, Rule
from dolfinx_joints.laws.losses import friction_gap_change, losses_on
from dolfinx_joints.laws.points.compiled_law import CompiledEnergyConsistentLaw
from dolfinx_joints.laws.points.discrete_gradient import whole_step_from
from dolfinx_joints.laws.points.return_mapping import Answer, Coulomb, Start, response_of


@dataclass(frozen=True, kw_only=True)
@checked
class RigidJoint(CompiledEnergyConsistentLaw):
    """`FrictionNoTension` with infinite k_n and k_s of a given ratio.

    The structure determines the tractions, not the gap, so the law is only a `CondensedLaw`. In the
    energy-consistent scheme with restitution 1, a closing point stores the impact energy and
    releases it on opening. With restitution 0 the point stops and loses its kinetic energy. In
    statics and in backward Euler schemes the joint stores no energy.

    With restitution 1, joint nodes with mass rebound repeatedly, in a sequence that does not
    converge with the time step. The friction work then has an error of some per cent. It converges
    with restitution 0, or without mass at the joint nodes (`Body(redistribute_mass=True)`).

    Internal variables: the energy stored in normal contact [J/m^2] and a vector q with the shear
    energy |q|^2 / 2, two components [(J/m^2)^(1/2)]. With restitution 0 there is one variable: 1 if
    the point was under pressure in the last step, else 0.

    Attributes:
        friction_angle_deg: alpha; give either this or `friction_coefficient`.
        friction_coefficient: Mu = tan(alpha).
        stiffness_ratio: k_n / k_s; limits the stored shear energy while the pressure decreases.
        restitution: Ratio of the speeds after and before an impact, 0 or 1. With 0 a closing point
            overlaps by at most half the displacement of a step.

    Raises:
        ValueError: Angle and coefficient are both given, or both missing.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.RigidJoint(friction_angle_deg=45.0)
        >>> base = [dj.Fixed(group="base")]
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=base, loads=[dj.Gravity()])
        >>> joints = dj.Simulation(model).statics().joints
        >>> float(abs(joints.state.gap[:, 0]).max())  # no overlap under the weight [m]
        0.0
    """

    loops: ClassVar[Mapping[str, Any]] = LOOPS

    friction_angle_deg: Annotated[float, at.Ge(0), at.Lt(90), at.Unit("degrees")] | None = None
    friction_coefficient: Annotated[float, at.Ge(0)] | None = None
    stiffness_ratio: Annotated[float, at.Gt(0)] = 1.0
    restitution: Literal[0, 1] = 1

    def __post_init__(self) -> None:
        set_friction(self)

    @property
    def internal_variables(self) -> tuple[str, ...]:
        """Names of the internal variables."""
        if self.restitution:
            return "normal_energy", "shear_root_1", "shear_root_2"
        return ("pressed",)

    def initial_variables(self, gap: Floats) -> Floats:
        """Return zeros, the values at rest, shape (n, variables)."""
        return np.zeros((len(gap), len(self.internal_variables)))

    def closed_stiffness(self) -> tuple[float, float]:
        """Return infinite stiffnesses."""
        return math.inf, math.inf

    def stored_energy(self, state: JointState) -> Floats:
        """Return the stored energy, shape (n,), [J/m^2]."""
        if not self.restitution:
            return np.zeros(len(state.gap))
        return state.internal[:, 0] + 0.5 * np.sum(state.internal[:, 1:] ** 2, axis=1)

    def impact(self, before: JointState, answer: Response) -> Floats:
        """Return the impact loss of a step without rebound: its normal work, (n,), [J/m^2]."""
        lost: Floats = answer.traction[:, 0] * (answer.state.gap - before.gap)[:, 0]
        return lost

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Return the losses (30) of a backward Euler step, plus the energy stored at its start."""
        change = friction_gap_change(before, answer.state)
        lost = losses_on(change, traction, answer.traction, answer.dissipation)
        return lost._replace(numerical=lost.numerical + self.stored_energy(before))

    def loop_start(self, rule: Rule, state: JointState) -> Start:
        """Return the start of a step; only the rule over whole steps (17) has stored energies."""
        law = Coulomb(0.0, 0.0, self.stiffness_ratio, coefficient_of(self), self.restitution == 1)
        if rule.name == BACKWARD_EULER.name:
            return Start(state.gap, state.elastic_slip, np.array(law, dtype=np.float64))
        if self.restitution:
            return whole_step_from(state, state.internal, law)
        approach = state.approach if len(state.approach) else np.zeros(len(state.gap))
        return whole_step_from(state, None, law, np.column_stack([approach, state.internal[:, 0]]))

    def loop_response(self, rule: Rule, answer: Answer, state: JointState) -> Response:
        """Return the response with the internal variables at the end of the step."""
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
