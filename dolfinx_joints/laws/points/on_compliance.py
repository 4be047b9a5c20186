# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points on the compliance of the structure, for laws without a closed form there.

A law gives the answer of a point at its gap. The gap on a compliance c solves g + c t(g) = h for
each point by itself, by Newton's method. The residual is smooth in pieces, between kinks at which a
face opens or starts to slip. A correction is halved until it makes the residual smaller. Two rules
keep the method from stalling at a kink, which it would leave or not by the last bit of its numbers:

- If no part of a correction makes the residual smaller, half of it is taken. It ends beyond the
  kink, where Newton's direction is another.
- If the determinant of the Jacobian is negative, half of the correction is taken backwards.
  Friction is not associated, which makes such pieces. The path along which the residual falls to
  zero runs backwards in them (Smale 1976), towards a piece with a positive determinant.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from dolfinx_joints.common.errors import ConvergenceError
from dolfinx_joints.common.kernels import inline, njit
from dolfinx_joints.laws.law import Floats, Response
from dolfinx_joints.laws.points.return_mapping import Answer, Start

# Limits of Newton's method on a compliance, and its tolerance in rounding errors of a point.
# Measured on random steps of shear keys, with a compliance of the structure of 0.1 to 10 000 times
# that of the joint: of 450 400 points 4 are not found. With 12 halvings, and without the two rules
# above, 512 of 345 600 were not. Joints that dilate by the angle of friction need the iterations:
# on structures 1000 times as soft 3 of 100 000 points are not found, with 100 iterations 315.
MOST_ITERATIONS, MOST_CUTS, ROUNDING = 1_000, 16, 16.0
# Part of a correction that is taken where its length is not found by the residual.
BEYOND_KINKS = 0.5

# What `advance` says of a point.
GOES_ON, FOUND, LOST = 0, 1, 2


class Search(NamedTuple):
    """Where Newton's method of ``n`` points is.

    Attributes:
        base: Gap that the correction starts from, shape (n, 3), [m].
        correction: The whole correction, shape (n, 3), [m].
        size: Largest residual at the base, shape (n,), [m].
        counts: Corrections, halvings of this one, and whether it is taken without a comparison,
            shape (n, 3).
        matrix: Room for three equations, shape (3, 3).
        right: Room for their right-hand sides, shape (3, 3).
    """

    base: Floats
    correction: Floats
    size: Floats
    counts: NDArray[np.int64]
    matrix: Floats
    right: Floats


@register_jitable
def search_of(count: int, kind: Any) -> Search:
    """Begin the search of so many points."""
    return Search(
        np.zeros((count, 3), kind),
        np.zeros((count, 3), kind),
        np.zeros(count, kind),
        np.zeros((count, 3), np.int64),
        np.zeros((3, 3), kind),
        np.zeros((3, 3), kind),
    )


