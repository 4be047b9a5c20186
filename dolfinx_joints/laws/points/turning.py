# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction in steps in which the slip stops, turns or reverses, predicted from the last two slips.

Let p1 and p2 be the plastic slips of the last step and of the step before it, m = p1/|p1| and
dp = p1 - p2. The slip speed at the start of the step is v = m . (p1 + dp/2), in [m] per step. If
the slip velocity keeps changing by dp per step, its magnitude |v m + phi dp| is smallest after
the fraction

    phi = -v m . dp / |dp|^2                                                               (17a)

of the step; on a straight path the slip stops there. If 0 < phi < 1, the friction along m is
assumed to be F = mu |t_n| before phi and -F after it, with the mean T = (2 phi - 1) F. Let t be the
shear traction, p the plastic slip of the step, and p_T = min(T, 0) |dp| / (2 F) its predicted value
along m, or zero where the prediction is positive. Then

    t . m >= T:  t is parallel to p - v m / 2, with |t| <= F: the slip continues or stops,
    t . m <= T:  t is parallel to p - p_T m, with |t| <= F: the slip reverses,             (17b)
    t . m = T:   otherwise; normal to m, t is parallel to p, with |t| <= F: the slip turns.

Each case projects a trial traction onto a convex set, so the law is monotone. In all other steps t
is parallel to p (7). Both rules agree in the limit, since v and p_T vanish with p1 and p2. If phi <
1/2, friction returns work, because the slip of a step lags behind its impulse. This work is limited
to R, half the friction work of the last step: T >= -2 R / v.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dolfinx_joints.common.kernels import inline
from dolfinx_joints.laws.points.return_mapping import Shear, Vector, return_to_limit, yield_function

Slips = tuple[float, float, float, float, float]


class Limit(NamedTuple):
    """Friction limit of a point.

    Attributes:
        normal: t_n [Pa].
        stiffness: d t_n / d h_n [Pa/m].
        friction: mu.
    """

    normal: float
    stiffness: float
    friction: float


class Prediction(NamedTuple):
    """Prediction of the slip in a step.

    Attributes:
        along: m, direction of the last plastic slip.
        speed: v [m].
        mean: 2 phi - 1.
        reversed_slip: p_T [m].
    """

    along: Vector
    speed: float
    mean: float
    reversed_slip: float


@inline
def friction_with_turns(trial: Shear, limit: Limit, slips: Slips) -> tuple[Shear, bool]:
    """Return the shear traction of a closed point, and True if it slips.

    Args:
        trial: Trial traction; its derivative by the tangential gap is isotropic.
        limit: Limit of friction.
        slips: p1, p2 [m] and R [J/m^2], see `JointState`.
    """
    prediction = _predict(slips)
    if prediction.speed == 0.0:
        return _limit_shear(trial, limit)
    (m_1, m_2), size, slope = prediction.along, -limit.friction * limit.normal, 0.0
    lowest, reserve = prediction.mean * size, -2.0 * slips[4] / prediction.speed
    if lowest >= reserve:
        slope = -prediction.mean * limit.friction * limit.stiffness
    else:
        lowest = reserve
    forward, _ = _limit_shear(_trial_after(trial, prediction, 0.5 * prediction.speed), limit)
    if m_1 * forward.traction[0] + m_2 * forward.traction[1] >= lowest:
        return forward, True
    backward, slips_back = _limit_shear(
        _trial_after(trial, prediction, prediction.reversed_slip), limit
    )
    if m_1 * backward.traction[0] + m_2 * backward.traction[1] <= lowest:
        return backward, slips_back or prediction.reversed_slip < 0.0
    across = m_1 * trial.traction[1] - m_2 * trial.traction[0]
    largest, across_slope = np.sqrt(max(size * size - lowest * lowest, 0.0)), 0.0
    k = trial.by_shear[0]
    if abs(across) > largest:
        k, across = 0.0, largest if across > 0.0 else -largest
        change = -size * limit.friction * limit.stiffness - lowest * slope
        across_slope = change / across if largest > 0.0 else 0.0
    return Shear(
        (lowest * m_1 - across * m_2, lowest * m_2 + across * m_1),
        (slope * m_1 - across_slope * m_2, slope * m_2 + across_slope * m_1),
        (k * m_2 * m_2, k * m_1 * m_1, -k * m_1 * m_2),
    ), True


@inline
def _predict(slips: Slips) -> Prediction:
    """Return the prediction (17a); its speed is zero unless 0 < phi < 1."""
    no_turn = Prediction((0.0, 0.0), 0.0, 0.0, 0.0)
    size = np.sqrt(slips[0] * slips[0] + slips[1] * slips[1])
    if size == 0.0:
        return no_turn
    m_1, m_2 = slips[0] / size, slips[1] / size
    dp_1, dp_2 = slips[0] - slips[2], slips[1] - slips[3]
    braked, square = -(m_1 * dp_1 + m_2 * dp_2), dp_1 * dp_1 + dp_2 * dp_2
    speed = size - 0.5 * braked
    if not (speed > 0.0 and 0.0 < speed * braked < square):
        return no_turn
    mean = 2.0 * speed * braked / square - 1.0
    return Prediction((m_1, m_2), speed, mean, 0.5 * min(mean, 0.0) * np.sqrt(square))


@inline
def _limit_shear(trial: Shear, limit: Limit) -> tuple[Shear, bool]:
    """Return the trial traction, scaled back to the limit (7) if necessary, and True if scaled."""
    mu = limit.friction
    if yield_function(limit.normal, trial.traction, mu) > 0.0 or mu == 0.0:  # (5)
        return return_to_limit(trial, limit.normal, limit.stiffness, mu), True  # (17)
    return trial, False


@inline
def _trial_after(trial: Shear, prediction: Prediction, slip: float) -> Shear:
    """Return the trial traction after a slip along m; the stiffness is 1 / (2 zeta^2 + c)."""
    (t_1, t_2), (m_1, m_2), relief = trial.traction, prediction.along, trial.by_shear[0] * slip
    return Shear((t_1 - relief * m_1, t_2 - relief * m_2), trial.by_normal, trial.by_shear)
