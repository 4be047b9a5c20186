# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction without tension over a whole step, so that energy balances: the discrete gradient.

A step goes on a straight path from the gap g0 to g1. With psi the elastic energy of normal contact,
the normal traction is (psi1 - psi0) / (g1 - g0), and shear acts during the fraction theta of the
step in contact:

    t_n = k_n (a + b) / 2 theta,           a = min(g0, 0), b = min(g1, 0),
    s   = k_s (e0 + theta ds / 2),         scaled onto |s| <= mu |t_n| / theta,   t_s = theta s,
    z   = 2 s / k_s - e0,                  e1 = z scaled onto |e1| <= mu k_n <-g1> / k_s.

Then t . (change of the gap) is the change of the elastic energy plus what friction dissipates, to
rounding, for any length of step.

All of it is solved in tractions on a compliance c of the structure at the point, g1 - g0 = h - c t:
h is the change of the gap that the point would see without its own traction, c = 0 gives the law by
itself. In these variables a rigid joint (1/k_n = 1/k_s = 0) is a case like any other. Energies per
area stand for gaps of closed points: psi = k_n g^2 / 2 and q = sqrt(k_s) e, [J/m^2] and its root.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numba.extending import register_jitable
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Values of `dolfinx_joints.laws.law.Status`.
STICK, SLIP = 1, 2


@dataclass(frozen=True, kw_only=True)
class Stiffness:
    """Stiffness and friction of the points of one law.

    Attributes:
        normal_compliance: 1 / k_n [m/Pa], zero if rigid.
        shear_compliance: 1 / k_s [m/Pa], zero if rigid.
        ratio: k_n / k_s.
        friction: mu.
    """

    normal_compliance: float
    shear_compliance: float
    ratio: float
    friction: float


@dataclass(frozen=True, kw_only=True)
class StepAnswer:
    """What `solve_step` gives for ``n`` points.

    Attributes:
        traction: (n, s1, s2) components, shape (n, 3), [Pa].
        tangent: d traction / d trial_gap, shape (n, 3, 3), [Pa/m].
        gap: Gap at the end, shape (n, 3), [m].
        stored: psi [J/m^2] and q [(J/m^2)^(1/2)] at the end, shape (n, 3).
        dissipation: Friction work of the step, shape (n,), [J/m^2].
        status: `Status` at the end of the step, shape (n,).
    """

    traction: Floats
    tangent: Floats
    gap: Floats
    stored: Floats
    dissipation: Floats
    status: NDArray[np.int8]


def solve_step(
    trial_gap: Floats,
    compliance: Floats,
    gap: Floats,
    stored: Floats,
    stiffness: Stiffness,
) -> StepAnswer:
    """Tractions of a step, each point on its own compliance, in closed form.

    Compiled for double precision; arrays of any other type are worked on by the interpreter.

    Args:
        trial_gap: Gap at the end if the point carried no traction, shape (n, 3), [m].
        compliance: c, normal and tangential, shape (n, 2) or (1, 2), [m/Pa].
        gap: Gap at the start, shape (n, 3), [m].
        stored: psi [J/m^2] and q [(J/m^2)^(1/2)] at the start, shape (n, 3).
        stiffness: Of the joint.
    """
    count, kind = len(trial_gap), trial_gap.dtype
    answer = StepAnswer(
        traction=np.zeros((count, 3), kind),
        tangent=np.zeros((count, 3, 3), kind),
        gap=np.empty((count, 3), kind),
        stored=np.empty((count, 3), kind),
        dissipation=np.empty(count, kind),
        status=np.zeros(count, np.int8),
    )
    march = _solve_step if kind == np.float64 else _solve_step.py_func
    march(
        trial_gap,
        compliance,
        gap,
        stored,
        stiffness.normal_compliance,
        stiffness.ratio,
        math.sqrt(stiffness.shear_compliance),
        stiffness.friction,
        answer.traction,
        answer.tangent,
        answer.gap,
        answer.stored,
        answer.dissipation,
        answer.status,
    )
    return answer


def stored_by(
    gap: Floats, elastic_slip: Floats, normal_stiffness: float, shear_stiffness: float
) -> Floats:
    """Stored psi and q of elastic points, shape (n, 3); see `solve_step`."""
    stored = np.empty((len(gap), 3), gap.dtype)
    overlap = np.minimum(gap[:, 0], 0.0)
    stored[:, 0] = 0.5 * normal_stiffness * overlap * overlap
    stored[:, 1:] = math.sqrt(shear_stiffness) * elastic_slip
    return stored


