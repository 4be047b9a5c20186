# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dashpots for any joint law."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

import annotated_types as at
import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.laws.law import (
    EnergyConsistentLaw,
    Floats,
    JointState,
    Law,
    LawWithHistory,
    Losses,
    Response,
    Status,
    has_bonds,
    variables_of,
    with_bonds,
)
from dolfinx_joints.laws.losses import losses_of, work
from dolfinx_joints.laws.mohr_coulomb import MohrCoulombJoint
from dolfinx_joints.laws.points.return_mapping import contact_fraction
from dolfinx_joints.laws.shear_keys import ShearKeyJoint


@dataclass(frozen=True, kw_only=True)
@checked
class ViscousJoint:
    """A joint law with dashpots that act while the joint is closed.

    To the tractions of ``law`` are added, over a step of length dt,

        t_n = eta_n (<gap_n1> - <gap_n0>) / dt   with <g> = min(g, 0), and no tension in the sum,
        t_s = eta_s gap_s' dt_c / dt,            dt_c the part of the step in contact,

    where the point is closed at the end of the step; t_s is never larger than the pressure, else it
    would stop at once where the joint opens. In statics the dashpots are at rest. It is no
    `CondensedLaw`: models take the monolithic path.

    Attributes:
        law: The law without dashpots, without dilatancy or shear keys.
        normal_viscosity: eta_n.
        shear_viscosity: eta_s.

    Raises:
        ValueError: ``law`` is no `Law`, or opens as it slips.
    """

    law: Law
    normal_viscosity: Annotated[float, at.Ge(0), at.Unit("Pa s/m")] = 0.0
    shear_viscosity: Annotated[float, at.Ge(0), at.Unit("Pa s/m")] = 0.0

    def __post_init__(self) -> None:
        """Check the law."""
        if isinstance(self.law, type) or not isinstance(self.law, Law):
            raise ValueError(
                f"ViscousJoint: law is {shown(self.law)}; it must be a joint law of finite "
                "stiffness."
            )
        dilates = isinstance(self.law, MohrCoulombJoint) and self.law.dilatancy_angle_deg
        if dilates or isinstance(self.law, ShearKeyJoint):
            what = "a dilatancy angle" if dilates else "shear keys"
            raise ValueError(
                f"ViscousJoint: law has {what}; dashpots are for joints that close at a "
                "gap of zero."
            )

    @property
    def internal_variables(self) -> tuple[str, ...]:
        """Those of the law."""
        return variables_of(self.law)

    def initial_variables(self, gap: Floats) -> Floats:
        """Those of the law."""
        if isinstance(self.law, LawWithHistory):
            return self.law.initial_variables(gap)
        return np.zeros((len(gap), 0))

    def closed_stiffness(self) -> tuple[float, float]:
        """k_n and k_s of the law, [Pa/m]."""
        return self.law.closed_stiffness()

    def stored_energy(self, state: JointState) -> Floats:
        """Elastic energy of the law, shape (n,), [J/m^2]."""
        return self.law.stored_energy(state)

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """The law's answer in statics."""
        return self.for_step(math.inf).backward_euler(gap, state)

    def for_step(self, dt: float) -> EnergyConsistentLaw:
        """The law of a step of length dt [s], infinite in statics."""
        return DashpotStep(
            law=self.law, normal=self.normal_viscosity / dt, shear=self.shear_viscosity / dt
        )


@dataclass(frozen=True, kw_only=True)
class DashpotStep:
    """A law with dashpots over a step of given length: their viscosities over dt [Pa/m]."""

    law: Law
    normal: float
    shear: float

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
        if not isinstance(self.law, EnergyConsistentLaw):
            return self.backward_euler(gap, state)
        return self._with_dashpots(self.law.discrete_gradient(gap, state), gap, state)

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Those of the law under what the dashpots leave of a traction, and all work on these."""
        start = before
        if has_bonds(self.law):
            breaks = answer.state.internal[:, 0] > before.internal[:, 0]
            start = replace(before, internal=with_bonds(before.internal, breaks))
        alone = self.law.backward_euler(answer.state.gap, start)
        dash = answer.traction - alone.traction
        lost = losses_of(self.law, before, alone, traction - dash)
        return lost._replace(friction=lost.friction + work(dash, answer.state.gap - before.gap))

    def _with_dashpots(self, answer: Response, gap: Floats, state: JointState) -> Response:
        """The answer with the tractions of dashpots where the point is closed at the end."""
        closed = answer.status != Status.OPEN
        before, after = state.gap[:, 0], np.minimum(gap[:, 0], 0.0)
        pressed = after - np.minimum(before, 0.0)
        # The dashpot alone may not pull: it gives up where it would outweigh the pressure.
        most = np.maximum(-answer.traction[:, 0], 0.0)
        dash_n = np.where(closed, np.minimum(self.normal * pressed, most), 0.0)
        acts = closed & (dash_n == self.normal * pressed)
        fraction = contact_fraction(before, after)
        slip = gap[:, 1:] - state.gap[:, 1:]
        tangent = answer.tangent.copy()
        tangent[~acts & closed & (answer.traction[:, 0] <= 0.0), 0] = 0.0
        tangent[:, 0, 0] += np.where(acts & (gap[:, 0] <= 0.0), self.normal, 0.0)
        t_n = answer.traction[:, 0] + dash_n
        rates: Floats = np.zeros((len(gap), 2, 3))
        landing = closed & (before > 0.0) & (gap[:, 0] <= 0.0)
        way = np.where(landing, before - after, 1.0)
        rates[:, :, 0] = np.where(landing, -self.shear * (before / way) / way, 0.0)[:, None] * slip
        rates[:, 0, 1] = rates[:, 1, 2] = np.where(closed, self.shear * fraction, 0.0)
        dash_s = np.where(closed, self.shear * fraction, 0.0)[:, None] * slip
        falling = np.where(t_n[:, None] < 0.0, -tangent[:, 0], 0.0)
        dash_s, rates = _at_most(dash_s, rates, np.maximum(-t_n, 0.0), falling)
        tangent[:, 1:] += rates
        dash = np.column_stack([dash_n, dash_s])
        return replace(
            answer,
            traction=answer.traction + dash,
            tangent=tangent,
            dissipation=answer.dissipation + work(dash, gap - state.gap),
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
