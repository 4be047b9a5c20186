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
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


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
        tangent: d traction / d h, shape (n, 3, 3), [Pa/m].
        gap: Normal gap at the end, shape (n,), [m].
        energy: psi at the end, shape (n,), [J/m^2].
        slip_root: q at the end, shape (n, 2), [(J/m^2)^(1/2)].
        dissipation: Friction work of the step, shape (n,), [J/m^2].
        slides: Whether friction is at its limit, shape (n,).
    """

    traction: Floats
    tangent: Floats
    gap: Floats
    energy: Floats
    slip_root: Floats
    dissipation: Floats
    slides: Mask


@dataclass(frozen=True, kw_only=True)
class _Normal:
    """Normal part of a step: traction, its derivative, end gap and energy, and zeta.

    zeta = sqrt(1 / k_s) / theta, with its derivative; infinite where the point carries nothing.
    """

    traction: Floats
    slope: Floats
    gap: Floats
    energy: Floats
    zeta: Floats
    zeta_slope: Floats


def solve_step(
    free: Floats,
    compliance: Floats,
    gap: Floats,
    energy: Floats,
    slip_root: Floats,
    stiffness: Stiffness,
) -> StepAnswer:
    """Tractions of a step, each point on its own compliance, in closed form.

    Args:
        free: h, change of the gap (n, s1, s2) if the point carried no traction, shape (n, 3), [m].
        compliance: c, normal and tangential, shape (n, 2) or (1, 2), [m/Pa].
        gap: Normal gap at the start, shape (n,), [m].
        energy: psi at the start, shape (n,), [J/m^2].
        slip_root: q at the start, shape (n, 2), [(J/m^2)^(1/2)].
        stiffness: Of the joint.
    """
    c = np.broadcast_to(compliance, (len(free), 2))
    normal = _normal(free[:, 0], c[:, 0], gap, energy, stiffness)
    mu = stiffness.friction
    limit = -mu * normal.traction
    zeta = normal.zeta
    # A rigid point that nothing can move tangentially has no shear to be found.
    acts = np.isfinite(zeta) & (normal.traction < 0.0) & (zeta**2 + 0.5 * c[:, 1] > 0.0)
    zeta = np.where(acts, zeta, 1.0)
    own = zeta**2 + 0.5 * c[:, 1]
    reach = zeta[:, None] * slip_root + 0.5 * free[:, 1:]
    size = np.hypot(reach[:, 0], reach[:, 1])
    slides = acts & ((size > limit * own) | (mu == 0.0))
    safe = np.where(size > 0.0, size, 1.0)
    ratio = np.where(slides, limit / safe, np.where(acts, 1.0 / own, 0.0))
    shear = ratio[:, None] * reach
    # Derivatives of reach and own with respect to h_n come through zeta alone.
    drift = np.where(acts, normal.zeta_slope, 0.0)[:, None] * slip_root
    direction = np.where(slides[:, None], reach / safe[:, None], 0.0)
    turned = ratio[:, None] * (drift - direction * np.sum(direction * drift, axis=1)[:, None])
    growing = 2.0 * zeta * np.where(acts & ~slides, normal.zeta_slope, 0.0) * ratio
    tangent = np.zeros((len(free), 3, 3))
    tangent[:, 0, 0] = normal.slope
    tangent[:, 1:, 0] = turned - growing[:, None] * shear
    tangent[:, 1:, 0] -= mu * normal.slope[:, None] * direction
    tangent[:, 1, 1] = 0.5 * ratio * (1.0 - direction[:, 0] ** 2)
    tangent[:, 2, 2] = 0.5 * ratio * (1.0 - direction[:, 1] ** 2)
    tangent[:, 1, 2] = tangent[:, 2, 1] = -0.5 * ratio * direction[:, 0] * direction[:, 1]
    end = np.where(acts[:, None], 2.0 * zeta[:, None] * shear - slip_root, slip_root)
    most = mu * np.sqrt(2.0 * stiffness.ratio * normal.energy)
    reached = np.hypot(end[:, 0], end[:, 1])
    end = end * np.where(reached > most, most / np.where(reached > 0.0, reached, 1.0), 1.0)[:, None]
    slip = free[:, 1:] - c[:, 1:] * shear
    stored = 0.5 * (np.sum(end**2, axis=1) - np.sum(slip_root**2, axis=1))
    return StepAnswer(
        traction=np.column_stack([normal.traction, shear]),
        tangent=tangent,
        gap=normal.gap,
        energy=normal.energy,
        slip_root=end,
        dissipation=np.sum(shear * slip, axis=1) - stored,
        slides=slides,
    )


def _normal(h: Floats, c: Floats, gap: Floats, energy: Floats, stiffness: Stiffness) -> _Normal:
    """The normal part; of its four cases exactly one holds for each point."""
    d = stiffness.normal_compliance
    open_before = gap > 0.0
    ahead = gap + h
    pressure = np.sqrt(2.0 * energy / d) if d > 0.0 else np.zeros(len(h))
    stays = ~open_before & (ahead <= -0.5 * c * pressure) & ((d > 0.0) | (energy == 0.0))
    closes = open_before & (ahead < 0.0)
    opens = ~open_before & ~stays & (energy > 0.0)
    traction, slope, zeta_slope = np.zeros(len(h)), np.zeros(len(h)), np.zeros(len(h))
    zeta = np.full(len(h), math.inf)
    end_gap, end_energy = ahead.copy(), np.zeros(len(h))
    i = np.flatnonzero(stays)
    if len(i):
        lead = c[i] + 2.0 * d  # zero where both sides of a rigid point are held
        slope[i] = np.where(lead > 0.0, 1.0 / np.where(lead > 0.0, lead, 1.0), 0.0)
        traction[i] = (h[i] - 2.0 * d * pressure[i]) * slope[i]
        after = np.maximum(-2.0 * traction[i] - pressure[i], 0.0)
        end_gap[i], end_energy[i] = -d * after, 0.5 * d * after**2
        zeta[i] = math.sqrt(stiffness.shear_compliance)
    i = np.flatnonzero(opens)
    if len(i):
        root = np.sqrt(h[i] ** 2 + 4.0 * c[i] * energy[i])
        forward = h[i] >= 0.0
        y = np.where(
            forward,
            0.5 * (h[i] + root),
            2.0 * c[i] * energy[i] / np.where(forward, 1.0, root - h[i]),
        )
        traction[i] = -energy[i] / y
        slope[i] = energy[i] / (y**2 + c[i] * energy[i])
        end_gap[i] = gap[i] + y
        scale = np.sqrt(0.5 * stiffness.ratio / energy[i])
        zeta[i], zeta_slope[i] = y * scale, scale * y / root
    i = np.flatnonzero(closes)
    if len(i):
        _close(i, c[i], gap[i], ahead[i], stiffness, traction, slope, end_gap, end_energy)
        way = gap[i] - end_gap[i]
        zeta[i] = np.sqrt(0.5 * stiffness.ratio * way / -traction[i])
        zeta_slope[i] = 0.5 * zeta[i] * (slope[i] / -traction[i] - (1.0 - c[i] * slope[i]) / way)
    return _Normal(
        traction=traction,
        slope=slope,
        gap=end_gap,
        energy=end_energy,
        zeta=zeta,
        zeta_slope=zeta_slope,
    )


def _close(
    i: NDArray[np.int64],
    c: Floats,
    gap: Floats,
    ahead: Floats,
    stiffness: Stiffness,
    traction: Floats,
    slope: Floats,
    end_gap: Floats,
    end_energy: Floats,
) -> None:
    """Points that close in the step: y = -g1 from (2d + c) y^2 + 2d (g0 + gh) y + 2d gh g0 = 0."""
    d = stiffness.normal_compliance
    if d == 0.0:
        traction[i], slope[i], end_gap[i] = ahead / c, 1.0 / c, 0.0
        end_energy[i] = -traction[i] * gap
        return
    lead, half, last = c + 2.0 * d, d * (gap + ahead), 2.0 * d * ahead * gap
    root = np.sqrt(half**2 - lead * last)
    y = np.where(half > 0.0, -last / (half + root), (root - half) / lead)
    way = y + gap
    share = y / way
    weight = share * (2.0 - share)
    end_energy[i] = 0.5 * y**2 / d
    traction[i] = -end_energy[i] / way
    slope[i] = weight / (2.0 * d + c * weight)
    end_gap[i] = -y
