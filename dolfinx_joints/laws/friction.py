# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Coulomb friction without tension, the law of the paper: functions of one point, and the law.

This module contains the backward Euler rule (traction at the end of a step). The rule over a whole
step is in `discrete_gradient`. Numbers in brackets are equation numbers of docs/theory.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import annotated_types as at
import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.kernels import inline
from dolfinx_joints.laws.law import (
    BACKWARD_EULER,
    DISCRETE_GRADIENT,
    Floats,
    JointState,
    Losses,
    Response,
    Rule,
)
from dolfinx_joints.laws.losses import friction_gap_change, losses_on, overlap_and_slip
from dolfinx_joints.laws.points.compiled_law import EnergyConsistentContact
from dolfinx_joints.laws.points.discrete_gradient import (
    discrete_gradient_on,
    stored_by,
    whole_step_from,
)
from dolfinx_joints.laws.points.return_mapping import (
    Answer,
    Coulomb,
    Shear,
    Start,
    Vector,
    at_gap,
    closed_form_loop,
    closed_status,
    law_of,
    put_traction,
    put_zeros,
    response_of,
    return_to_limit,
    yield_function,
)


def set_friction(law: Any) -> tuple[float, float]:
    """Return friction coefficient and angle [degrees] of a law; set the parameter that is missing.

    Both parameters may be given if they agree, because ``dataclasses.replace`` passes both.

    Raises:
        ValueError: Both are missing, or they contradict each other.
    """
    angle, mu, name = law.friction_angle_deg, law.friction_coefficient, type(law).__name__
    if angle is None and mu is None:
        raise ValueError(
            f"{name}: friction_angle_deg and friction_coefficient are both None; give one of them."
        )
    if angle is None:
        angle = math.degrees(math.atan(mu))
        object.__setattr__(law, "friction_angle_deg", angle)
    if mu is None:
        mu = math.tan(math.radians(angle))
        object.__setattr__(law, "friction_coefficient", mu)
    if not math.isclose(angle, math.degrees(math.atan(mu)), rel_tol=1e-9):
        raise ValueError(
            f"{name}: friction_angle_deg is {angle:g} degrees and friction_coefficient is {mu:g}; "
            "give one of them, and None for the other."
        )
    return mu, angle


def coefficient_of(law: Any) -> float:
    """Return the friction coefficient of a law after `set_friction`."""
    return law.friction_coefficient


def cosine_and_sine(angle_deg: float) -> tuple[float, float]:
    """Return cosine and sine of an angle in [0, 90] degrees, with cos(90) exactly zero."""
    angle = math.radians(angle_deg)
    return (0.0, 1.0) if angle_deg == 90.0 else (math.cos(angle), math.sin(angle))


@inline
def normal_traction(h_n: float, c_n: float, law: Coulomb) -> Vector:
    """Return t_n = h_n / (c_n + d_n) of a closed point, (4) and (21), and d t_n / d h_n."""
    total = c_n + law.normal_compliance
    stiffness = 1.0 / total if total > 0.0 else 0.0  # zero: rigid, both sides constrained
    return stiffness * h_n, stiffness


@inline
def trial_traction(
    slip: Vector, opening: float, t_n: float, stiffness: float, c_s: float, law: Coulomb
) -> Shear:
    """Return the trial traction t_tr = (e0 + h_s - g_s0) / (c_s + d_s / theta), see (6), (8), (21).

    Args:
        slip: Elastic slip at the start plus trial slip of the step, e0 + h_s - g_s0, [m].
        opening: Normal gap at the start, zero if closed, [m].
        t_n: Normal traction [Pa].
        stiffness: d t_n / d h_n [Pa/m].
        c_s: Tangential compliance of the structure [m/Pa].
        law: Parameters of the joint.
    """
    d_n, d_s, kappa = law.normal_compliance, law.shear_compliance, law.ratio
    k, k_slope = 0.0, 0.0
    if opening > 0.0 and d_s < np.inf:  # d_s / theta = kappa (g_n0 + d_n |t_n|) / |t_n|
        scaled = 1.0 / (kappa * (opening - d_n * t_n) - c_s * t_n)
        k = -t_n * scaled
        k_slope = -kappa * opening * scaled * scaled * stiffness
    elif d_s < np.inf and c_s + d_s > 0.0:
        k = 1.0 / (c_s + d_s)
    return Shear((k * slip[0], k * slip[1]), (k_slope * slip[0], k_slope * slip[1]), (k, k, 0.0))


