# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction of steps in which the slip stops or turns, from the plastic slips of two steps before.

With p1 and p2 the plastic slips of the last step and of the one before it, m = p1/|p1| and
a = p1 - p2, the slip begins the step with the speed v = m . (p1 + a/2), in [m] a step, and would
stop after the part

    phi = v d / |a|^2,      d = -m . a,                                                    (17a)

of it if it were braked as before. Where 0 < phi < 1 the step may hold a stop or a turn: friction
along m against the plastic slip p of the step then is, with F = mu |t_n|,

    F above p = v/2, where the slip stops, (2 phi - 1) F below that,                       (17b)
    -F below p = 0 where phi >= 1/2, else below p = (2 phi - 1) |a|/2, a turn without loads,

and anything between where it changes. Otherwise, and where nothing slid before, it is F against p
(7). All depends continuously on p1 and p2. A turn with phi < 1/2 pushes along a slip of p > 0 and gives work back; never more than R, half the
work of friction in the step before: there friction is not below -R / p.
"""

from __future__ import annotations

import numpy as np
from numba.extending import register_jitable

from dolfinx_joints.laws.law import Floats
from dolfinx_joints.laws.return_mapping import Shear


@register_jitable
def turned(trial: Shear, limit: float, limit_slope: float, slips: Floats) -> tuple[Shear, bool]:
    """The trial traction with (17b) along m, and whether that differs; it has the limit to come.

    Args:
        trial: Trial traction of closed points, isotropic.
        limit: F [Pa].
        limit_slope: d F / d h_n [Pa/m].
        slips: p1, p2 [m] and R [J/m^2], shape (5,), see `JointState`.
    """
    size = np.sqrt(slips[0] * slips[0] + slips[1] * slips[1])
    if size == 0.0:
        return trial, False
    m_1, m_2 = slips[0] / size, slips[1] / size
    a_1, a_2, reserve = slips[0] - slips[2], slips[1] - slips[3], slips[4]
    braking = -(m_1 * a_1 + m_2 * a_2)
    speed, square = size - 0.5 * braking, a_1 * a_1 + a_2 * a_2
    if not (braking > 0.0 and speed > 0.0 and speed * braking < square):
        return trial, False
    mean = 2.0 * speed * braking / square - 1.0
    k, (t_1, t_2) = trial.by_shear[0], trial.traction
    along = t_1 * m_1 + t_2 * m_2
    stopping = along - 0.5 * k * speed
    lowest = mean * limit
    bound = max(lowest, -2.0 * reserve / speed)
    if stopping >= bound:
        return Shear(
            (t_1 + (stopping - along) * m_1, t_2 + (stopping - along) * m_2),
            trial.by_normal,
            trial.by_shear,
        ), True
    back = 0.5 * min(mean, 0.0) * np.sqrt(square)
    if along - k * back <= lowest:
        stopping = along - k * back
        return Shear(
            (t_1 + (stopping - along) * m_1, t_2 + (stopping - along) * m_2),
            trial.by_normal,
            trial.by_shear,
        ), back < 0.0
    kept, slope, part = lowest, mean * limit_slope, 0.0
    if mean < 0.0:
        root = np.sqrt(along * along + 4.0 * k * reserve)
        # -R / p where along is the trial traction of p.
        given = 0.5 * (along - root)
        if along > 0.0:
            given = -2.0 * k * reserve / (along + root)
        if given > lowest:
            kept, slope, part = given, 0.0, 0.5 * (1.0 - along / root) if root > 0.0 else 0.0
    less, k = along - kept, k * (1.0 - part)
    (n_1, n_2), (s_11, s_22, s_12, s_21) = trial.by_normal, trial.by_shear
    return Shear(
        (t_1 - less * m_1, t_2 - less * m_2),
        (n_1 + slope * m_1, n_2 + slope * m_2),
        (s_11 - k * m_1 * m_1, s_22 - k * m_2 * m_2, s_12 - k * m_1 * m_2, s_21 - k * m_1 * m_2),
    ), True
