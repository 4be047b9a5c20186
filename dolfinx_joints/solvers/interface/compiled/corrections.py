# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton's corrections d of the joint forces, (I + T S) d = r (24), on the smaller of two sets.

S is the scaled compliance less the identity, T the scaled tangent with a 3 x 3 block per point, r
the scaled residual, see `joint_step`. Equation numbers are those of docs/theory.

- *Active*: T is zero at open points. If few points are closed, solve only for the closed points.
- *Complement*: T is the diagonal T0 at sticking points. If few points are open or slide, solve only
  for these points with W = S (I + T0 S)^-1, which is computed once. With T = T0 + E (25),

      q = r - E y,   (I + W E) y = W r,   d = q - T0 W q,   S d = W q.

GMRES solves both systems, which are close to the identity at any joint stiffness.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.common.kernels import njit, part
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.interface.compiled.krylov import Space, dot, gmres
from dolfinx_joints.solvers.interface.compiled.products import (
    Kept,
    apply_blocks,
    cost,
    keep,
    multiply,
    multiply_part,
)
from dolfinx_joints.solvers.interface.compiled.ranks import allgather_values, largest_of, sum_over


class Memory(NamedTuple):
    """Data kept between corrections, and work arrays.

    Attributes:
        active: Set of the active points.
        changed: Set of the points that do not stick, with their part of W.
        has_complement: True if W has been computed.
        complement: W, in the same form as S inside corrections.
        may_have_complement: True if W can be computed.
        stuck: T0, shape (m,), empty if W cannot be computed.
        avoidable: Number of entries whose reading W would have saved so far, shape (1,).
        finest: Finest tolerance of the systems.
        space: Work arrays of GMRES.
        vectors: d and S d, in the rows `STEP` and `COUPLED`, and four work vectors, shape (6, m).
        numbers: Work arrays for numbers of active and of changed points, shape (2, points).
    """

    active: Kept
    changed: Kept
    has_complement: bool
    complement: Any
    may_have_complement: bool
    stuck: Floats
    avoidable: Floats
    finest: float
    space: Space
    vectors: Floats
    numbers: Ints


# Rows of `Memory.vectors`: d, S d, and r without small entries. Rows from FREE on are work vectors.
STEP, COUPLED, RESIDUAL, FREE = 0, 1, 2, 3


@njit(cache=True, no_cfunc_wrapper=True)
def correct(
    inner: Any,
    residual: Floats,
    tangent: Floats,
    smallest: float,
    tolerance: float,
    couples: bool,
    memory: Memory,
) -> None:
    """Write d, and S d with the accuracy of ``inner``, to the memory (collective).

    Args:
        inner: S in single precision or compressed.
        residual: r, shape (m,).
        tangent: T, shape (points, 3, 3).
        smallest: Entries of r up to this size are treated as zero.
        tolerance: Largest residual of the correction, relative to r.
        couples: True if S d is needed.
        memory: Data and work arrays.
    """
    load, stuck, numbers, nonzero = memory.vectors[RESIDUAL], memory.stuck, memory.numbers, 0
    for k in range(len(load)):
        load[k] = residual[k] if abs(residual[k]) > smallest else 0.0
        nonzero += load[k] != 0.0
    tolerance = max(tolerance, memory.finest)
    active = _differing(tangent, stuck, False, numbers[0])
    if memory.may_have_complement:
        changed = _differing(tangent, stuck, True, numbers[1])
        counts = np.array([float(active), float(changed), float(nonzero)])
        by_rank = allgather_values(inner.ranks, counts)
        actives, changes = int(by_rank[:, 0].sum()), int(by_rank[:, 1].sum())
        first = _cost_of_system(inner, actives) + cost(inner, 3 * actives)
        second = cost(inner, int(by_rank[:, 2].sum())) + cost(inner, 3 * changes)
        second += _cost_of_system(inner, changes)
        if second < first:
            if memory.has_complement:
                keep(memory.complement, memory.changed, numbers[1], changed)
                _correct_changed(tangent, tolerance, memory)
                return
            memory.avoidable[0] += first - second
    keep(inner, memory.active, numbers[0], active)
    _correct_active(inner, tangent, tolerance, couples, memory)


@part
def _cost_of_system(inner: Any, points: int) -> float:
    """Return the number of entries that GMRES reads for a system of ``points`` points."""
    return limits.TYPICAL_PRODUCTS * min(9.0 * float(points) ** 2, cost(inner, 3 * points))


@part
def _differing(tangent: Floats, stuck: Floats, from_stuck: bool, numbers: Ints) -> int:
    """Write the numbers of points with T not zero, or not T0; return the number of points."""
    count = 0
    for i in range(len(tangent)):
        differs, same = False, limits.SAME_TANGENT if from_stuck else 0.0
        for a in range(3):
            for b in range(3):
                expected = stuck[3 * i + a] if a == b and from_stuck else 0.0
                differs = differs or not abs(tangent[i, a, b] - expected) <= same
        if differs:
            numbers[count] = i
            count += 1
    return count