@inline
def friction_work(before: Vector, t_s: Vector, plastic: Vector, d_s: float) -> float:
    """Return mean shear traction times plastic slip [J/m^2]; in rigid joints the end traction.

    Args:
        before: Elastic slip at the start [m].
        t_s: Shear traction at the end [Pa].
        plastic: Plastic slip in contact [m].
        d_s: Shear compliance of the joint [m/Pa].
    """
    (m_1, m_2), (p_1, p_2) = t_s, plastic
    if d_s > 0.0:
        m_1, m_2 = 0.5 * (m_1 + before[0] / d_s), 0.5 * (m_2 + before[1] / d_s)
    return m_1 * p_1 + m_2 * p_2


@inline
def backward_euler_on(i: int, c_n: float, c_s: float, start: Start, answer: Answer) -> None:
    """Compute the response at the end of a step; on entry ``answer.gap`` is the trial gap."""
    friction_at_end(i, (c_n, c_s), law_of(start.parameters), start, answer)


@inline
def friction_at_end(i: int, own: Vector, law: Coulomb, start: Start, answer: Answer) -> None:
    """Compute the response at the end of a step of a point with its own compliance and law."""
    put_zeros(i, answer)
    (c_n, c_s), gap, end = own, start.gap[i], answer.gap[i]
    d_n, d_s, mu = law.normal_compliance, law.shear_compliance, law.friction
    h_n, opening = end[0], max(gap[0], 0.0)
    e_1, e_2 = start.history[i, 0], start.history[i, 1]
    slip_1, slip_2 = end[1] - gap[1], end[2] - gap[2]
    if h_n > 0.0:
        # Open: t = 0. All slip becomes plastic; slip while the point is open has no friction work.
        theta = 0.0 if opening > 0.0 else 1.0
        plastic = (theta * slip_1 + e_1, theta * slip_2 + e_2)
        answer.dissipation[i] = friction_work((e_1, e_2), (0.0, 0.0), plastic, d_s)
        return
    t_n, stiffness = normal_traction(h_n, c_n, law)  # (4)
    shear = trial_traction(  # (6), (8)
        (e_1 + slip_1, e_2 + slip_2), opening, t_n, stiffness, c_s, law
    )
    slides = yield_function(t_n, shear.traction, mu) > 0.0  # (5)
    if slides:
        shear = return_to_limit(shear, t_n, stiffness, mu)  # (7), (10)
    answer.status[i] = closed_status(slides, law)
    put_traction(i, t_n, stiffness, shear, answer.traction, answer.tangent)
    t_1, t_2 = shear.traction
    if c_n > 0.0:  # in a stiff joint the traction gives a more accurate overlap than h - c t
        end[0] = d_n * t_n
    end[1] -= c_s * t_1
    end[2] -= c_s * t_2
    elastic = answer.history[i]
    if d_s < np.inf:
        elastic[0], elastic[1] = d_s * t_1, d_s * t_2  # end of (7)
    theta = d_n * t_n / (d_n * t_n - opening) if opening > 0.0 else 1.0  # (8)
    plastic = (
        theta * (end[1] - gap[1]) - (elastic[0] - e_1),
        theta * (end[2] - gap[2]) - (elastic[1] - e_2),
    )
    answer.dissipation[i] = friction_work((e_1, e_2), (t_1, t_2), plastic, d_s)


_ON_COMPLIANCE = {
    BACKWARD_EULER.name: backward_euler_on,
    DISCRETE_GRADIENT.name: discrete_gradient_on,
}
LOOPS = {name: closed_form_loop(point) for name, point in _ON_COMPLIANCE.items()}
POINTS = {name: at_gap(point) for name, point in _ON_COMPLIANCE.items()}


