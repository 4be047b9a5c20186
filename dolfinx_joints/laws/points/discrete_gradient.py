# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Discrete gradient of no-tension friction: tractions that balance the energy over a whole step.

The normal gap changes from g0 to g1 at a constant rate. With the elastic energy psi of normal
contact, t_n = (psi1 - psi0) / (g1 - g0). The joint is in contact during the fraction theta of the
step and carries the shear traction s meanwhile; the mean over the step is t_s. With the elastic
slip e and the change Dg_s of the tangential gap:

    t_n = k_n theta (a + b) / 2,           a = min(g0, 0), b = min(g1, 0),                 (15)
    s   = k_s (e0 + theta Dg_s / 2),       scaled back to |s| <= mu |t_n| / theta,   t_s = theta s,
    z   = 2 s / k_s - e0,                  e1 = z scaled back to |e1| <= mu k_n |b| / k_s. (16)

If decelerating slip may stop, turn or reverse within the step, `turning` computes t_s instead.
The work t . Dg equals the change of the elastic energy plus the loss D below (16), to rounding. D
is friction work; rigid points without rebound (15a) also lose t_n Dg_n in impacts.

The equation of a point is Dg = h - c t with its own compliance c and the gap change h without its
own traction. The state of closed points is psi = k_n g^2 / 2 [J/m^2] and q = sqrt(k_s) e
[(J/m^2)^(1/2)]; both are finite in rigid joints. docs/theory/time_schemes.md has the equations.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dolfinx_joints.common.kernels import inline
from dolfinx_joints.laws.law import Floats, JointState
from dolfinx_joints.laws.points.return_mapping import (
    Answer,
    Coulomb,
    Shear,
    Start,
    Vector,
    closed_status,
    law_of,
    put_traction,
    put_zeros,
)
from dolfinx_joints.laws.points.turning import Limit, friction_with_turns

# A rigid point does not rebound if its stored energy divided by h^2 / c is below this value.
NO_BOUNCE = 1e-30

# A pressed point without rebound is at rest if |dt v0 / 2| / |h| is below this rounding error.
AT_REST = 1e-9


class Normal(NamedTuple):
    """Normal response of a point.

    Attributes:
        traction: t_n [Pa].
        stiffness: d t_n / d h_n [Pa/m].
        gap: g1 [m].
        energy: psi1 [J/m^2].
        zeta: sqrt(1/k_s) / theta, infinite without traction.
        zeta_slope: d zeta / d h_n.
    """

    traction: float
    stiffness: float
    gap: float
    energy: float
    zeta: float
    zeta_slope: float


@inline
def normal_traction(h: float, c: float, gap: float, energy: float, law: Coulomb) -> Normal:
    """Return t_n (15) on the own compliance c; one of the four cases of the page applies."""
    d, free_gap = law.normal_compliance, gap + h
    if gap > 0.0:
        if free_gap < 0.0:
            return _closes(c, gap, free_gap, law)
        return Normal(0.0, 0.0, free_gap, 0.0, np.inf, 0.0)  # stays open
    pressure = np.sqrt(2.0 * energy / d) if d > 0.0 else 0.0
    # Without NO_BOUNCE a rigid point would rebound with ever smaller energies, down to underflow.
    if free_gap <= -0.5 * c * pressure and (d > 0.0 or c * energy <= NO_BOUNCE * h * h):
        return _stays_closed(h, c, pressure, law)
    if energy > 0.0:
        return _opens(h, c, gap, energy, law)
    return Normal(0.0, 0.0, free_gap, 0.0, np.inf, 0.0)


@inline
def _stops(h: float, c: float, gap: float, approach: float, pressed: bool) -> Normal:
    """Return t_n of a rigid point without rebound (15a), zero if it is not stopped.

    Whether the point may be stopped depends only on the state at the start, so t_n is unique.

    Args:
        h: Gap change without the point's own traction [m].
        c: Own normal compliance [m/Pa].
        gap: g0 [m].
        approach: dt v0 [m].
        pressed: True if the point was under pressure in the last step; v0 is then rounding error.
    """
    stopped = 0.5 * approach
    touches = pressed or (approach <= 0.0 and gap + stopped <= 0.0)
    if not touches or h >= stopped or c == 0.0:
        return Normal(0.0, 0.0, gap + h, 0.0, np.inf, 0.0)
    # At rest keep the gap as it is: rounding error would count as an opening.
    rests = pressed and abs(stopped) <= AT_REST * abs(h)
    end = gap if rests else gap + stopped
    return Normal((h - stopped) / c, 1.0 / c, end, 0.0, 0.0, 0.0)


