# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction without tension at the end of a step: backward Euler, in closed form.

Each point sits on a compliance c of the structure, gap = trial_gap - c t; c = 0 gives the law by
itself. In tractions the law's own compliances d = 1/k add to c, so that a rigid joint (d = 0) is a
case like any other. Where a point closes within the step, only the slip after touching loads it:
with the path taken as straight, the fraction d |t_n| / (gap_n0 + d |t_n|) of the slip, which stands
for the shear compliance kappa (gap_n0 + d |t_n|) / |t_n|, kappa = k_n / k_s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Values of `dolfinx_joints.laws.law.Status`.
OPEN, STICK, SLIP = 0, 1, 2


@dataclass(frozen=True, kw_only=True)
class BackwardEulerAnswer:
    """What `solve_backward_euler` gives for ``n`` points.

    Attributes:
        traction: (n, s1, s2) components, shape (n, 3), [Pa].
        tangent: d traction / d trial_gap, shape (n, 3, 3), [Pa/m].
        gap: Gap at the end, shape (n, 3), [m].
        elastic_slip: At the end, shape (n, 2), [m].
        dissipation: Friction work of the step, shape (n,), [J/m^2].
        status: Open, stick or slip, shape (n,).
    """

    traction: Floats
    tangent: Floats
    gap: Floats
    elastic_slip: Floats
    dissipation: Floats
    status: NDArray[np.int8]


def solve_backward_euler(
    trial_gap: Floats,
    compliance: Floats,
    gap: Floats,
    elastic_slip: Floats,
    *,
    normal_compliance: float,
    shear_compliance: float,
    ratio: float,
    friction: float,
) -> BackwardEulerAnswer:
    """Tractions at the end of a step, each point on its own compliance.

    Compiled for double precision; arrays of any other type are worked on by the interpreter.

    Args:
        trial_gap: Gap if the point carried no traction, shape (n, 3), [m].
        compliance: Normal and tangential compliance, shape (n or 1, 2), [m/Pa].
        gap: Gap at the start of the step, shape (n, 3), [m].
        elastic_slip: At the start of the step, shape (n, 2), [m].
        normal_compliance: 1 / k_n [m/Pa], zero if rigid.
        shear_compliance: 1 / k_s [m/Pa], zero if rigid, infinite without shear stiffness.
        ratio: k_n / k_s.
        friction: mu.
    """
    count, kind = len(trial_gap), trial_gap.dtype
    answer = BackwardEulerAnswer(
        traction=np.zeros((count, 3), kind),
        tangent=np.zeros((count, 3, 3), kind),
        gap=trial_gap.copy(),
        elastic_slip=np.zeros((count, 2), kind),
        dissipation=np.empty(count, kind),
        status=np.zeros(count, np.int8),
    )
    march = _solve_end_point if kind == np.float64 else _solve_end_point.py_func
    march(
        trial_gap,
        compliance,
        gap,
        elastic_slip,
        normal_compliance,
        shear_compliance,
        ratio,
        friction,
        answer.traction,
        answer.tangent,
        answer.gap,
        answer.elastic_slip,
        answer.dissipation,
        answer.status,
    )
    return answer


@njit(cache=True, error_model="numpy")
def _solve_end_point(
    trial_gap: Floats,
    compliance: Floats,
    gap: Floats,
    elastic_slip: Floats,
    d_n: float,
    d_s: float,
    kappa: float,
    mu: float,
    traction: Floats,
    tangent: Floats,
    end_gap: Floats,
    end_slip: Floats,
    dissipation: Floats,
    status: NDArray[np.int8],
) -> None:
    """`solve_backward_euler` into arrays; end_gap holds the free gap at first."""
    shears = d_s < np.inf
    for i in range(len(trial_gap)):
        j = i if len(compliance) > 1 else 0
        c_n, c_s = compliance[j, 0], compliance[j, 1]
        e_1, e_2 = elastic_slip[i, 0], elastic_slip[i, 1]
        opening = max(gap[i, 0], 0.0 * c_n)
        zero = 0.0 * c_n
        held_1, held_2 = (e_1 / d_s, e_2 / d_s) if d_s > 0.0 else (zero, zero)
        if trial_gap[i, 0] > 0.0:
            # What slip there is becomes plastic; none of it meets friction in flight.
            rubbed = zero if opening > 0.0 else 1.0 + zero
            plastic_1 = rubbed * (trial_gap[i, 1] - gap[i, 1]) + e_1
            plastic_2 = rubbed * (trial_gap[i, 2] - gap[i, 2]) + e_2
            dissipation[i] = 0.5 * (held_1 * plastic_1 + held_2 * plastic_2)
            continue
        lead = c_n + d_n
        slope = 1.0 / lead if lead > 0.0 else zero  # zero: rigid, and both sides held
        t_n = slope * trial_gap[i, 0]
        pressure = -t_n
        slip_1 = e_1 + trial_gap[i, 1] - gap[i, 1]
        slip_2 = e_2 + trial_gap[i, 2] - gap[i, 2]
        fraction, k, k_slope = 1.0 + zero, zero, zero
        if opening > 0.0:
            way = opening + d_n * pressure
            fraction = d_n * pressure / way
            if shears:
                per_pressure = 1.0 / (c_s * pressure + kappa * way)
                k = pressure * per_pressure
                k_slope = -kappa * opening * per_pressure * per_pressure * slope
        elif shears and c_s + d_s > 0.0:
            k = 1.0 / (c_s + d_s)
        t_1, t_2 = k * slip_1, k * slip_2
        size, limit = np.hypot(t_1, t_2), mu * pressure
        traction[i, 0], tangent[i, 0, 0] = t_n, slope
        if size > limit:
            status[i] = SLIP
            along_1, along_2 = t_1 / size, t_2 / size
            t_1, t_2, k = limit * along_1, limit * along_2, k * limit / size
            tangent[i, 1, 0], tangent[i, 2, 0] = -mu * slope * along_1, -mu * slope * along_2
            tangent[i, 1, 1] = k * (1.0 - along_1 * along_1)
            tangent[i, 2, 2] = k * (1.0 - along_2 * along_2)
            tangent[i, 1, 2] = tangent[i, 2, 1] = -k * along_1 * along_2
        else:
            status[i] = STICK
            tangent[i, 1, 0], tangent[i, 2, 0] = k_slope * slip_1, k_slope * slip_2
            tangent[i, 1, 1] = tangent[i, 2, 2] = k
        traction[i, 1], traction[i, 2] = t_1, t_2
        if c_n > 0.0:  # of a stiff joint the traction holds more digits of the overlap
            end_gap[i, 0] = d_n * t_n
        end_gap[i, 1] = trial_gap[i, 1] - c_s * t_1
        end_gap[i, 2] = trial_gap[i, 2] - c_s * t_2
        mean_1, mean_2 = t_1, t_2
        if shears:
            end_slip[i, 0], end_slip[i, 1] = d_s * t_1, d_s * t_2
            if d_s > 0.0:
                mean_1, mean_2 = 0.5 * (t_1 + held_1), 0.5 * (t_2 + held_2)
        plastic_1 = fraction * (end_gap[i, 1] - gap[i, 1]) - (end_slip[i, 0] - e_1)
        plastic_2 = fraction * (end_gap[i, 2] - gap[i, 2]) - (end_slip[i, 1] - e_2)
        dissipation[i] = mean_1 * plastic_1 + mean_2 * plastic_2