@njit(cache=True, error_model="numpy")
def _solve_step(
    trial_gap: Floats,
    compliance: Floats,
    gap: Floats,
    stored: Floats,
    d: float,
    kappa: float,
    zeta_closed: float,
    mu: float,
    traction: Floats,
    tangent: Floats,
    end_gap: Floats,
    end_stored: Floats,
    dissipation: Floats,
    status: NDArray[np.int8],
) -> None:
    """`solve_step` into arrays: d = 1/k_n, kappa = k_n/k_s, zeta_closed = sqrt(1/k_s)."""
    for i in range(len(trial_gap)):
        j = i if len(compliance) > 1 else 0
        c_n, c_t = compliance[j, 0], compliance[j, 1]
        h_n = trial_gap[i, 0] - gap[i, 0]
        h_1, h_2 = trial_gap[i, 1] - gap[i, 1], trial_gap[i, 2] - gap[i, 2]
        t_n, slope, end_gap[i, 0], end_energy, zeta, zeta_slope = _normal(
            h_n, c_n, gap[i, 0], stored[i, 0], d, kappa, zeta_closed
        )
        traction[i, 0], tangent[i, 0, 0] = t_n, slope
        q_1, q_2 = stored[i, 1], stored[i, 2]
        end_1, end_2, t_1, t_2 = q_1, q_2, 0.0 * q_1, 0.0 * q_2
        own, slides = zeta * zeta + 0.5 * c_t, False
        # A rigid point that nothing can move tangentially has no shear to be found.
        if np.isfinite(zeta) and t_n < 0.0 and own > 0.0:
            reach_1, reach_2 = zeta * q_1 + 0.5 * h_1, zeta * q_2 + 0.5 * h_2
            size, limit = np.hypot(reach_1, reach_2), -mu * t_n
            slides = size > limit * own or mu == 0.0
            # Derivatives of reach and own with respect to h_n come through zeta alone.
            drift_1, drift_2 = zeta_slope * q_1, zeta_slope * q_2
            if slides:
                safe = size if size > 0.0 else 1.0
                ratio = limit / safe
                along_1, along_2 = reach_1 / safe, reach_2 / safe
                along = along_1 * drift_1 + along_2 * drift_2
                growing = 0.0 * zeta
            else:
                ratio = 1.0 / own
                along_1, along_2, along = 0.0 * zeta, 0.0 * zeta, 0.0 * zeta
                growing = 2.0 * zeta * zeta_slope * ratio
            t_1, t_2 = ratio * reach_1, ratio * reach_2
            tangent[i, 1, 0] = (
                ratio * (drift_1 - along_1 * along) - growing * t_1 - mu * slope * along_1
            )
            tangent[i, 2, 0] = (
                ratio * (drift_2 - along_2 * along) - growing * t_2 - mu * slope * along_2
            )
            tangent[i, 1, 1] = 0.5 * ratio * (1.0 - along_1 * along_1)
            tangent[i, 2, 2] = 0.5 * ratio * (1.0 - along_2 * along_2)
            tangent[i, 1, 2] = tangent[i, 2, 1] = -0.5 * ratio * along_1 * along_2
            end_1, end_2 = 2.0 * zeta * t_1 - q_1, 2.0 * zeta * t_2 - q_2
        traction[i, 1], traction[i, 2] = t_1, t_2
        most = mu * np.sqrt(2.0 * kappa * end_energy)
        reached = np.hypot(end_1, end_2)
        if reached > most:
            end_1, end_2 = end_1 * (most / reached), end_2 * (most / reached)
        end_stored[i, 0], end_stored[i, 1], end_stored[i, 2] = end_energy, end_1, end_2
        end_gap[i, 1] = trial_gap[i, 1] - c_t * t_1
        end_gap[i, 2] = trial_gap[i, 2] - c_t * t_2
        gained = (end_1 * end_1 + end_2 * end_2) - (q_1 * q_1 + q_2 * q_2)
        dissipation[i] = t_1 * (h_1 - c_t * t_1) + t_2 * (h_2 - c_t * t_2) - 0.5 * gained
        if not end_gap[i, 0] > 0.0:
            status[i] = SLIP if slides else STICK


@register_jitable
def _normal(
    h: float, c: float, gap: float, energy: float, d: float, kappa: float, zeta_closed: float
) -> tuple[float, float, float, float, float, float]:
    """The normal part; of its four cases exactly one holds.

    Returns:
        Traction, its derivative, end gap, end energy, zeta = sqrt(1/k_s) / theta (infinite where
        the point carries nothing) and its derivative, the derivatives with respect to h.
    """
    nothing, ahead = 0.0 * c, gap + h
    if gap > 0.0:
        if ahead < 0.0:
            return _closes(c, gap, ahead, d, kappa)
        return nothing, nothing, ahead, nothing, np.inf, nothing
    pressure = np.sqrt(2.0 * energy / d) if d > 0.0 else nothing
    if ahead <= -0.5 * c * pressure and (d > 0.0 or energy == 0.0):
        lead = c + 2.0 * d
        if lead == 0.0:  # both sides of a rigid point are held
            return nothing, nothing, nothing, nothing, zeta_closed + nothing, nothing
        traction = (h - 2.0 * d * pressure) / lead
        after = max(-2.0 * traction - pressure, nothing)
        return traction, 1.0 / lead, -d * after, 0.5 * d * after**2, zeta_closed + nothing, nothing
    if energy > 0.0:
        root = np.sqrt(h * h + 4.0 * c * energy)
        y = 0.5 * (h + root) if h >= 0.0 else 2.0 * c * energy / (root - h)
        scale = np.sqrt(0.5 * kappa / energy)
        slope = energy / (y * y + c * energy)
        return -energy / y, slope, gap + y, nothing, y * scale, scale * y / root
    return nothing, nothing, ahead, nothing, np.inf, nothing


@register_jitable
def _closes(
    c: float, gap: float, ahead: float, d: float, kappa: float
) -> tuple[float, float, float, float, float, float]:
    """A point that closes: y = -g1 from (2d + c) y^2 + 2d (g0 + gh) y + 2d gh g0 = 0."""
    if d == 0.0:
        y, traction, slope = 0.0 * c, ahead / c, 1.0 / c
        energy = -traction * gap
    else:
        lead, half, last = c + 2.0 * d, d * (gap + ahead), 2.0 * d * ahead * gap
        root = np.sqrt(half * half - lead * last)
        y = -last / (half + root) if half > 0.0 else (root - half) / lead
        share = y / (y + gap)
        weight = share * (2.0 - share)
        energy = 0.5 * y * y / d
        traction = -energy / (y + gap)
        slope = weight / (2.0 * d + c * weight)
    way = y + gap
    zeta = np.sqrt(0.5 * kappa * way / -traction)
    zeta_slope = 0.5 * zeta * (slope / -traction - (1.0 - c * slope) / way)
    return traction, slope, -y, energy, zeta, zeta_slope
