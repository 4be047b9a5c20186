# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction without tension, the law of the paper, and its form without friction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.parameters import check_number, hold_floats
from dolfinx_joints.laws.law import NO_COMPLIANCE, Floats, JointState, Response


@dataclass(frozen=True, kw_only=True)
class FrictionNoTension:
    """No tension, elastic contact, Coulomb friction without dilatancy (paper eqs. 3 to 5).

    Open (gap_n > 0): t = 0. Closed: t_n = k_n gap_n, t_s = k_s e with |t_s| <= -t_n tan(alpha);
    sliding changes t_s along itself only (plastic potential |t_s|), so the tangent is unsymmetric.
    On opening the elastic slip e becomes zero: what slip there is, is plastic. Where a point closes
    within a step, only the slip after touching loads it: with the path of a step taken as straight,
    the fraction gap_n1 / (gap_n1 - gap_n0) of the step's slip.

    Departure from the paper: compression is negative here, so its yield function
    |t_s| - t_n tan(alpha) reads |t_s| + t_n tan(alpha).

    Attributes:
        normal_stiffness: k_n [Pa/m], positive.
        shear_stiffness: k_s [Pa/m], not negative.
        friction_angle_deg: alpha [degrees], at least 0 and below 90.

    Raises:
        ValueError: A parameter is out of its range.
    """

    internal_variables: ClassVar[tuple[str, ...]] = ()

    normal_stiffness: float
    shear_stiffness: float
    friction_angle_deg: float

    def __post_init__(self) -> None:
        """Check the parameters."""
        hold_floats(self)
        check_stiffness(self.normal_stiffness, self.shear_stiffness)
        check_friction_angle(self.friction_angle_deg)

    @property
    def friction_coefficient(self) -> float:
        """Mu = tan(alpha)."""
        return math.tan(math.radians(self.friction_angle_deg))

    def closed_stiffness(self) -> tuple[float, float]:
        """k_n and k_s, [Pa/m]."""
        return self.normal_stiffness, self.shear_stiffness

    def stored_energy(self, state: JointState) -> Floats:
        """k_n <-gap_n>^2 / 2 + k_s |e|^2 / 2 of each point, shape (n,), [J/m^2]."""
        closed = np.minimum(state.gap[:, 0], 0.0)
        slip = np.einsum("ij,ij->i", state.elastic_slip, state.elastic_slip)
        return 0.5 * self.normal_stiffness * closed**2 + 0.5 * self.shear_stiffness * slip

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """Return mapping at the end of a step (backward Euler, closed form).

        Args:
            gap: Trial gap, shape (n, 3), [m].
            state: State at the start of the step.

        Returns:
            Tractions, consistent tangent, trial state, friction work and status.
        """
        return self.condensed_backward_euler(gap, NO_COMPLIANCE, state)

    def condensed_backward_euler(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """What satisfies `backward_euler` at gap = trial_gap - compliance * t (closed form).

        With the compliance c of the structure at the point, the law's stiffness k becomes
        1 / (c + 1/k), and k_s that of the fraction of the slip that counts; nothing else changes.

        Args:
            trial_gap: Gap if the point carried no traction, shape (n, 3), [m].
            compliance: Normal and tangential compliance, shape (n or 1, 2), [m/Pa].
            state: State at the start of the step.

        Returns:
            The answer at that gap, its tangent being d traction / d trial_gap.
        """
        from dolfinx_joints.laws.return_mapping import solve_backward_euler

        k_s = self.shear_stiffness
        answer = solve_backward_euler(
            trial_gap,
            compliance,
            state.gap,
            state.elastic_slip,
            normal_compliance=1.0 / self.normal_stiffness,
            shear_compliance=1.0 / k_s if k_s else math.inf,
            ratio=self.normal_stiffness / k_s if k_s else math.inf,
            friction=self.friction_coefficient,
        )
        return Response(
            traction=answer.traction,
            tangent=answer.tangent,
            state=JointState(gap=answer.gap, elastic_slip=answer.elastic_slip),
            dissipation=answer.dissipation,
            status=answer.status,
        )

    def discrete_gradient(self, gap: Floats, state: JointState) -> Response:
        """Energy-consistent answer over a whole step, see `midpoint_law` (closed form).

        Args:
            gap: Trial gap at the end, shape (n, 3), [m].
            state: State at the start of the step.

        Returns:
            Tractions that act over the step, consistent tangent, trial state, friction work and
            status at the end.
        """
        return self.condensed_discrete_gradient(gap, NO_COMPLIANCE, state)

    def condensed_discrete_gradient(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """What satisfies `discrete_gradient` at gap = trial_gap - compliance * t."""
        from dolfinx_joints.laws.discrete_gradient import Stiffness, solve_step, stored_by

        # Without shear stiffness friction is never mobilised, as if there were none.
        k_s = self.shear_stiffness or self.normal_stiffness
        stored = stored_by(
            state.gap, state.elastic_slip, self.normal_stiffness, self.shear_stiffness
        )
        answer = solve_step(
            trial_gap,
            compliance,
            state.gap,
            stored,
            Stiffness(
                normal_compliance=1.0 / self.normal_stiffness,
                shear_compliance=1.0 / k_s,
                ratio=self.normal_stiffness / k_s,
                friction=self.friction_coefficient if self.shear_stiffness else 0.0,
            ),
        )
        root = math.sqrt(self.shear_stiffness) or 1.0
        elastic_slip: NDArray[Any] = answer.stored[:, 1:] / root
        return Response(
            traction=answer.traction,
            tangent=answer.tangent,
            state=JointState(gap=answer.gap, elastic_slip=elastic_slip),
            dissipation=answer.dissipation,
            status=answer.status,
        )


def frictionless(*, normal_stiffness: float) -> FrictionNoTension:
    """A joint that carries pressure only: no tension, no shear.

    Args:
        normal_stiffness: k_n [Pa/m], positive.

    Raises:
        ValueError: The stiffness is not positive.
    """
    return FrictionNoTension(
        normal_stiffness=normal_stiffness, shear_stiffness=0.0, friction_angle_deg=0.0
    )


def contact_fraction(before: Floats, after: Floats) -> Floats:
    """Fraction of a step that a point spends in contact before its end, on a straight path.

    1 where it was closed at the start, after / (after - before) where it closes within the step.

    Args:
        before: Normal gap at the start, shape (n,), [m].
        after: Normal gap at the end, zero where the point is open, shape (n,), [m].
    """
    opening = np.maximum(before, 0.0)
    if not opening.any():
        return np.ones(len(before))
    return np.where(opening > 0.0, -after / np.where(opening > 0.0, opening - after, 1.0), 1.0)


def check_stiffness(normal_stiffness: float, shear_stiffness: float) -> None:
    """Refuse a joint stiffness out of its range.

    Raises:
        ValueError: k_n is not positive, or k_s negative.
    """
    check_number(
        "normal_stiffness", normal_stiffness, lambda v: v > 0, "positive and finite", unit="Pa/m"
    )
    check_number(
        "shear_stiffness",
        shear_stiffness,
        lambda v: v >= 0,
        "zero or more and finite",
        unit="Pa/m",
    )


def check_friction_angle(friction_angle_deg: float) -> None:
    """Refuse a friction angle out of its range.

    Raises:
        ValueError: It is negative, or not below 90 degrees.
    """
    check_number(
        "friction_angle_deg",
        friction_angle_deg,
        lambda v: 0 <= v < 90,
        "at least 0 and below 90 degrees",
    )
