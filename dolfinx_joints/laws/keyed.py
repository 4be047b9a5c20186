# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Simpler joints than friction, and a dashpot for any joint: frictionless, keyed, viscous."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dolfinx_joints.common.parameters import check_number, hold_floats
from dolfinx_joints.laws.law import (
    NO_COMPLIANCE,
    Floats,
    FrictionNoTension,
    JointState,
    Law,
    Response,
    Status,
    check_law,
    check_stiffness,
    contact_fraction,
    gap_under,
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


@dataclass(frozen=True, kw_only=True)
class KeyedJoint:
    """A joint that opens but does not slip: no tension, and shear keys that hold at any opening.

    t_n = k_n gap_n where gap_n <= 0, else 0;  t_s = k_s gap_s, measured from the state at rest.

    Attributes:
        normal_stiffness: k_n [Pa/m], positive.
        shear_stiffness: k_s [Pa/m], not negative.

    Raises:
        ValueError: A parameter is out of its range.
    """

    internal_variables: ClassVar[tuple[str, ...]] = ()

    normal_stiffness: float
    shear_stiffness: float

    def __post_init__(self) -> None:
        """Check the parameters."""
        hold_floats(self)
        check_stiffness(self.normal_stiffness, self.shear_stiffness)

    def closed_stiffness(self) -> tuple[float, float]:
        """k_n and k_s, [Pa/m]."""
        return self.normal_stiffness, self.shear_stiffness

    def stored_energy(self, state: JointState) -> Floats:
        """k_n <-gap_n>^2 / 2 + k_s |gap_s|^2 / 2 of each point, shape (n,), [J/m^2]."""
        closed = np.minimum(state.gap[:, 0], 0.0)
        slip = np.einsum("ij,ij->i", state.elastic_slip, state.elastic_slip)
        return 0.5 * self.normal_stiffness * closed**2 + 0.5 * self.shear_stiffness * slip

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """Tractions of a gap of shape (n, 3), [m]; they depend on no history."""
        return self.condensed_backward_euler(gap, NO_COMPLIANCE, state)

    def discrete_gradient(self, gap: Floats, state: JointState) -> Response:
        """Tractions over a step that balance the energy; see `FrictionNoTension`."""
        return self.condensed_discrete_gradient(gap, NO_COMPLIANCE, state)

    def condensed_backward_euler(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """What satisfies `backward_euler`; see `FrictionNoTension.condensed_backward_euler`."""
        k_n = self.normal_stiffness / (1.0 + compliance[:, 0] * self.normal_stiffness)
        closed = trial_gap[:, 0] <= 0.0
        t_n = np.where(closed, k_n * trial_gap[:, 0], 0.0)
        slope = np.where(closed, k_n, 0.0)
        gap_n = np.where(closed, t_n / self.normal_stiffness, trial_gap[:, 0])
        return self._with_keys(trial_gap, compliance, state, (t_n, slope, gap_n), mean=1.0)

    def condensed_discrete_gradient(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """What satisfies `discrete_gradient`; see `FrictionNoTension.condensed_backward_euler`."""
        from dolfinx_joints.laws.discrete_gradient import Stiffness, solve_step, stored_by

        k_n = self.normal_stiffness
        answer = solve_step(
            trial_gap,
            compliance,
            state.gap,
            stored_by(state.gap, np.zeros_like(state.elastic_slip), k_n, k_n),
            Stiffness(
                normal_compliance=1.0 / k_n, shear_compliance=1.0 / k_n, ratio=1.0, friction=0.0
            ),
        )
        normal = (answer.traction[:, 0], answer.tangent[:, 0, 0], answer.gap[:, 0])
        return self._with_keys(trial_gap, compliance, state, normal, mean=0.5)

    def _with_keys(
        self,
        trial_gap: Floats,
        compliance: Floats,
        state: JointState,
        normal: tuple[Floats, Floats, Floats],
        *,
        mean: float,
    ) -> Response:
        """Add the keys to normal traction, slope and end gap; ``mean`` of the slip counts."""
        t_n, slope, gap_n = normal
        k_s = self.shear_stiffness / (1.0 + mean * compliance[:, 1] * self.shear_stiffness)
        slip = state.elastic_slip + mean * (trial_gap[:, 1:] - state.gap[:, 1:])
        traction = np.column_stack([t_n, k_s[:, None] * slip])
        tangent = np.zeros((len(trial_gap), 3, 3))
        tangent[:, 0, 0] = slope
        tangent[:, 1, 1] = tangent[:, 2, 2] = mean * k_s
        gap = gap_under(trial_gap, compliance, traction)
        gap[:, 0] = gap_n
        return Response(
            traction=traction,
            tangent=tangent,
            state=JointState(
                gap=gap, elastic_slip=state.elastic_slip + gap[:, 1:] - state.gap[:, 1:]
            ),
            dissipation=np.zeros(len(gap)),
            status=np.where(gap_n > 0.0, Status.OPEN, Status.STICK).astype(np.int8),
        )


@dataclass(frozen=True, kw_only=True)
class ViscousJoint:
    """A joint law with dashpots that act while the joint is closed.

    To the tractions of ``law`` are added, over a step of length dt,

        t_n = eta_n (<gap_n1> - <gap_n0>) / dt   with <g> = min(g, 0), and no tension in the sum,
        t_s = eta_s gap_s' dt_c / dt,            dt_c the part of the step in contact,

    where the point is closed at the end of the step; t_s is never larger than the pressure, else it
    would stop at once where the joint opens. In statics the dashpots are at rest. There is no
    ``condensed_backward_euler``: models take the monolithic path.

    Attributes:
        law: The law without dashpots, without dilatancy.
        normal_viscosity: eta_n [Pa s/m], not negative.
        shear_viscosity: eta_s [Pa s/m], not negative.

    Raises:
        ValueError: A parameter is out of its range.
    """

    law: Law
    normal_viscosity: float = 0.0
    shear_viscosity: float = 0.0

    def __post_init__(self) -> None:
        """Check the parameters."""
        hold_floats(self)
        check_law("law", self.law)
        if getattr(self.law, "dilatancy_angle_deg", 0.0):
            raise ValueError(
                "law has a dilatancy angle; dashpots are for joints that close at a gap of zero."
            )
        for name in ("normal_viscosity", "shear_viscosity"):
            value = getattr(self, name)
            check_number(name, value, lambda v: v >= 0, "zero or more and finite", unit="Pa s/m")

    @property
    def internal_variables(self) -> tuple[str, ...]:
        """Those of the law."""
        return getattr(self.law, "internal_variables", ())

    def closed_stiffness(self) -> tuple[float, float]:
        """k_n and k_s of the law, [Pa/m]."""
        return self.law.closed_stiffness()

    def stored_energy(self, state: JointState) -> Floats:
        """Elastic energy of the law, shape (n,), [J/m^2]."""
        return self.law.stored_energy(state)

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """The law's answer with the dashpots' tractions; their work counts as dissipation."""
        return self._with_dashpots(self.law.backward_euler(gap, state), gap, state)

    def discrete_gradient(self, gap: Floats, state: JointState) -> Response:
        """The same for the law's answer over a whole step, or at its end if it has no other."""
        answer = getattr(self.law, "discrete_gradient", self.law.backward_euler)(gap, state)
        return self._with_dashpots(answer, gap, state)

    def _with_dashpots(self, answer: Response, gap: Floats, state: JointState) -> Response:
        """Add what the dashpots carry where the point is closed at the end of the step."""
        closed = answer.status != Status.OPEN
        eta_n, eta_s = self.normal_viscosity / state.dt, self.shear_viscosity / state.dt
        before, after = state.gap[:, 0], np.minimum(gap[:, 0], 0.0)
        pressed = after - np.minimum(before, 0.0)
        # The dashpot alone may not pull: it gives up where it would outweigh the pressure.
        most = np.maximum(-answer.traction[:, 0], 0.0)
        dash_n = np.where(closed, np.minimum(eta_n * pressed, most), 0.0)
        acts = closed & (dash_n == eta_n * pressed)
        fraction = contact_fraction(before, after)
        slip = gap[:, 1:] - state.gap[:, 1:]
        tangent = answer.tangent.copy()
        tangent[~acts & closed & (answer.traction[:, 0] <= 0.0), 0] = 0.0
        tangent[:, 0, 0] += np.where(acts & (gap[:, 0] <= 0.0), eta_n, 0.0)
        t_n = answer.traction[:, 0] + dash_n
        rates: Floats = np.zeros((len(gap), 2, 3))
        landing = closed & (before > 0.0) & (gap[:, 0] <= 0.0)
        way = np.where(landing, before - after, 1.0)
        rates[:, :, 0] = np.where(landing, -eta_s * (before / way) / way, 0.0)[:, None] * slip
        rates[:, 0, 1] = rates[:, 1, 2] = np.where(closed, eta_s * fraction, 0.0)
        dash_s = np.where(closed, eta_s * fraction, 0.0)[:, None] * slip
        falling = np.where(t_n[:, None] < 0.0, -tangent[:, 0], 0.0)
        dash_s, rates = _at_most(dash_s, rates, np.maximum(-t_n, 0.0), falling)
        tangent[:, 1:] += rates
        lost = dash_n * pressed + fraction * np.einsum("ij,ij->i", dash_s, slip)
        return replace(
            answer,
            traction=answer.traction + np.column_stack([dash_n, dash_s]),
            tangent=tangent,
            dissipation=answer.dissipation + lost,
        )


def _at_most(
    shear: Floats, rates: Floats, limit: Floats, limit_rates: Floats
) -> tuple[Floats, Floats]:
    """Shear tractions (n, 2) shortened to a limit (n,), and their derivatives (n, 2, 3)."""
    size = np.hypot(shear[:, 0], shear[:, 1])
    bound = size >= limit
    safe = np.where(size > 0.0, size, 1.0)
    direction = shear / safe[:, None]
    ratio = np.where(bound, limit / safe, 1.0)
    across = rates - direction[:, :, None] * np.einsum("ni,nij->nj", direction, rates)[:, None]
    turned = direction[:, :, None] * limit_rates[:, None] + ratio[:, None, None] * across
    return ratio[:, None] * shear, np.where(bound[:, None, None], turned, rates)