@inline
def _stays_closed(h: float, c: float, pressure: float, law: Coulomb) -> Normal:
    """Return t_n = (h - 2 d p0) / (c + 2 d), theta = 1, with the pressure p0 at the start."""
    d, zeta = law.normal_compliance, np.sqrt(law.shear_compliance)
    total = c + 2.0 * d
    if total == 0.0:  # both sides of a rigid point are constrained
        return Normal(0.0, 0.0, 0.0, 0.0, zeta, 0.0)
    traction = (h - 2.0 * d * pressure) / total
    p_1 = max(-2.0 * traction - pressure, 0.0)  # pressure at the end
    return Normal(traction, 1.0 / total, -d * p_1, 0.5 * d * p_1**2, zeta, 0.0)


@inline
def _opens(h: float, c: float, gap: float, energy: float, law: Coulomb) -> Normal:
    """Return t_n = -psi0 / Dg with Dg = g1 - g0 = (h + sqrt(h^2 + 4 c psi0)) / 2."""
    root = np.sqrt(h * h + 4.0 * c * energy)
    dg = 0.5 * (h + root) if h >= 0.0 else 2.0 * c * energy / (root - h)
    scale = np.sqrt(0.5 * law.ratio / energy)
    stiffness = energy / (dg * dg + c * energy)
    return Normal(-energy / dg, stiffness, gap + dg, 0.0, dg * scale, scale * dg / root)


@inline
def _closes(c: float, gap: float, free_gap: float, law: Coulomb) -> Normal:
    """Solve (2d + c) y^2 + 2d (g0 + gf) y + 2d gf g0 = 0, y = -g1, with the free gap gf (15)."""
    d = law.normal_compliance
    if c + d == 0.0:  # both sides of a rigid point are constrained
        return Normal(0.0, 0.0, 0.0, 0.0, np.inf, 0.0)
    if d == 0.0:
        y, traction, stiffness = 0.0, free_gap / c, 1.0 / c
        energy = -traction * gap
    else:
        total, half, constant = c + 2.0 * d, d * (gap + free_gap), 2.0 * d * free_gap * gap
        root = np.sqrt(half * half - total * constant)
        y = -constant / (half + root) if half > 0.0 else (root - half) / total
        theta = y / (y + gap)
        weight = theta * (2.0 - theta)
        energy = 0.5 * y * y / d
        traction = -energy / (y + gap)
        stiffness = weight / (2.0 * d + c * weight)
    approach = y + gap
    zeta = np.sqrt(0.5 * law.ratio * approach / -traction)
    zeta_slope = 0.5 * zeta * (stiffness / -traction - (1.0 - c * stiffness) / approach)
    return Normal(traction, stiffness, -y, energy, zeta, zeta_slope)


@inline
def trial_traction(normal: Normal, q: Vector, h: Vector, c_s: float) -> Shear:
    """Return t_tr = (zeta q0 + h_s / 2) / (zeta^2 + c_s / 2), q0 = sqrt(k_s) e0, see (17)."""
    zeta, slope = normal.zeta, normal.zeta_slope
    k = 1.0 / (zeta * zeta + 0.5 * c_s)
    t_1, t_2 = k * (zeta * q[0] + 0.5 * h[0]), k * (zeta * q[1] + 0.5 * h[1])
    # The traction depends on h_n only through zeta.
    by_normal = k * slope * (q[0] - 2.0 * zeta * t_1), k * slope * (q[1] - 2.0 * zeta * t_2)
    return Shear((t_1, t_2), by_normal, (0.5 * k, 0.5 * k, 0.0))


@inline
def discrete_gradient_on(i: int, c_n: float, c_s: float, start: Start, answer: Answer) -> None:
    """Compute the response over a whole step; on entry ``answer.gap`` is the trial gap."""
    friction_over_step(i, (c_n, c_s), law_of(start.parameters), start, answer)


