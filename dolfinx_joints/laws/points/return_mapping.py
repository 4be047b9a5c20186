# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Coulomb friction at one point: yield function and return mapping, shared by all friction rules.

The functions have scalar arguments and follow docs/theory; equation numbers are in brackets. Numba
compiles them into loops over points: in `friction` for the end of a step, and in
`discrete_gradient` for a whole step. Laws without a closed form use `points.on_compliance`.

Gradients evaluate the same functions in Python with dual numbers (`gradient.dual_numbers`): use
``np.sqrt`` and comparisons, and no functions of ``math``.

The structure has the compliance c at a point, gap = trial_gap - c t; c = 0 gives the law at a gap.
The tractions depend on c + d with the joint compliance d = 1/k, which is zero in rigid joints.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.kernels import inline, njit
from dolfinx_joints.laws.law import (
    HELD,
    INTACT,
    LARGEST_OVERLOAD,
    OVERLOAD_ROUNDING,
    Floats,
    JointState,
    Response,
)

Vector = tuple[float, float]

# Values of `Status`.
STICK, SLIP, FRICTIONLESS = 1, 2, 3


class Coulomb(NamedTuple):
    """Parameters of a friction law.

    Attributes:
        normal_compliance: d_n = 1 / k_n [m/Pa], zero if rigid.
        shear_compliance: d_s = 1 / k_s [m/Pa], zero if rigid, infinite without shear stiffness.
        ratio: kappa = k_n / k_s.
        friction: mu.
        rebounds: True if a rigid point returns its impact energy on opening.
    """

    normal_compliance: float
    shear_compliance: float
    ratio: float
    friction: float
    rebounds: bool = True


class Start(NamedTuple):
    """State and parameters of ``n`` points at the start of a step, as passed to a compiled loop.

    Attributes:
        gap: Gap, shape (n, 3), [m].
        history: History variables, shape (n, m).
        parameters: Parameters of the law, for example the fields of `Coulomb`, shape (k,).
    """

    gap: Floats
    history: Floats
    parameters: Floats


class Shear(NamedTuple):
    """Shear traction of a point and its derivatives by the trial gap h.

    Attributes:
        traction: t_s [Pa].
        by_normal: d t_s / d h_n [Pa/m].
        by_shear: Components 11, 22 and 12 of the symmetric d t_s / d h_s [Pa/m].
    """

    traction: Vector
    by_normal: Vector
    by_shear: tuple[float, float, float]


class Answer(NamedTuple):
    """Response of ``n`` points, written by a compiled loop.

    Attributes:
        traction: (n, s1, s2) components, shape (n, 3), [Pa].
        tangent: d traction / d trial_gap, shape (n, 3, 3), [Pa/m].
        gap: Gap at the end of the step, shape (n, 3), [m].
        history: History variables of `Start` at the end of the step, shape (n, m).
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
    """Return f = |t_s| + mu t_n (5), positive outside the friction cone, [Pa]."""
    return np.sqrt(t_s[0] * t_s[0] + t_s[1] * t_s[1]) + mu * t_n


@inline
def return_to_limit(trial: Shear, t_n: float, stiffness: float, mu: float) -> Shear:
    """Return the trial traction scaled onto the friction limit (7), with derivatives (10).

    Args:
        trial: Trial traction and its derivatives.
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
    # Subtract m (m . derivative): the magnitude of the trial traction does not affect the result.
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
    """Write traction and tangent of point ``i`` to the arrays of all points."""
    traction[i, 0], tangent[i, 0, 0] = t_n, stiffness
    traction[i, 1], traction[i, 2] = shear.traction
    tangent[i, 1, 0], tangent[i, 2, 0] = shear.by_normal
    tangent[i, 1, 1], tangent[i, 2, 2] = shear.by_shear[0], shear.by_shear[1]
    tangent[i, 1, 2] = tangent[i, 2, 1] = shear.by_shear[2]


