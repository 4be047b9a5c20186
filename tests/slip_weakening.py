# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A user's law in a file of its own: friction that weakens as the joint slides.

No tension, elastic contact, |t_s| <= -mu t_n with mu = mu_r + (mu_s - mu_r) exp(-s / d), where s is
the plastic slip of all steps before.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba.extending import register_jitable

from dolfinx_joints.laws.points.compiled_law import CompiledLaw, ElasticContact
from dolfinx_joints.laws.points.return_mapping import Start, put_zeros, response_of


@register_jitable
def weakening_point(i, start, answer):
    """Write the answer of the point i at the gap answer.gap[i]."""
    put_zeros(i, answer)
    k_n, k_s, mu_s, mu_r, distance = start.parameters
    gap, before, old = answer.gap[i], start.gap[i], start.history[i]
    traction, tangent, new = answer.traction[i], answer.tangent[i], answer.history[i]
    new[2] = old[2]
    if gap[0] > 0.0:
        return
    traction[0], tangent[0, 0] = k_n * gap[0], k_n
    trial_1 = k_s * (old[0] + gap[1] - before[1])
    trial_2 = k_s * (old[1] + gap[2] - before[2])
    size = math.sqrt(trial_1 * trial_1 + trial_2 * trial_2)
    mu = mu_r + (mu_s - mu_r) * math.exp(-old[2] / distance)
    limit = -mu * traction[0]
    answer.status[i], share = 1, 1.0
    if size > limit:
        answer.status[i], share = 2, limit / size
        m_1, m_2 = trial_1 / size, trial_2 / size
        tangent[1, 0], tangent[2, 0] = -mu * k_n * m_1, -mu * k_n * m_2
        tangent[1, 1], tangent[2, 2] = share * k_s * m_2 * m_2, share * k_s * m_1 * m_1
        tangent[1, 2] = tangent[2, 1] = -share * k_s * m_1 * m_2
        new[2] += (size - limit) / k_s
        mean = 0.5 * (limit + k_s * math.sqrt(old[0] * old[0] + old[1] * old[1]))
        answer.dissipation[i] = mean * (size - limit) / k_s
    else:
        tangent[1, 1] = tangent[2, 2] = k_s
    traction[1], traction[2] = share * trial_1, share * trial_2
    new[0], new[1] = traction[1] / k_s, traction[2] / k_s


@dataclass(frozen=True, kw_only=True)
class SlipWeakening(ElasticContact, CompiledLaw):
    """The law. Stiffnesses are in Pa/m, the distance d in m."""

    points: ClassVar = {"backward_euler": weakening_point}
    internal_variables = ("slip",)

    normal_stiffness: float
    shear_stiffness: float
    static_friction: float
    residual_friction: float
    distance: float

    def initial_variables(self, gap):
        return np.zeros((len(gap), 1))

    def loop_start(self, rule, state):
        friction = self.static_friction, self.residual_friction
        parameters = (self.normal_stiffness, self.shear_stiffness, *friction, self.distance)
        history = np.column_stack([state.elastic_slip, state.internal])
        return Start(state.gap, history, np.array(parameters))

    def loop_response(self, rule, answer, state):
        slip, internal = answer.history[:, :2], answer.history[:, 2:]
        return response_of(answer, elastic_slip=slip, internal=internal)
