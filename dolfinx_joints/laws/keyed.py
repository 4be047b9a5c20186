# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A joint with shear keys: it opens but does not slip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import annotated_types as at
import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.laws.law import (
    NO_COMPLIANCE,
    Floats,
    JointState,
    Losses,
    Response,
    Status,
    gap_under,
)
from dolfinx_joints.laws.losses import Way, losses_on, overlap_and_slip
from dolfinx_joints.laws.points.discrete_gradient import (
    discrete_gradient_points,
    stored_by,
    whole_step_from,
)
from dolfinx_joints.laws.points.return_mapping import Coulomb, solve_points


@dataclass(frozen=True, kw_only=True)
@checked
class KeyedJoint:
    """A joint that opens but does not slip: no tension, and shear keys that carry at any opening.

    t_n = k_n gap_n where gap_n <= 0, else 0;  t_s = k_s gap_s, measured from the state at rest.

    Attributes:
        normal_stiffness: k_n.
        shear_stiffness: k_s.
    """

    normal_stiffness: Annotated[float, at.Gt(0), at.Unit("Pa/m")]
    shear_stiffness: Annotated[float, at.Ge(0), at.Unit("Pa/m")]

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

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Losses of an end-point step (30), see `LawWithLosses`."""
        k = np.array([self.normal_stiffness, self.shear_stiffness, self.shear_stiffness])
        start, end = overlap_and_slip(before), overlap_and_slip(answer.state)
        flight = np.zeros_like(start)
        flight[:, 0] = np.maximum(answer.state.gap[:, 0], 0.0) - np.maximum(before.gap[:, 0], 0.0)
        way = Way(end - start, np.zeros_like(start), flight)
        return losses_on(way, traction, 0.5 * k * (start + end), answer.dissipation)

    def condensed_backward_euler(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """`backward_euler` at gap = trial_gap - compliance * t; see `CondensedLaw`."""
        k_n = self.normal_stiffness / (1.0 + compliance[:, 0] * self.normal_stiffness)
        closed = trial_gap[:, 0] <= 0.0
        t_n = np.where(closed, k_n * trial_gap[:, 0], 0.0)
        slope = np.where(closed, k_n, 0.0)
        gap_n = np.where(closed, t_n / self.normal_stiffness, trial_gap[:, 0])
        return self._with_keys(trial_gap, compliance, state, (t_n, slope, gap_n), mean=1.0)

    def condensed_discrete_gradient(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """`discrete_gradient` at gap = trial_gap - compliance * t; see `CondensedLaw`."""
        k_n = self.normal_stiffness
        law = Coulomb(1.0 / k_n, 1.0 / k_n, 1.0, 0.0)
        start = whole_step_from(state, stored_by(state, k_n, 0.0), law)
        answer = solve_points(discrete_gradient_points, trial_gap, compliance, start)
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
        closed = Status.STICK if self.shear_stiffness > 0.0 else Status.FRICTIONLESS
        return Response(
            traction=traction,
            tangent=tangent,
            state=JointState(
                gap=gap, elastic_slip=state.elastic_slip + gap[:, 1:] - state.gap[:, 1:]
            ),
            dissipation=np.zeros(len(gap)),
            status=np.where(gap_n > 0.0, Status.OPEN, closed).astype(np.int8),
        )