@dataclass(frozen=True, kw_only=True)
@checked
class FrictionNoTension(EnergyConsistentContact):
    """No tension, elastic contact, Coulomb friction without dilatancy (paper eqs. 3 to 5).

    Open (gap_n > 0): t = 0. Closed: t_n = k_n gap_n, t_s = k_s e with |t_s| <= -t_n tan(alpha). The
    flow rule is not associated (plastic potential |t_s|), so the tangent is unsymmetric. On opening
    the elastic slip e becomes zero and all slip is plastic. If a point closes within a step, only
    the slip after closing causes shear. On a straight path this is the fraction
    gap_n1 / (gap_n1 - gap_n0) of the slip increment.

    Departure from the paper: compression is negative here, so the paper's yield function
    |t_s| - t_n tan(alpha) becomes |t_s| + t_n tan(alpha).

    Attributes:
        normal_stiffness: k_n.
        shear_stiffness: k_s; zero makes the joint frictionless.
        friction_angle_deg: alpha; give either this or `friction_coefficient`.
        friction_coefficient: Mu = tan(alpha).

    Raises:
        ValueError: Angle and coefficient are both given, or both missing.

    Example:
        >>> import numpy as np
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.laws.law import JointState
        >>> law = dj.FrictionNoTension(
        ...     normal_stiffness=1e9, shear_stiffness=1e9, friction_angle_deg=45.0
        ... )
        >>> gap = np.array([[-0.001, 0.004, 0.0]])  # overlap 1 mm, tangential 4 mm [m]
        >>> law.backward_euler(gap, JointState.at_rest(np.zeros((1, 3)))).traction.round()  # [Pa]
        array([[-1000000.,  1000000.,        0.]])
    """

    loops: ClassVar[Mapping[str, Any]] = LOOPS
    points: ClassVar[Mapping[str, Any]] = POINTS

    normal_stiffness: Annotated[float, at.Gt(0), at.Unit("Pa/m")]
    shear_stiffness: Annotated[float, at.Ge(0), at.Unit("Pa/m")]
    friction_angle_deg: Annotated[float, at.Ge(0), at.Lt(90), at.Unit("degrees")] | None = None
    friction_coefficient: Annotated[float, at.Ge(0)] | None = None

    def __post_init__(self) -> None:
        set_friction(self)

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Return the losses (30) of a backward Euler step; see `LawWithLosses`."""
        k = np.array([self.normal_stiffness, self.shear_stiffness, self.shear_stiffness])
        mean = 0.5 * k * (overlap_and_slip(before) + overlap_and_slip(answer.state))
        change = friction_gap_change(before, answer.state)
        return losses_on(change, traction, mean, answer.dissipation)

    def loop_start(self, rule: Rule, state: JointState) -> Start:
        """Return elastic slip, or stored energies and slips for a whole step, and parameters."""
        k_n, k_s, mu = self.normal_stiffness, self.shear_stiffness, coefficient_of(self)
        if rule.name == BACKWARD_EULER.name:
            shear = (1.0 / k_s, k_n / k_s) if k_s else (math.inf, math.inf)
            law = Coulomb(1.0 / k_n, *shear, mu)
            return Start(state.gap, state.elastic_slip, np.array(law))
        stored = stored_by(state, k_n, k_s)
        # Without shear stiffness no shear traction builds up: treat the joint as frictionless.
        law = Coulomb(1.0 / k_n, 1.0 / (k_s or k_n), k_n / (k_s or k_n), mu if k_s else 0.0)
        return whole_step_from(state, stored, law)

    def loop_response(self, rule: Rule, answer: Answer, state: JointState) -> Response:
        """Return the response with elastic slip and, over a whole step, the plastic slips."""
        if rule.name == BACKWARD_EULER.name:
            return response_of(answer, elastic_slip=answer.history)
        root = np.sqrt(self.shear_stiffness) or 1.0
        return response_of(
            answer, elastic_slip=answer.history[:, 1:3] / root, slips=answer.history[:, 3:8]
        )


@checked
def frictionless(
    *, normal_stiffness: Annotated[float, at.Gt(0), at.Unit("Pa/m")]
) -> FrictionNoTension:
    """Return a law that transmits only pressure: no tension, no shear.

    Args:
        normal_stiffness: k_n.

    Example:
        >>> import numpy as np
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.laws.law import JointState
        >>> law = dj.frictionless(normal_stiffness=1e9)
        >>> gap = np.array([[-0.001, 0.004, 0.0]])  # overlap 1 mm, tangential 4 mm [m]
        >>> law.backward_euler(gap, JointState.at_rest(np.zeros((1, 3)))).traction.round()  # [Pa]
        array([[-1000000.,        0.,        0.]])
    """
    return FrictionNoTension(
        normal_stiffness=normal_stiffness, shear_stiffness=0.0, friction_angle_deg=0.0
    )
