# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solution of points on the structural compliance, for laws without a closed form of (21).

A law returns the traction t at a gap g. Newton's method solves g + c t(g) = h for each point
separately; c is the compliance of the structure, h the trial gap. The residual is piecewise smooth,
with kinks at which a face opens or starts to slip. The line search halves a correction until the
residual decreases. Two rules avoid stalling at a kink, which would depend on rounding error:

- If no fraction of a correction reduces the residual, apply half of the correction. The iterate is
  then beyond the kink, where Newton's direction differs.
- If the determinant of the Jacobian is negative, apply half of the correction with opposite sign.
  Such smooth pieces exist because friction is not associated. There the path of decreasing residual
  runs backwards (Smale 1976), towards a piece with a positive determinant.
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

# Limits of Newton's method, and its tolerance as a multiple of the rounding error of a point.
# Measured on random steps of shear keys, with a structure 0.1 to 10 000 times as compliant as the
# joint: 4 of 450 400 points fail. With 12 halvings and without the two rules above, 512 of 345 600
# fail. Dilatancy equal to the friction angle needs many iterations: on structures 1000 times as
# compliant as the joint 3 of 100 000 points fail, but 315 with at most 100 iterations.
MOST_ITERATIONS, MOST_CUTS, ROUNDING = 1_000, 16, 16.0
# Fraction of a correction that is applied by the two rules above.
BEYOND_KINKS = 0.5

# Results of `advance`.
CONTINUE, CONVERGED, FAILED = 0, 1, 2


class Search(NamedTuple):
    """State of Newton's method at ``n`` points.

    Attributes:
        base: Gap before the correction, shape (n, 3), [m].
        correction: Full correction, shape (n, 3), [m].
        size: Largest residual at the base, shape (n,), [m].
        counts: Number of corrections, number of halvings of the present correction, and 1 if this
            correction has no line search, shape (n, 3).
        matrix: Work array for three equations, shape (3, 3).
        rhs: Work array for three right-hand sides, shape (3, 3).
    """

    base: Floats
    correction: Floats
    size: Floats
    counts: NDArray[np.int64]
    matrix: Floats
    rhs: Floats


@register_jitable
def search_of(count: int, kind: Any) -> Search:
    """Return the initial state of the search at ``count`` points."""
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
    scale: float,
    gap: Floats,
    traction: Floats,
    tangent: Floats,
    search: Search,
) -> int:
    """Check the residual of a point; if it has not converged, write the next gap.

    Args:
        at: Index of the point in the search.
        trial_gap: h, three numbers [m].
        compliance: Normal and tangential c [m/Pa], k_n and k_s of the law [Pa/m].
        scale: Largest gap or trial gap, which sets the rounding error [m].
        gap: Current gap, shape (3,), [m]; modified.
        traction: Traction at this gap, shape (3,), [Pa].
        tangent: d traction / d gap, shape (3, 3), [Pa/m].
        search: State of the search at all points; modified.

    Returns:
        `CONTINUE`, `CONVERGED` or `FAILED`.
    """
    base, correction, counts = search.base[at], search.correction[at], search.counts[at]
    size, rounding, largest = 0.0 * scale, 0.0 * scale, scale
    tolerance = ROUNDING * np.finfo(gap.dtype).eps
    for a in range(3):
        largest = max(largest, abs(gap[a]))
    for a in range(3):
        c, k = (compliance[0], compliance[2]) if a == 0 else (compliance[1], compliance[3])
        error = abs(gap[a] + c * traction[a] - trial_gap[a])
        size = max(size, error / (1.0 + c * k))
        stiff = max(abs(tangent[a, 0]), abs(tangent[a, 1]), abs(tangent[a, 2]))
        rounding = max(rounding, (1.0 + c * stiff) * largest + abs(c * traction[a]))
    compared = counts[0] > 0 and counts[2] == 0
    if compared and not size < search.size[at] and counts[1] < MOST_CUTS:
        counts[1] += 1
        share = 0.5 ** counts[1] if counts[1] < MOST_CUTS else BEYOND_KINKS
        for a in range(3):
            gap[a] = base[a] - share * correction[a]
        return CONTINUE
    is_far = False
    jacobian, rhs = search.matrix, search.rhs
    for a in range(3):
        c = compliance[0] if a == 0 else compliance[1]
        rhs[a, 0] = gap[a] + c * traction[a] - trial_gap[a]
        is_far = is_far or not abs(rhs[a, 0]) <= tolerance * rounding
        for b in range(3):
            jacobian[a, b] = c * tangent[a, b]
        jacobian[a, a] += 1.0
    if not is_far:
        return CONVERGED
    if counts[0] == MOST_ITERATIONS or not np.isfinite(rhs[:, 0].sum() + jacobian.sum()):
        return FAILED
    determinant = _solve(jacobian, rhs, 1)
    counts[0], counts[1], counts[2] = counts[0] + 1, 0, 1 if determinant < 0.0 else 0
    search.size[at] = size
    share = -BEYOND_KINKS if determinant < 0.0 else 1.0
    for a in range(3):
        base[a], correction[a] = gap[a], rhs[a, 0]
        gap[a] -= share * correction[a]
    return CONTINUE


@inline
def _solve(matrix: Floats, rhs: Floats, columns: int) -> float:
    """Solve three equations for ``columns`` right-hand sides in place; return the determinant."""
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
                rhs[a, b], rhs[pivot, b] = rhs[pivot, b], rhs[a, b]
        determinant *= matrix[a, a]
        for b in range(a + 1, 3):
            factor = matrix[b, a] / matrix[a, a]
            for k in range(a, 3):
                matrix[b, k] -= factor * matrix[a, k]
            for k in range(columns):
                rhs[b, k] -= factor * rhs[a, k]
    for k in range(columns):
        for a in range(2, -1, -1):
            for b in range(a + 1, 3):
                rhs[a, k] -= matrix[a, b] * rhs[b, k]
            rhs[a, k] /= matrix[a, a]
    return determinant


