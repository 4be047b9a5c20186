# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction of steps in which the slip stops or turns, from the plastic slips of two steps before.

With p1 and p2 the plastic slips of the last step and of the one before it, m = p1/|p1| and
dp = p1 - p2, the slip begins the step with the speed v = m . (p1 + dp/2), in [m] a step. Braked as
before it would stop after the part

    phi = -v m . dp / |dp|^2                                                               (17a)

of the step. Where 0 < phi < 1 it may stop or turn. Friction turns when the slip does: the mean of
its component along m then is T = (2 phi - 1) F, F = mu |t_n|. With p the plastic slip of the step
and p_T = min(T, 0) |dp| / (2 F) its component if a turn changed nothing else,

    t . m >= T:  t is along p - v m / 2 and within |t| <= F: the slip goes on, or stops,
    t . m <= T:  t is along p - p_T m and within |t| <= F: it goes back,                   (17b)
    t . m = T:   between these; across m along p, within |t| <= F: it turns.

Each is the closest point of a convex set to a trial traction, so that the law is monotone. In all
other steps t is along p (7); the two join, as v and p_T vanish with p1 and p2.

The slip of a step is behind its impulse. A slip that turns early (phi < 1/2) gives work back, never
more than R, half the work of friction in the last step: T is not below -2 R / v.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dolfinx_joints.common.kernels import inline
from dolfinx_joints.laws.points.return_mapping import Shear, Vector, return_to_limit, yield_function

Slips = tuple[float, float, float, float, float]


class Limit(NamedTuple):
    """Limit of friction of a point.

    Attributes:
        normal: t_n [Pa].
        stiffness: d t_n / d h_n [Pa/m].
        friction: mu.
    """

    normal: float
    stiffness: float
    friction: float


class Course(NamedTuple):
    """What is foreseen of the slip of a step.

    Attributes:
        along: m.
        speed: v [m].
        mean: 2 phi - 1.
        back: p_T [m].
    """

    along: Vector
    speed: float
    mean: float
    back: float


@inline
def friction_with_turns(trial: Shear, limit: Limit, slips: Slips) -> tuple[Shear, bool]:
    """Shear traction of a closed point, and whether it slips.

    Args:
        trial: Trial traction, isotropic by the tangential gap.
        limit: Limit of friction.
        slips: p1, p2 [m] and R [J/m^2], see `JointState`.
    """
    course = _course(slips)
    if course.speed == 0.0:
        return _within(trial, limit)
    (m_1, m_2), size, slope = course.along, -limit.friction * limit.normal, 0.0
    lowest, reserve = course.mean * size, -2.0 * slips[4] / course.speed
    if lowest >= reserve:
        slope = -course.mean * limit.friction * limit.stiffness
    else:
        lowest = reserve
    ahead, _ = _within(_moved(trial, course, 0.5 * course.speed), limit)
    if m_1 * ahead.traction[0] + m_2 * ahead.traction[1] >= lowest:
        return ahead, True
    back, slips_back = _within(_moved(trial, course, course.back), limit)
    if m_1 * back.traction[0] + m_2 * back.traction[1] <= lowest:
        return back, slips_back or course.back < 0.0
    across = m_1 * trial.traction[1] - m_2 * trial.traction[0]
    most, across_slope = np.sqrt(max(size * size - lowest * lowest, 0.0)), 0.0
    k = trial.by_shear[0]
    if abs(across) > most:
        k, across = 0.0, np.copysign(most, across)
        change = -size * limit.friction * limit.stiffness - lowest * slope
        across_slope = change / across if most > 0.0 else 0.0
    return Shear(
        (lowest * m_1 - across * m_2, lowest * m_2 + across * m_1),
        (slope * m_1 - across_slope * m_2, slope * m_2 + across_slope * m_1),
        (k * m_2 * m_2, k * m_1 * m_1, -k * m_1 * m_2),
    ), True


@inline
def _course(slips: Slips) -> Course:
    """(17a); without speed where no stop and no turn is foreseen."""
    nothing = Course((0.0, 0.0), 0.0, 0.0, 0.0)
    size = np.sqrt(slips[0] * slips[0] + slips[1] * slips[1])
    if size == 0.0:
        return nothing
    m_1, m_2 = slips[0] / size, slips[1] / size
    dp_1, dp_2 = slips[0] - slips[2], slips[1] - slips[3]
    braked, square = -(m_1 * dp_1 + m_2 * dp_2), dp_1 * dp_1 + dp_2 * dp_2
    speed = size - 0.5 * braked
    if not (speed > 0.0 and 0.0 < speed * braked < square):
        return nothing
    mean = 2.0 * speed * braked / square - 1.0
    return Course((m_1, m_2), speed, mean, 0.5 * min(mean, 0.0) * np.sqrt(square))


@inline
def _within(trial: Shear, limit: Limit) -> tuple[Shear, bool]:
    """The trial traction, or that on the limit (7), and whether it is that."""
    mu = limit.friction
    if yield_function(limit.normal, trial.traction, mu) > 0.0 or mu == 0.0:  # (5)
        return return_to_limit(trial, limit.normal, limit.stiffness, mu), True  # (17)
    return trial, False


@inline
def _moved(trial: Shear, course: Course, slip: float) -> Shear:
    """The trial traction that a slip along m leaves; 1 / (2 zeta^2 + c) is its stiffness."""
    (t_1, t_2), (m_1, m_2), less = trial.traction, course.along, trial.by_shear[0] * slip
    return Shear((t_1 - less * m_1, t_2 - less * m_2), trial.by_normal, trial.by_shear)
