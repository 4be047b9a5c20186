# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Coulomb's limit and the return onto it, of one point: what all rules of friction share.

Plain functions of numbers in the order of the theory (docs/theory), numbers of its equations beside
the lines; loops over points, compiled by numba, take them as they stand. `friction` has the loop
for the end of a step, `discrete_gradient` that for a whole one, each with a `normal_traction` and a
`trial_traction`; `points.on_compliance` is for laws that have no closed form there.

A point sits on the compliance c of the structure, gap = trial_gap - c t; c = 0 gives the law by
itself. In tractions the law's own compliances d = 1/k add to c, so that a rigid joint (d = 0) is a
case like any other.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.kernels import inline, njit
from dolfinx_joints.laws.law import (
    BORNE,
    HELD,
    INTACT,
    LARGEST_OVERLOAD,
    Floats,
    JointState,
    Response,
)

Vector = tuple[float, float]

# Values of `Status`.
STICK, SLIP, FRICTIONLESS = 1, 2, 3


class Coulomb(NamedTuple):
    """Parameters of the points of one law.

    Attributes:
        normal_compliance: d_n = 1 / k_n [m/Pa], zero if rigid.
        shear_compliance: d_s = 1 / k_s [m/Pa], zero if rigid, infinite without shear stiffness.
        ratio: kappa = k_n / k_s.
        friction: mu.
        rebounds: Whether a rigid point gives back what it brings into contact.
    """

    normal_compliance: float
    shear_compliance: float
    ratio: float
    friction: float
    rebounds: bool = True


class Start(NamedTuple):
    """What a loop is told of the start of a step of ``n`` points.

    Attributes:
        gap: Gap, shape (n, 3), [m].
        history: What else the points know, shape (n, m).
        parameters: Those of the law, as those of a `Coulomb`, shape (k,).
    """

    gap: Floats
    history: Floats
    parameters: Floats


class Shear(NamedTuple):
    """Shear traction of a point with its derivatives by the trial gap h.

    Attributes:
        traction: t_s [Pa].
        by_normal: d t_s / d h_n [Pa/m].
        by_shear: Components 11, 22 and 12 of d t_s / d h_s, which is symmetric [Pa/m].
    """

    traction: Vector
    by_normal: Vector
    by_shear: tuple[float, float, float]


class Answer(NamedTuple):
    """The answer of ``n`` points.

    Attributes:
        traction: (n, s1, s2) components, shape (n, 3), [Pa].
        tangent: d traction / d trial_gap, shape (n, 3, 3), [Pa/m].
        gap: Gap at the end of the step, shape (n, 3), [m].
        history: The same variables at the end of the step as the loop was given for its start.
        dissipation: Friction work of the step, shape (n,), [J/m^2].
        status: `Status` at the end of the step, shape (n,).
    """

    traction: Floats
    tangent: Floats
    gap: Floats
    history: Floats
    dissipation: Floats
    status: NDArray[np.int8]


@inline
def yield_function(t_n: float, t_s: Vector, mu: float) -> float:
    """Phi = |t_s| + mu t_n, positive beyond the limit (5), [Pa]."""
    return np.sqrt(t_s[0] * t_s[0] + t_s[1] * t_s[1]) + mu * t_n


@inline
def return_to_limit(trial: Shear, t_n: float, stiffness: float, mu: float) -> Shear:
    """Shear traction on the limit, along the trial one (7), with the tangent of slip (10).

    Args:
        trial: Trial traction with its derivatives.
        t_n: Normal traction [Pa].
        stiffness: d t_n / d h_n [Pa/m].
        mu: Friction coefficient.
    """
    (t_1, t_2), (n_1, n_2), (s_11, s_22, s_12) = trial.traction, trial.by_normal, trial.by_shear
    size = np.sqrt(t_1 * t_1 + t_2 * t_2)
    if size == 0.0:
        size = 1.0
    m_1, m_2 = t_1 / size, t_2 / size
    limit = -mu * t_n
    ratio = limit / size
    # m (m . derivative) changes the size of the trial traction alone, which does not matter here.
    n_m, s_1m, s_2m = m_1 * n_1 + m_2 * n_2, m_1 * s_11 + m_2 * s_12, m_1 * s_12 + m_2 * s_22
    return Shear(
        (limit * m_1, limit * m_2),
        (
            ratio * (n_1 - m_1 * n_m) - mu * stiffness * m_1,
            ratio * (n_2 - m_2 * n_m) - mu * stiffness * m_2,
        ),
        (ratio * (s_11 - m_1 * s_1m), ratio * (s_22 - m_2 * s_2m), ratio * (s_12 - m_1 * s_2m)),
    )


