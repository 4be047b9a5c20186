# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Coulomb friction with an adhesion that stays while the joint slides.

With the tension R = c / tan(phi) at the apex of the cone and t_n' = t_n - R, gap_n' = gap_n - R/k_n
the law is that of `friction` in t' and gap'. All its loops and energies hold after this shift.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

import annotated_types as at
import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.kernels import inline
from dolfinx_joints.laws.friction import (
    FrictionNoTension,
    backward_euler_on,
    coefficient_of,
    set_friction,
)
from dolfinx_joints.laws.law import Floats, JointState, Losses, Response, Rule
from dolfinx_joints.laws.points.discrete_gradient import discrete_gradient_on
from dolfinx_joints.laws.points.return_mapping import Answer, Start, at_gap, closed_form_loop


def _shifted(point: Callable[..., None]) -> Callable[..., None]:
    """Return the function of an adhesive point; the last parameter is the tension R (9h)."""

    @inline
    def adhesive_on(i: int, c_n: float, c_s: float, start: Start, answer: Answer) -> None:
        tension = start.parameters[5]
        shift = tension * start.parameters[0]
        answer.gap[i, 0] -= shift + c_n * tension
        point(i, c_n, c_s, start, answer)
        answer.gap[i, 0] += shift
        answer.traction[i, 0] += tension

    return adhesive_on


_ON_COMPLIANCE = {
    "backward_euler": _shifted(backward_euler_on),
    "discrete_gradient": _shifted(discrete_gradient_on),
}


@dataclass(frozen=True, kw_only=True)
@checked
class AdhesiveJoint(FrictionNoTension):
    """Coulomb friction with an adhesion that stays while the joint slides.

    t_n = k_n gap_n up to the tension R = c / tan(alpha), and t_n = R at larger gaps; t_s = k_s e
    with |t_s| <= c - t_n tan(alpha), which is zero at t_n = R. The adhesion is never lost, neither
    by slip nor by opening: use the law for joints that stay closed, and `MohrCoulombJoint` for
    bonds that break. Positive initial gaps are refused. The law is code_aster's JOINT_MECA_FROT
    without tangential hardening.

    Attributes:
        adhesion: c. All other parameters are those of `FrictionNoTension`.

    Raises:
        ValueError: The friction is zero.
    """

    loops: ClassVar[Mapping[str, Any]] = {n: closed_form_loop(p) for n, p in _ON_COMPLIANCE.items()}
    points: ClassVar[Mapping[str, Any]] = {n: at_gap(p) for n, p in _ON_COMPLIANCE.items()}

    shear_stiffness: Annotated[float, at.Gt(0), at.Unit("Pa/m")]
    adhesion: Annotated[float, at.Ge(0), at.Unit("Pa")]

    def __post_init__(self) -> None:
        if not set_friction(self)[0] > 0.0:
            raise ValueError("AdhesiveJoint: friction_angle_deg is 0 degrees; it must be positive.")

    @property
    def largest_tension(self) -> float:
        """R = c / tan(alpha) [Pa]."""
        return self.adhesion / coefficient_of(self)

    def stored_energy(self, state: JointState) -> Floats:
        """Return the energy of gap' plus R gap_n, zero at a gap of zero, shape (n,), [J/m^2]."""
        height = state.gap[:, 0] - 0.5 * self.largest_tension / self.normal_stiffness
        return super().stored_energy(self._shift(state)) + self.largest_tension * height

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Return the losses (30) of a backward Euler step; see `LawWithLosses`."""
        after = replace(answer, state=self._shift(answer.state))
        return super().losses(self._shift(before), after, traction - [self.largest_tension, 0, 0])

    def loop_start(self, rule: Rule, state: JointState) -> Start:
        """Return the start of `FrictionNoTension` at gap', with R as last parameter."""
        start = super().loop_start(rule, self._shift(state))
        return start._replace(parameters=np.append(start.parameters, self.largest_tension))

    def _shift(self, state: JointState) -> JointState:
        """Return a state with gap' = gap - R / k_n."""
        shift = self.largest_tension / self.normal_stiffness
        return replace(state, gap=state.gap - [shift, 0.0, 0.0])