@part
def _gather_points(points: Ints, values: Floats, part: Floats) -> None:
    """Copy the values at some points to ``part``."""
    for i in range(len(part) // 3):
        for a in range(3):
            part[3 * i + a] = values[3 * points[i] + a]


@part
def _scatter_points(points: Ints, part: Floats, values: Floats) -> None:
    """Write the values at some points, and zero elsewhere."""
    for k in range(len(values)):
        values[k] = 0.0
    for i in range(len(part) // 3):
        for a in range(3):
            values[3 * points[i] + a] = part[3 * i + a]


@part
def _correct_active(
    inner: Any, tangent: Floats, tolerance: float, couples: bool, memory: Memory
) -> None:
    """Solve for the active points; at other points the correction is the residual (collective)."""
    kept, space, vectors = memory.active, memory.space, memory.vectors
    step, coupled, residual, work = vectors[STEP], vectors[COUPLED], vectors[RESIDUAL], vectors[3]
    points, size, others = kept.points, 3 * kept.number[0], 0.0
    right_hand_side, solution, coupled_others = vectors[4, :size], vectors[5, :size], vectors[4]
    for k in range(len(step)):
        step[k] = residual[k]
    for i in range(kept.number[0]):
        for a in range(3):
            step[3 * points[i] + a] = 0.0
            for b in range(3):
                space.blocks[i, a, b] = tangent[points[i], a, b]
    for k in range(len(step)):
        others = 1.0 if step[k] != 0.0 else others
    others = largest_of(inner.ranks, others)
    if others > 0.0:
        multiply(inner, step, coupled_others)
        _gather_points(points, coupled_others, work[:size])
        apply_blocks(space.blocks, work[:size], solution)
    _gather_points(points, residual, right_hand_side)
    for k in range(size):
        right_hand_side[k] -= solution[k] if others > 0.0 else 0.0
    gmres(inner, kept, right_hand_side, tolerance, space, solution)
    for i in range(kept.number[0]):
        for a in range(3):
            step[3 * points[i] + a] = solution[3 * i + a]
    if couples:
        multiply(inner, step, coupled)


@part
def _correct_changed(tangent: Floats, tolerance: float, memory: Memory) -> None:
    """Solve the system of the points that do not stick (collective).

    With z = E y: (I + E W) z = E W r, q = r - z, d = q - T0 W q, S d = W q.
    """
    kept, space, vectors = memory.changed, memory.space, memory.vectors
    complement = memory.complement
    step, coupled, residual = vectors[STEP], vectors[COUPLED], vectors[RESIDUAL]
    coupled_residual, scattered = vectors[3], vectors[4]
    points, size = kept.points, 3 * kept.number[0]
    right_hand_side, solution = vectors[4, :size], vectors[5, :size]
    # If only points of the set have a residual, the part of W of the set gives W r.
    inside = largest_of(complement.ranks, _outside(points[: kept.number[0]], residual)) == 0.0
    if inside:
        _gather_points(points, residual, solution)
        space.vectors[0, :size] = solution
        multiply_part(complement, kept, space.vectors[0, :size], space.vectors[1, :size])
        solution[:] = space.vectors[1, :size]
    else:
        multiply(complement, residual, coupled_residual)
        _gather_points(points, coupled_residual, solution)
    for i in range(kept.number[0]):
        for a in range(3):
            for b in range(3):
                space.blocks[i, a, b] = tangent[points[i], a, b]
            space.blocks[i, a, a] = tangent[points[i], a, a] - memory.stuck[3 * points[i] + a]
    apply_blocks(space.blocks, solution, right_hand_side)
    # The residual must be small compared with r, and E W r may be larger.
    squares = np.array([dot(residual, residual), dot(right_hand_side, right_hand_side)])
    sum_over(complement.ranks, squares)
    if squares[0] < squares[1]:
        tolerance = max(tolerance * np.sqrt(squares[0] / squares[1]), memory.finest)
    gmres(complement, kept, right_hand_side, tolerance, space, solution)
    _scatter_points(points, solution, scattered)
    for k in range(len(step)):
        step[k] = residual[k] - scattered[k]
    if inside:
        multiply(complement, step, coupled)
    else:
        multiply(complement, scattered, coupled)
        for k in range(len(step)):
            coupled[k] = coupled_residual[k] - coupled[k]
    for k in range(len(step)):
        step[k] -= memory.stuck[k] * coupled[k]


@part
def _outside(points: Ints, values: Floats) -> float:
    """Return 1.0 if a point outside the sorted ``points`` has a nonzero value, else 0.0."""
    place = 0
    for i in range(len(values) // 3):
        if place < len(points) and points[place] == i:
            place += 1
        elif values[3 * i] != 0.0 or values[3 * i + 1] != 0.0 or values[3 * i + 2] != 0.0:
            return 1.0
    return 0.0