@inline
def advance(
    at: int,
    trial_gap: Any,
    compliance: Any,
    known: float,
    gap: Floats,
    traction: Floats,
    tangent: Floats,
    search: Search,
) -> int:
    """Judge the answer of a point at its gap, and write the next gap if it is not the solution.

    Args:
        at: Number of the point in the search.
        trial_gap: h, three numbers [m].
        compliance: Normal and tangential c [m/Pa], k_n and k_s of the law [Pa/m].
        known: Largest number that the gap follows from [m].
        gap: That of the answer, shape (3,), [m].
        traction: Shape (3,), [Pa].
        tangent: d traction / d gap, shape (3, 3), [Pa/m].
        search: Of all points.

    Returns:
        `GOES_ON`, `FOUND` or `LOST`.
    """
    base, correction, counts = search.base[at], search.correction[at], search.counts[at]
    size, rounding, largest = 0.0 * known, 0.0 * known, known
    tolerance = ROUNDING * np.finfo(gap.dtype).eps
    for a in range(3):
        largest = max(largest, abs(gap[a]))
    for a in range(3):
        c, k = (compliance[0], compliance[2]) if a == 0 else (compliance[1], compliance[3])
        wrong = abs(gap[a] + c * traction[a] - trial_gap[a])
        size = max(size, wrong / (1.0 + c * k))
        stiff = max(abs(tangent[a, 0]), abs(tangent[a, 1]), abs(tangent[a, 2]))
        rounding = max(rounding, (1.0 + c * stiff) * largest + abs(c * traction[a]))
    compared = counts[0] > 0 and counts[2] == 0
    if compared and not size < search.size[at] and counts[1] < MOST_CUTS:
        counts[1] += 1
        share = 0.5 ** counts[1] if counts[1] < MOST_CUTS else BEYOND_KINKS
        for a in range(3):
            gap[a] = base[a] - share * correction[a]
        return GOES_ON
    is_far = False
    jacobian, right = search.matrix, search.right
    for a in range(3):
        c = compliance[0] if a == 0 else compliance[1]
        right[a, 0] = gap[a] + c * traction[a] - trial_gap[a]
        is_far = is_far or not abs(right[a, 0]) <= tolerance * rounding
        for b in range(3):
            jacobian[a, b] = c * tangent[a, b]
        jacobian[a, a] += 1.0
    if not is_far:
        return FOUND
    if counts[0] == MOST_ITERATIONS or not np.isfinite(right[:, 0].sum() + jacobian.sum()):
        return LOST
    determinant = _solve(jacobian, right, 1)
    counts[0], counts[1], counts[2] = counts[0] + 1, 0, 1 if determinant < 0.0 else 0
    search.size[at] = size
    share = -BEYOND_KINKS if determinant < 0.0 else 1.0
    for a in range(3):
        base[a], correction[a] = gap[a], right[a, 0]
        gap[a] -= share * correction[a]
    return GOES_ON


@inline
def _solve(matrix: Floats, right: Floats, columns: int) -> float:
    """Solve three equations for some columns, in place, with pivots; return the determinant."""
    determinant = 1.0
    for a in range(3):
        pivot = a
        for b in range(a + 1, 3):
            if abs(matrix[b, a]) > abs(matrix[pivot, a]):
                pivot = b
        if pivot != a:
            determinant = -determinant
            for b in range(3):
                matrix[a, b], matrix[pivot, b] = matrix[pivot, b], matrix[a, b]
            for b in range(columns):
                right[a, b], right[pivot, b] = right[pivot, b], right[a, b]
        determinant *= matrix[a, a]
        for b in range(a + 1, 3):
            factor = matrix[b, a] / matrix[a, a]
            for k in range(a, 3):
                matrix[b, k] -= factor * matrix[a, k]
            for k in range(columns):
                right[b, k] -= factor * right[a, k]
    for k in range(columns):
        for a in range(2, -1, -1):
            for b in range(a + 1, 3):
                right[a, k] -= matrix[a, b] * right[b, k]
            right[a, k] /= matrix[a, a]
    return determinant


@inline
def by_trial_gap(compliance: Any, tangent: Floats, search: Search) -> None:
    """Replace d t / d g = K of a point by d t / d h = K (I + C K)^-1; rows of zeros stay so."""
    matrix, right = search.matrix, search.right
    for a in range(3):
        for b in range(3):
            matrix[b, a] = tangent[a, b] * (compliance[0] if a == 0 else compliance[1])
            right[b, a] = tangent[a, b]
        matrix[a, a] += 1.0
    _solve(matrix, right, 3)
    for a in range(3):
        for b in range(3):
            tangent[a, b] = right[b, a]


