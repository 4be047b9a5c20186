# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A joint without compliance: no overlap, no elastic slip."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.parameters import check_number, hold_floats
from dolfinx_joints.laws.friction import check_friction_angle
from dolfinx_joints.laws.law import Floats, JointState, Response, Status


@dataclass(frozen=True, kw_only=True)
class RigidJoint:
    """`FrictionNoTension` with k_n and k_s infinite, their ratio given.

    Its tractions follow from the structure alone, so it needs the condensed solver. With the
    energy-consistent scheme, what a point brings into contact in a step is stored and given back
    when it leaves, so that impacts are elastic; in statics and with end-point schemes it stores
    nothing.

    Internal variables: the energy stored in normal contact [J/m^2] and the root of that in shear,
    two components [(J/m^2)^(1/2)].

    Attributes:
        friction_angle_deg: alpha [degrees], at least 0 and below 90.
        stiffness_ratio: k_n / k_s, positive; it says how much of the shear energy of a point that
            loses pressure can stay.

    Raises:
        ValueError: A parameter is out of its range.
    """

    internal_variables: ClassVar[tuple[str, ...]] = (
        "normal_energy",
        "shear_root_1",
        "shear_root_2",
    )

    friction_angle_deg: float
    stiffness_ratio: float = 1.0

    def __post_init__(self) -> None:
        """Check the parameters."""
        hold_floats(self)
        check_friction_angle(self.friction_angle_deg)
        check_number("stiffness_ratio", self.stiffness_ratio, lambda v: v > 0, "positive, finite")

    @property
    def friction_coefficient(self) -> float:
        """Mu = tan(alpha)."""
        return math.tan(math.radians(self.friction_angle_deg))

    def closed_stiffness(self) -> tuple[float, float]:
        """Infinite, both."""
        return math.inf, math.inf

    def stored_energy(self, state: JointState) -> Floats:
        """Energy of each point, shape (n,), [J/m^2]."""
        return state.internal[:, 0] + 0.5 * np.sum(state.internal[:, 1:] ** 2, axis=1)

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """No traction at points that touch or are open, as where a motion starts.

        Raises:
            JointsError: A point overlaps: what it carries does not follow from its gap.
        """
        if np.any(gap[:, 0] < 0.0):
            raise JointsError(
                f"A rigid joint overlaps by {-gap[:, 0].min():.3g} m: it must start "
                "without overlap, or from a static stage, and needs the condensed solver."
            )
        count = len(gap)
        return Response(
            traction=np.zeros((count, 3)),
            tangent=np.zeros((count, 3, 3)),
            state=JointState(
                gap=gap.copy(), elastic_slip=np.zeros((count, 2)), internal=state.internal.copy()
            ),
            dissipation=np.zeros(count),
            status=np.where(gap[:, 0] > 0.0, Status.OPEN, Status.STICK).astype(np.int8),
        )

    def discrete_gradient(self, gap: Floats, state: JointState) -> Response:
        """Refused: without the compliance of the structure there is no answer.

        Raises:
            JointsError: Always.
        """
        raise JointsError("A rigid joint needs the condensed solver.")

    def condensed_backward_euler(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """Answer at the end of a step; see `FrictionNoTension`. It stores no energy."""
        from dolfinx_joints.laws.return_mapping import solve_backward_euler

        answer = solve_backward_euler(
            trial_gap,
            compliance,
            state.gap,
            state.elastic_slip,
            normal_compliance=0.0,
            shear_compliance=0.0,
            ratio=self.stiffness_ratio,
            friction=self.friction_coefficient,
        )
        return Response(
            traction=answer.traction,
            tangent=answer.tangent,
            state=JointState(
                gap=answer.gap,
                elastic_slip=answer.elastic_slip,
                internal=np.zeros_like(state.internal),
            ),
            dissipation=answer.dissipation,
            status=answer.status,
        )

    def condensed_discrete_gradient(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """Answer over a step on a point's own compliance; see `FrictionNoTension`."""
        from dolfinx_joints.laws.discrete_gradient import Stiffness, solve_step

        answer = solve_step(
            trial_gap,
            compliance,
            state.gap,
            state.internal,
            Stiffness(
                normal_compliance=0.0,
                shear_compliance=0.0,
                ratio=self.stiffness_ratio,
                friction=self.friction_coefficient,
            ),
        )
        return Response(
            traction=answer.traction,
            tangent=answer.tangent,
            state=JointState(
                gap=answer.gap,
                elastic_slip=np.zeros((len(trial_gap), 2)),
                internal=answer.stored,
            ),
            dissipation=answer.dissipation,
            status=answer.status,
        )
