# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint with elastic shear keys: it opens but does not slip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import annotated_types as at
import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.kernels import inline
from dolfinx_joints.laws.friction import normal_traction
from dolfinx_joints.laws.law import (
    BACKWARD_EULER,
    DISCRETE_GRADIENT,
    Floats,
    JointState,
    Losses,
    Response,
    Rule,
)
from dolfinx_joints.laws.losses import GapChange, losses_on, overlap_and_slip
from dolfinx_joints.laws.points.compiled_law import EnergyConsistentContact
from dolfinx_joints.laws.points.discrete_gradient import normal_traction as normal_over_step
from dolfinx_joints.laws.points.return_mapping import (
    FRICTIONLESS,
    STICK,
    Answer,
    Coulomb,
    Start,
    at_gap,
    closed_form_loop,
    put_zeros,
    response_of,
)

RULES = (BACKWARD_EULER.name, DISCRETE_GRADIENT.name)


@inline
def keyed_on(i: int, c_n: float, c_s: float, start: Start, answer: Answer) -> None:
    """Compute the response of a point; on entry ``answer.gap`` is the trial gap.

    The parameters are k_n, k_s and the weight of the slip increment: 1 at the end of a step, 1/2
    over a whole step.
    """
    k_n, k_s, mean = start.parameters[0], start.parameters[1], start.parameters[2]
    law = Coulomb(1.0 / k_n, 1.0 / k_n, 1.0, 0.0)
    before, gap, slip = start.gap[i], answer.gap[i], start.history[i]
    put_zeros(i, answer)
    if mean < 1.0:
        overlap = min(before[0], 0.0)
        energy = 0.5 * k_n * overlap * overlap
        normal = normal_over_step(gap[0] - before[0], c_n, before[0], energy, law)
        answer.traction[i, 0], answer.tangent[i, 0, 0] = normal.traction, normal.stiffness
        gap[0] = normal.gap
    elif gap[0] <= 0.0:
        t_n, stiffness = normal_traction(gap[0], c_n, law)
        answer.traction[i, 0], answer.tangent[i, 0, 0] = t_n, stiffness
        gap[0] = t_n / k_n
    k = k_s / (1.0 + mean * c_s * k_s)
    for a in range(1, 3):
        answer.traction[i, a] = k * (slip[a - 1] + mean * (gap[a] - before[a]))
        answer.tangent[i, a, a] = mean * k
        gap[a] -= c_s * answer.traction[i, a]
        answer.history[i, a - 1] = slip[a - 1] + gap[a] - before[a]
    if not gap[0] > 0.0:
        answer.status[i] = STICK if k_s > 0.0 else FRICTIONLESS


@dataclass(frozen=True, kw_only=True)
@checked
class KeyedJoint(EnergyConsistentContact):
    """Joint that opens but does not slip: no tension, and shear keys that act at any opening.

    t_n = k_n gap_n if gap_n <= 0, else 0;  t_s = k_s gap_s, measured from the state at rest.

    Attributes:
        normal_stiffness: k_n.
        shear_stiffness: k_s.

    Example:
        >>> import numpy as np
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.laws.law import JointState
        >>> law = dj.KeyedJoint(normal_stiffness=1e9, shear_stiffness=2e9)
        >>> gap = np.array([[0.003, 0.001, 0.0]])  # open by 3 mm, tangential 1 mm [m]
        >>> law.backward_euler(gap, JointState.at_rest(np.zeros((1, 3)))).traction.round()  # [Pa]
        array([[      0., 2000000.,       0.]])
    """

    loops: ClassVar[Mapping[str, Any]] = dict.fromkeys(RULES, closed_form_loop(keyed_on))
    points: ClassVar[Mapping[str, Any]] = dict.fromkeys(RULES, at_gap(keyed_on))

    normal_stiffness: Annotated[float, at.Gt(0), at.Unit("Pa/m")]
    shear_stiffness: Annotated[float, at.Ge(0), at.Unit("Pa/m")]

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Return the losses (30) of a backward Euler step; see `LawWithLosses`."""
        k = np.array([self.normal_stiffness, self.shear_stiffness, self.shear_stiffness])
        start, end = overlap_and_slip(before), overlap_and_slip(answer.state)
        flight = np.zeros_like(start)
        flight[:, 0] = np.maximum(answer.state.gap[:, 0], 0.0) - np.maximum(before.gap[:, 0], 0.0)
        change = GapChange(end - start, np.zeros_like(start), flight)
        return losses_on(change, traction, 0.5 * k * (start + end), answer.dissipation)

    def loop_start(self, rule: Rule, state: JointState) -> Start:
        """Return gap, elastic slip and parameters at the start of the step."""
        row = (self.normal_stiffness, self.shear_stiffness, rule.weight)
        return Start(state.gap, state.elastic_slip, np.array(row))

    def loop_response(self, rule: Rule, answer: Answer, state: JointState) -> Response:
        """Return the response; the history variables are the elastic slip."""
        return response_of(answer, elastic_slip=answer.history)
