# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint laws and their return mapping: arrays in, arrays out.

A law sees the gap vector of each joint point in the local frame (n, s1, s2), with the initial gap
already included: ``gap[:, 0] > 0`` is open, ``gap[:, 0] <= 0`` closed, tractions are negative in
compression. A trial never changes the state it starts from; whoever accepts a step keeps the state
that the trial returned.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.parameters import (
    check_kind_of,
    check_number,
    hold_floats,
    numbers_of,
    offers,
    shown,
)

Floats = NDArray[np.float64]

NO_COMPLIANCE: Floats = np.zeros((1, 2))


class Status(IntEnum):
    """What a joint point does."""

    OPEN = 0
    STICK = 1
    SLIP = 2


@dataclass(frozen=True, kw_only=True)
class JointState:
    """Committed state of ``n`` joint points.

    Attributes:
        gap: Gap vector (n, s1, s2) at the last accepted step, shape (n, 3), [m].
        elastic_slip: Part of the tangential gap that holds shear traction, shape (n, 2), [m].
        internal: Further variables of the laws that have some, shape (n, m); zero at first.
        dt: Length of the step that starts here, infinite in statics [s].
    """

    gap: Floats
    elastic_slip: Floats
    internal: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    dt: float = math.inf

    @classmethod
    def at_rest(cls, gap: Floats, *, variables: int = 0) -> JointState:
        """State without shear traction at a given gap, shape (n, 3), [m].

        Args:
            gap: The gap, shape (n, 3), [m].
            variables: Number m of internal variables.
        """
        count = len(gap)
        return cls(
            gap=gap.copy(),
            elastic_slip=np.zeros((count, 2)),
            internal=np.zeros((count, variables)),
        )


@dataclass(frozen=True, kw_only=True)
class Response:
    """Answer of a law to a trial gap of ``n`` points.

    Attributes:
        traction: (n, s1, s2) components, shape (n, 3), [Pa].
        tangent: d traction / d gap, shape (n, 3, 3), [Pa/m].
        state: State to keep if the step is accepted.
        dissipation: Friction work of the step per area, shape (n,), [J/m^2]; at the end point the
            mean tangential traction times the plastic slip in contact, which is what the
            trapezoidal rule sees, and may be negative where slip reverses within a long step.
        status: `Status` of each point, shape (n,).
    """

    traction: Floats
    tangent: Floats
    state: JointState
    dissipation: Floats
    status: NDArray[np.int8]


class Law(Protocol):
    """What a joint needs from a law; implement it to use a law of your own.

    A law may also offer

    - ``discrete_gradient(gap, state)``, its answer over a whole step from ``state.gap`` to ``gap``
      such that the work of the traction over the step is what the joint stores and dissipates;
      without it energy-consistent schemes use ``backward_euler`` for this law, and what that loses
      is counted as numerical;
    - ``condensed_backward_euler(trial_gap, compliance, state)`` and
      ``condensed_discrete_gradient`` with the same arguments, as `FrictionNoTension` does; without
      them a model is solved on the monolithic path.

    A law with a history of its own names it in ``internal_variables``, a tuple of strings: it then
    finds one column for each in ``state.internal``, zero at first unless the law has a method
    ``initial_variables(gap)``, and returns the new ones in the state of its response.
    """

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """Traction and consistent tangent at the end of a step, gap of shape (n, 3), [m]."""

    def stored_energy(self, state: JointState) -> Floats:
        """Elastic energy per area of a state, shape (n,), [J/m^2]."""

    def closed_stiffness(self) -> tuple[float, float]:
        """Normal and shear stiffness while closed and sticking, [Pa/m]."""


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


def gap_under(trial_gap: Floats, compliance: Floats, traction: Floats) -> Floats:
    """The gap that a traction leaves of a free gap, shape (n, 3), [m]."""
    gap = trial_gap.copy()
    gap[:, 0] -= compliance[:, 0] * traction[:, 0]
    gap[:, 1:] -= compliance[:, 1:] * traction[:, 1:]
    return gap


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


def check_law(name: str, law: Any) -> None:
    """Refuse what is no joint law.

    Raises:
        ValueError: It has not the methods of one, or its stiffness is none.
    """
    good = offers(law, "backward_euler", "stored_energy", "closed_stiffness")
    check_kind_of(name, law, good, "a joint law")
    stiffness = numbers_of(law.closed_stiffness())
    if stiffness is None or stiffness.shape != (2,) or not (stiffness >= 0.0).all():
        raise ValueError(
            f"{type(law).__name__}.closed_stiffness() gives {shown(law.closed_stiffness())}; it "
            "must be two numbers of zero or more, k_n and k_s."
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