@functools.cache
def solver_of(point: Callable[..., None]) -> Callable[..., None]:
    """Return the function that solves a point on its compliance, of one that answers at its gap.

    Args:
        point: ``point(i, start, answer)`` writes the answer of the point ``i`` at the gap
            ``answer.gap[i]``, with its derivative by the gap, `Answer.history` included. The first
            two parameters in ``start.parameters`` are k_n and k_s. The function is decorated as
            `CompiledLaw` says.

    Returns:
        ``solve(i, c_n, c_s, start, answer, search)``, which begins with the trial gap in
        ``answer.gap[i]`` and takes room for one point. Numbers of a point that is not found are
        NaN.
    """

    @inline
    def solve(i: int, c_n: float, c_s: float, start: Start, answer: Answer, search: Search) -> None:
        alone = c_n == 0.0 and c_s == 0.0
        compliance = c_n, c_s, start.parameters[0], start.parameters[1]
        gap, known = answer.gap[i], 0.0 * c_n
        trial_gap = (gap[0], gap[1], gap[2])
        for a in range(3):
            known = max(known, max(abs(gap[a]), abs(start.gap[i, a])))
            gap[a] = trial_gap[a] if alone else start.gap[i, a]
            search.counts[0, a] = 0
        traction, tangent, judged = answer.traction[i], answer.tangent[i], GOES_ON
        while judged == GOES_ON:
            point(i, start, answer)
            judged = FOUND
            if not alone:
                judged = advance(0, trial_gap, compliance, known, gap, traction, tangent, search)
        if judged == LOST:
            traction[0] = np.nan
        by_trial_gap(compliance, tangent, search)

    return solve


@functools.cache
def loop_of(point: Callable[..., None]) -> Any:
    """Return the compiled loop of a law, as `CompiledLaw` has it; ``point`` as in `solver_of`."""
    solve = solver_of(point)

    @njit(cache=True, error_model="numpy")
    def points(compliance: Floats, start: Start, answer: Answer) -> None:
        search = search_of(1, answer.gap.dtype)
        for i in range(len(answer.gap)):
            j = i if len(compliance) > 1 else 0
            solve(i, compliance[j, 0], compliance[j, 1], start, answer, search)

    return points


@njit(cache=True, error_model="numpy")
def _advance_all(
    compliance: Floats,
    stiffness: Any,
    at_start: Floats,
    trial_gap: Floats,
    gap: Floats,
    traction: Floats,
    tangent: Floats,
    search: Search,
    judged: NDArray[np.int64],
) -> None:
    """Advance the points that are not found."""
    for i in range(len(gap)):
        if judged[i] == GOES_ON:
            j = i if len(compliance) > 1 else 0
            given = (compliance[j, 0], compliance[j, 1], stiffness[0], stiffness[1])
            known = max(np.abs(at_start[i]).max(), np.abs(trial_gap[i]).max())
            judged[i] = advance(
                i, trial_gap[i], given, known, gap[i], traction[i], tangent[i], search
            )


def on_compliance(
    answer: Callable[[Floats], Response],
    gap: Floats,
    trial_gap: Floats,
    compliance: Floats,
    stiffness: tuple[float, float],
) -> Response:
    """Return the answer at gap = trial_gap - compliance * t of a law that is evaluated in Python.

    Args:
        answer: Gives the answer of all points at a gap of shape (n, 3), [m].
        gap: That at the start of the step, where few points slide.
        trial_gap: Gap if the point carried no traction, shape (n, 3), [m].
        compliance: Normal and tangential compliance, shape (n or 1, 2), [m/Pa].
        stiffness: k_n and k_s of a sticking point, for a measure of residuals.

    Raises:
        ConvergenceError: A point was not found.
    """
    start, end, kind = gap, gap.astype(trial_gap.dtype), trial_gap.dtype
    work = _advance_all if kind == np.float64 else _advance_all.py_func
    search, judged = search_of(len(end), kind), np.zeros(len(end), dtype=np.int64)
    while True:
        found = answer(end.copy())
        work(
            compliance,
            stiffness,
            start,
            trial_gap,
            end,
            found.traction,
            found.tangent,
            search,
            judged,
        )
        if not (judged == GOES_ON).any():
            break
    lost = judged == LOST
    if not all(np.isfinite(values[lost]).all() for values in (found.traction, found.tangent)):
        return found  # what a law cannot answer is named where the step fails
    if lost.any():
        raise ConvergenceError(iteration=MOST_ITERATIONS, residual=float(search.size.max()))
    wide = np.repeat(compliance, (1, 2), axis=1)
    matrix = np.eye(3) + wide[:, :, None] * found.tangent
    right = found.tangent.transpose(0, 2, 1).astype(np.float64)
    tangent = np.linalg.solve(matrix.transpose(0, 2, 1).astype(np.float64), right)
    return replace(found, tangent=np.ascontiguousarray(tangent.transpose(0, 2, 1), np.float64))