@inline
def put_traction(
    i: int, t_n: float, stiffness: float, shear: Shear, traction: Floats, tangent: Floats
) -> None:
    """Write traction and tangent of the point ``i`` into the arrays of all points."""
    traction[i, 0], tangent[i, 0, 0] = t_n, stiffness
    traction[i, 1], traction[i, 2] = shear.traction
    tangent[i, 1, 0], tangent[i, 2, 0] = shear.by_normal
    tangent[i, 1, 1], tangent[i, 2, 2] = shear.by_shear[0], shear.by_shear[1]
    tangent[i, 1, 2] = tangent[i, 2, 1] = shear.by_shear[2]


@inline
def closed_status(slides: bool, law: Coulomb) -> int:
    """Return the `Status` of a closed point; without friction it neither sticks nor slides."""
    if law.friction == 0.0 or law.shear_compliance == np.inf:
        return FRICTIONLESS
    return SLIP if slides else STICK


@inline
def law_of(given: Floats) -> Coulomb:
    """Return the parameters of a point with friction."""
    return Coulomb(given[0], given[1], given[2], given[3], given[4] != 0.0)


@inline
def overload(load: float, strength: float) -> float:
    """Return a load over its strength, `LARGEST_OVERLOAD` if there is no strength."""
    if not load > 0.0:
        return 0.0
    return min(load / strength, LARGEST_OVERLOAD) if strength > 0.0 else LARGEST_OVERLOAD


@inline
def bond_under(bond: float, ratio: float) -> float:
    """Return what a bond is that has not broken under a ratio of load to strength."""
    return -ratio if bond == HELD and ratio > 1.0 + BORNE else INTACT


@inline
def put_nothing(i: int, answer: Answer) -> None:
    """Begin the answer of the point ``i``: it carries nothing."""
    for a in range(3):
        answer.traction[i, a] = 0.0
        for b in range(3):
            answer.tangent[i, a, b] = 0.0
    for k in range(answer.history.shape[1]):
        answer.history[i, k] = 0.0
    answer.dissipation[i], answer.status[i] = 0.0, 0


def empty_answer(trial_gap: Floats, history: Floats) -> Answer:
    """Arrays for the answer, the gap being the trial gap."""
    count, kind = len(trial_gap), trial_gap.dtype
    return Answer(
        np.zeros((count, 3), kind),
        np.zeros((count, 3, 3), kind),
        trial_gap.copy(),
        np.zeros(history.shape, kind),
        np.zeros(count, kind),
        np.zeros(count, np.int8),
    )


def closed_form_loop(point: Callable[..., None]) -> Any:
    """Return the compiled loop of a law that has a closed form on the compliance of the structure.

    Args:
        point: ``point(i, c_n, c_s, start, answer)`` writes the answer of the point ``i``, whose gap
            in the answer is the trial gap at first.
    """

    @njit(cache=True, error_model="numpy")
    def points(compliance: Floats, start: Start, answer: Answer) -> None:
        for i in range(len(answer.gap)):
            j = i if len(compliance) > 1 else 0
            point(i, compliance[j, 0], compliance[j, 1], start, answer)

    return points


def at_gap(point: Callable[..., None]) -> Callable[..., None]:
    """Return the answer of a point at its gap; ``point`` as in `closed_form_loop`."""

    @inline
    def alone(i: int, start: Start, answer: Answer) -> None:
        point(i, 0.0, 0.0, start, answer)

    return alone


def solve_points(loop: Any, trial_gap: Floats, compliance: Floats, start: Start) -> Answer:
    """Tractions of points, each on its own compliance, in closed form.

    Compiled for double precision; arrays of any other type are worked on by the interpreter.

    Args:
        loop: The compiled loop.
        trial_gap: Gap at the end if the point carried no traction, shape (n, 3), [m].
        compliance: c, normal and tangential, shape (n or 1, 2), [m/Pa].
        start: State of the points and parameters of their laws.
    """
    work = loop if trial_gap.dtype == np.float64 else loop.py_func
    answer = empty_answer(trial_gap, start.history)
    work(compliance, start, answer)
    return answer


def response_of(answer: Answer, **history: NDArray[Any]) -> Response:
    """The answer of a law whose state has a history, ``elastic_slip`` and ``internal``."""
    return Response(
        traction=answer.traction,
        tangent=answer.tangent,
        state=JointState(gap=answer.gap, **history),
        dissipation=answer.dissipation,
        status=answer.status,
    )


def contact_fraction(before: Floats, after: Floats) -> Floats:
    """Fraction theta of a step that points spend in contact before its end (8), on a straight path.

    1 where it was closed at the start, after / (after - before) where it closes within the step.

    Args:
        before: Normal gap at the start, shape (n,), [m].
        after: Normal gap at the end, zero where the point is open, shape (n,), [m].
    """
    opening = np.maximum(before, 0.0)
    if not opening.any():
        return np.ones(len(before))
    return np.where(opening > 0.0, -after / np.where(opening > 0.0, opening - after, 1.0), 1.0)