@inline
def friction_over_step(i: int, own: Vector, law: Coulomb, start: Start, answer: Answer) -> None:
    """Compute the response over a whole step of a point with its own compliance and law."""
    traction, tangent, end_gap, end_stored, dissipation, status = answer
    gap, stored, trial_gap = start.gap, start.history, answer.gap
    put_zeros(i, answer)
    (c_n, c_s), mu = own, law.friction
    h_1, h_2 = trial_gap[i, 1] - gap[i, 1], trial_gap[i, 2] - gap[i, 2]
    q_1, q_2 = stored[i, 1], stored[i, 2]
    h_n, g_n = trial_gap[i, 0] - gap[i, 0], gap[i, 0]
    if law.rebounds:
        normal = normal_traction(h_n, c_n, g_n, stored[i, 0], law)
        closed = not normal.gap > 0.0
        stays = closed and g_n <= 0.0
    else:
        normal = _stops(h_n, c_n, g_n, stored[i, 8], stored[i, 9] > 0.0)
        # The gap stays as it was at the impact, perhaps not zero: t_n < 0 marks a closed point.
        closed = normal.traction < 0.0
        stays = closed and stored[i, 9] > 0.0
        end_stored[i, 9] = 1.0 if closed else 0.0
    t_n, slides, lost = normal.traction, False, 0.0
    shear, end_1, end_2 = Shear((0.0, 0.0), (0.0, 0.0), (0.0, 0.0, 0.0)), q_1, q_2
    # The shear traction of a rigid point without tangential compliance is undetermined.
    if normal.zeta < np.inf and t_n < 0.0 and normal.zeta + c_s > 0.0:
        trial = trial_traction(normal, (q_1, q_2), (h_1, h_2), c_s)  # (17)
        row = stored[i]
        last_slips = (
            (row[3], row[4], row[5], row[6], row[7]) if stays else (0.0, 0.0, 0.0, 0.0, 0.0)
        )
        shear, slides = friction_with_turns(trial, Limit(t_n, normal.stiffness, mu), last_slips)
        if slides:
            (trial_1, trial_2), (t_1, t_2) = trial.traction, shear.traction
            k = 2.0 * normal.zeta * normal.zeta + c_s
            slip_1, slip_2 = k * (trial_1 - t_1), k * (trial_2 - t_2)
            lost = t_1 * slip_1 + t_2 * slip_2  # first part of D, see (16)
            if stays:
                end_stored[i, 3], end_stored[i, 4] = slip_1, slip_2
                end_stored[i, 7] = max(0.5 * lost, 0.0)
        if stays:
            end_stored[i, 5], end_stored[i, 6] = stored[i, 3], stored[i, 4]
        end_1 = 2.0 * normal.zeta * shear.traction[0] - q_1  # z of (16)
        end_2 = 2.0 * normal.zeta * shear.traction[1] - q_2
    put_traction(i, t_n, normal.stiffness, shear, traction, tangent)
    limit = mu * np.sqrt(2.0 * law.ratio * normal.energy)
    size = np.sqrt(end_1 * end_1 + end_2 * end_2)
    if size > limit:  # e1 of (16)
        end_1, end_2 = end_1 * (limit / size), end_2 * (limit / size)
        lost += 0.5 * (size - limit) * (size + limit)  # second part of D
    end_stored[i, 0] = normal.energy
    end_stored[i, 1], end_stored[i, 2] = end_1, end_2
    t_1, t_2 = shear.traction
    end_gap[i, 0] = normal.gap
    end_gap[i, 1] -= c_s * t_1
    end_gap[i, 2] -= c_s * t_2
    dissipation[i] = lost
    if closed:
        status[i] = closed_status(slides, law)


def whole_step_from(
    state: JointState, stored: Floats | None, law: Coulomb, approach: Floats | None = None
) -> Start:
    """Return the state at the start of a step, as `discrete_gradient_on` reads it.

    Args:
        state: State at the start of the step.
        stored: psi [J/m^2] and q [(J/m^2)^(1/2)] at the start, shape (n, 3); None for zeros.
        law: Parameters of the joint.
        approach: dt v0 [m] and pressed (0 or 1) of points without rebound, shape (n, 2).

    Returns:
        The start; ``history`` is psi, q, the slips of `JointState` and ``approach``, (n, 10).
    """
    history = np.zeros((len(state.gap), 10), state.gap.dtype)
    if stored is not None:
        history[:, :3] = stored
    if len(state.slips):
        history[:, 3:8] = state.slips
    if approach is not None:
        history[:, 8:] = approach
    return Start(state.gap, history, np.array(law))


def stored_by(state: JointState, normal_stiffness: float, shear_stiffness: float) -> Floats:
    """Return psi and q of elastic points, shape (n, 3); see `whole_step_from`."""
    stored = np.empty_like(state.gap)
    overlap = np.minimum(state.gap[:, 0], 0.0)
    stored[:, 0] = 0.5 * normal_stiffness * overlap * overlap
    stored[:, 1:] = np.sqrt(shear_stiffness) * state.elastic_slip
    return stored