@inline
def closed_status(slides: bool, law: Coulomb) -> int:
    """Return the `Status` of a closed point, FRICTIONLESS if it has no shear resistance."""
    if law.friction == 0.0 or law.shear_compliance == np.inf:
        return FRICTIONLESS
    return SLIP if slides else STICK


@inline
def law_of(row: Floats) -> Coulomb:
    """Return the parameters in an array as `Coulomb`."""
    return Coulomb(row[0], row[1], row[2], row[3], row[4] != 0.0)


@inline
def overload(load: float, strength: float) -> float:
    """Return load / strength, `LARGEST_OVERLOAD` if the strength is zero, 0 without load."""
    if not load > 0.0:
        return 0.0
    return min(load / strength, LARGEST_OVERLOAD) if strength > 0.0 else LARGEST_OVERLOAD


@inline
def bond_under(bond: float, ratio: float) -> float:
    """Return the new bond variable of an unbroken bond for a ratio of load to strength."""
    return -ratio if bond == HELD and ratio > 1.0 + OVERLOAD_ROUNDING else INTACT


@inline
def put_zeros(i: int, answer: Answer) -> None:
    """Set the response of point ``i`` to zero (open)."""
    for a in range(3):
        answer.traction[i, a] = 0.0
        for b in range(3):
            answer.tangent[i, a, b] = 0.0
    for k in range(answer.history.shape[1]):
        answer.history[i, k] = 0.0
    answer.dissipation[i], answer.status[i] = 0.0, 0


def empty_answer(trial_gap: Floats, history: Floats) -> Answer:
    """Return arrays for the response, with the trial gap as gap."""
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
    """Return the compiled loop of a law with a closed form on the structural compliance.

    Args:
        point: ``point(i, c_n, c_s, start, answer)`` computes the response of point ``i``; on entry
            ``answer.gap[i]`` is the trial gap.
    """

    @njit(cache=True, error_model="numpy")
    def points(compliance: Floats, start: Start, answer: Answer) -> None:
        for i in range(len(answer.gap)):
            j = i if len(compliance) > 1 else 0
            point(i, compliance[j, 0], compliance[j, 1], start, answer)

    return points


def at_gap(point: Callable[..., None]) -> Callable[..., None]:
    """Return the function of a point at a given gap (c = 0) from ``point`` (`closed_form_loop`)."""

    @inline
    def alone(i: int, start: Start, answer: Answer) -> None:
        point(i, 0.0, 0.0, start, answer)

    return alone


def solve_points(loop: Any, trial_gap: Floats, compliance: Floats, start: Start) -> Answer:
    """Return the response of points on a diagonal compliance.

    The loop is compiled for double precision; other array types use the Python interpreter.

    Args:
        loop: The compiled loop.
        trial_gap: Gap at the end without traction, shape (n, 3), [m].
        compliance: c, normal and tangential, shape (n or 1, 2), [m/Pa].
        start: State of the points and parameters of their laws.
    """
    work = loop if trial_gap.dtype == np.float64 else loop.py_func
    answer = empty_answer(trial_gap, start.history)
    work(compliance, start, answer)
    return answer


def response_of(answer: Answer, **history: NDArray[Any]) -> Response:
    """Return an `Answer` as a `Response`; ``history`` are fields of its `JointState`."""
    return Response(
        traction=answer.traction,
        tangent=answer.tangent,
        state=JointState(gap=answer.gap, **history),
        dissipation=answer.dissipation,
        status=answer.status,
    )


def contact_fraction(before: Floats, after: Floats) -> Floats:
    """Return the fraction theta of a step in which points are in contact (8), on a straight path.

    theta is 1 if a point is closed at the start, after / (after - before) if it closes in the step.

    Args:
        before: Normal gap at the start, shape (n,), [m].
        after: Normal gap at the end, zero where the point is open, shape (n,), [m].
    """
    opening = np.maximum(before, 0.0)
    if not opening.any():
        return np.ones(len(before))
    return np.where(opening > 0.0, -after / np.where(opening > 0.0, opening - after, 1.0), 1.0)