@inline
def by_trial_gap(compliance: Any, tangent: Floats, search: Search) -> None:
    """Replace d t / d g = K of a point by d t / d h = K (I + C K)^-1; zero rows stay zero."""
    matrix, rhs = search.matrix, search.rhs
    for a in range(3):
        for b in range(3):
            matrix[b, a] = tangent[a, b] * (compliance[0] if a == 0 else compliance[1])
            rhs[b, a] = tangent[a, b]
        matrix[a, a] += 1.0
    _solve(matrix, rhs, 3)
    for a in range(3):
        for b in range(3):
            tangent[a, b] = rhs[b, a]


@inline
def from_start(i: int, c_n: float, c_s: float, start: Start, answer: Answer) -> None:
    """Set the gap of a point to that at the start of the step."""
    for a in range(3):
        answer.gap[i, a] = start.gap[i, a]


@functools.cache
def solver_of(
    point: Callable[..., None], guess: Callable[..., None] = from_start
) -> Callable[..., None]:
    """Return the function that solves a point on a compliance.

    Args:
        point: ``point(i, start, answer)`` as in `CompiledLaw`: computes response, history and
            derivative by the gap at ``answer.gap[i]``. The first two numbers in
            ``start.parameters`` are k_n and k_s.
        guess: ``guess(i, c_n, c_s, start, answer)`` replaces the trial gap ``answer.gap[i]`` by the
            gap at which the iteration starts.

    Returns:
        ``solve(i, c_n, c_s, start, answer, search)``. On entry ``answer.gap[i]`` is the trial gap;
        ``search`` has room for one point. The normal traction is NaN if the iteration fails.
    """

    @inline
    def solve(i: int, c_n: float, c_s: float, start: Start, answer: Answer, search: Search) -> None:
        alone = c_n == 0.0 and c_s == 0.0
        compliance = c_n, c_s, start.parameters[0], start.parameters[1]
        gap, scale = answer.gap[i], 0.0 * c_n
        trial_gap = (gap[0], gap[1], gap[2])
        for a in range(3):
            scale = max(scale, max(abs(gap[a]), abs(start.gap[i, a])))
            search.counts[0, a] = 0
        if not alone:
            guess(i, c_n, c_s, start, answer)
        traction, tangent, status = answer.traction[i], answer.tangent[i], CONTINUE
        while status == CONTINUE:
            point(i, start, answer)
            status = CONVERGED
            if not alone:
                status = advance(0, trial_gap, compliance, scale, gap, traction, tangent, search)
        if status == FAILED:
            traction[0] = np.nan
        by_trial_gap(compliance, tangent, search)

    return solve


@functools.cache
def loop_of(point: Callable[..., None], guess: Callable[..., None] = from_start) -> Any:
    """Return the compiled loop of a law; arguments as in `solver_of`."""
    solve = solver_of(point, guess)

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
    status: NDArray[np.int64],
) -> None:
    """Advance the points that have not converged."""
    for i in range(len(gap)):
        if status[i] == CONTINUE:
            j = i if len(compliance) > 1 else 0
            values = (compliance[j, 0], compliance[j, 1], stiffness[0], stiffness[1])
            scale = max(np.abs(at_start[i]).max(), np.abs(trial_gap[i]).max())
            status[i] = advance(
                i, trial_gap[i], values, scale, gap[i], traction[i], tangent[i], search
            )


def on_compliance(
    answer: Callable[[Floats], Response],
    gap: Floats,
    trial_gap: Floats,
    compliance: Floats,
    stiffness: tuple[float, float],
) -> Response:
    """Return the response of a law evaluated in Python at gap = trial_gap - compliance * t.

    Args:
        answer: Function that returns the response of all points at a gap (n, 3), [m].
        gap: Initial guess: gap at the start of the step, where few points slide, (n, 3), [m].
        trial_gap: Gap without traction, shape (n, 3), [m].
        compliance: Normal and tangential compliance, shape (n or 1, 2), [m/Pa].
        stiffness: k_n and k_s of a sticking point, which scale the residuals [Pa/m].

    Raises:
        ConvergenceError: Newton's method failed at a point.
    """
    start, end, kind = gap, gap.astype(trial_gap.dtype), trial_gap.dtype
    work = _advance_all if kind == np.float64 else _advance_all.py_func
    search, status = search_of(len(end), kind), np.zeros(len(end), dtype=np.int64)
    while True:
        response = answer(end.copy())
        work(
            compliance,
            stiffness,
            start,
            trial_gap,
            end,
            response.traction,
            response.tangent,
            search,
            status,
        )
        if not (status == CONTINUE).any():
            break
    failed = status == FAILED
    if not all(
        np.isfinite(values[failed]).all() for values in (response.traction, response.tangent)
    ):
        return response  # the caller reports values that are not finite
    if failed.any():
        raise ConvergenceError(iteration=MOST_ITERATIONS, residual=float(search.size.max()))
    c = np.repeat(compliance, (1, 2), axis=1)
    matrix = np.eye(3) + c[:, :, None] * response.tangent
    rhs = response.tangent.transpose(0, 2, 1).astype(np.float64)
    tangent = np.linalg.solve(matrix.transpose(0, 2, 1).astype(np.float64), rhs)
    return replace(response, tangent=np.ascontiguousarray(tangent.transpose(0, 2, 1), np.float64))
