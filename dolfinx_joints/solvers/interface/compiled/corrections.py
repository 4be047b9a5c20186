# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton's corrections of the joint forces, (I + T S) d = r, on the smaller of two sets.

S is the compliance less its diagonal, T the tangent of the points, a block of 3 x 3 each.

- *Active*: T vanishes at open points. If few points are closed: a system of the closed ones alone.
- *Complement*: T is T0, a diagonal, at points that stick. If few points are open or slide, W =
  S (I + T0 S)^-1, made once, leaves a system of those alone. With T = T0 + E,

      q = r - E y,   (I + W E) y = W r,   d = q - T0 W q,   S d = W q.

Both systems are solved by GMRES; they are close to the identity however stiff the joints are.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.kernels import njit, part
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.interface.compiled.krylov import Space, dot, gmres
from dolfinx_joints.solvers.interface.compiled.products import (
    Kept,
    cost,
    hold,
    multiply,
    multiply_part,
    turn,
)
from dolfinx_joints.solvers.interface.compiled.ranks import each_of_ranks, largest_of, sum_over

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Memory(NamedTuple):
    """What corrections keep from one to the next, and room to work in.

    Attributes:
        active: Set of the active points.
        changed: Set of the points that do not stick, with their part of W.
        has_complement: Whether W has been made.
        complement: W, as S inside corrections.
        may_have_complement: Whether W can be made.
        stuck: T0, shape (m,), empty where there is none.
        avoidable: Entries read so far that W would have spared, shape (1,).
        finest: Tolerance that systems are solved to at best.
        space: Room for GMRES.
        vectors: d and S d, in the rows `STEP` and `COUPLED`, and room for four more, shape (6, m).
        numbers: Room for numbers of active and of changed points, shape (2, points).
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


# Rows of the vectors above: d, S d, and r without its small entries; the next are free between
# corrections.
STEP, COUPLED, RIGHT, FREE = 0, 1, 2, 3


@njit(cache=True, no_cfunc_wrapper=True)
def correct(
    inner: Any,
    residual: Floats,
    tangent: Floats,
    least: float,
    tolerance: float,
    couples: bool,
    memory: Memory,
) -> None:
    """Write d, and S d as exact as ``inner`` is, to the memory (collective).

    Args:
        inner: S, in single precision or rougher.
        residual: r, shape (m,).
        tangent: T, shape (points, 3, 3).
        least: Entries of r up to this one are left as they are.
        tolerance: Of the residual, relative to r.
        couples: Whether S d is wanted.
        memory: What is kept.
    """
    right, stuck, numbers, loaded = memory.vectors[RIGHT], memory.stuck, memory.numbers, 0
    for k in range(len(right)):
        right[k] = residual[k] if abs(residual[k]) > least else 0.0
        loaded += right[k] != 0.0
    tolerance = max(tolerance, memory.finest)
    active = _differing(tangent, stuck, False, numbers[0])
    if memory.may_have_complement:
        changed = _differing(tangent, stuck, True, numbers[1])
        mine = np.array([float(active), float(changed), float(loaded)])
        every = each_of_ranks(inner.ranks, mine)
        actives, changes = int(every[:, 0].sum()), int(every[:, 1].sum())
        first = _cost_of_system(inner, actives) + cost(inner, 3 * actives)
        second = cost(inner, int(every[:, 2].sum())) + cost(inner, 3 * changes)
        second += _cost_of_system(inner, changes)
        if second < first:
            if memory.has_complement:
                hold(memory.complement, memory.changed, numbers[1], changed)
                _correct_changed(tangent, tolerance, memory)
                return
            memory.avoidable[0] += first - second
    hold(inner, memory.active, numbers[0], active)
    _correct_active(inner, tangent, tolerance, couples, memory)


@part
def _cost_of_system(inner: Any, points: int) -> float:
    """Entries that the products of a system of so many points read."""
    return limits.TYPICAL_PRODUCTS * min(9.0 * float(points) ** 2, cost(inner, 3 * points))


@part
def _differing(tangent: Floats, stuck: Floats, from_stuck: bool, found: Ints) -> int:
    """Points whose block differs from zero, or from T0: their numbers, and how many there are."""
    count = 0
    for i in range(len(tangent)):
        differs, same = False, limits.SAME_TANGENT if from_stuck else 0.0
        for a in range(3):
            for b in range(3):
                expected = stuck[3 * i + a] if a == b and from_stuck else 0.0
                differs = differs or not abs(tangent[i, a, b] - expected) <= same
        if differs:
            found[count] = i
            count += 1
    return count


@part
def _part_of(points: Ints, values: Floats, part: Floats) -> None:
    """Values at some points."""
    for i in range(len(part) // 3):
        for a in range(3):
            part[3 * i + a] = values[3 * points[i] + a]


@part
def _spread(points: Ints, part: Floats, values: Floats) -> None:
    """Values that are zero but at some points."""
    for k in range(len(values)):
        values[k] = 0.0
    for i in range(len(part) // 3):
        for a in range(3):
            values[3 * points[i] + a] = part[3 * i + a]


@part
def _correct_active(
    inner: Any, tangent: Floats, tolerance: float, couples: bool, memory: Memory
) -> None:
    """The system of the active points; the others' corrections are their residuals.

    (Collective.)
    """
    kept, space, vectors = memory.active, memory.space, memory.vectors
    step, coupled, residual, every = vectors[STEP], vectors[COUPLED], vectors[RIGHT], vectors[3]
    points, size, others = kept.points, 3 * kept.number[0], 0.0
    right, found, caused = vectors[4, :size], vectors[5, :size], vectors[4]
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
        multiply(inner, step, caused)
        _part_of(points, caused, every[:size])
        turn(space.blocks, every[:size], found)
    _part_of(points, residual, right)
    for k in range(size):
        right[k] -= found[k] if others > 0.0 else 0.0
    gmres(inner, kept, right, tolerance, space, found)
    for i in range(kept.number[0]):
        for a in range(3):
            step[3 * points[i] + a] = found[3 * i + a]
    if couples:
        multiply(inner, step, coupled)


@part
def _correct_changed(tangent: Floats, tolerance: float, memory: Memory) -> None:
    """The system of the points that do not stick.

    With z = E y: (I + E W) z = E W r, q = r - z, d = q - T0 W q, S d = W q. (Collective.)
    """
    kept, space, vectors = memory.changed, memory.space, memory.vectors
    complement = memory.complement
    step, coupled, residual = vectors[STEP], vectors[COUPLED], vectors[RIGHT]
    known, taken = vectors[3], vectors[4]
    points, size = kept.points, 3 * kept.number[0]
    right, found = vectors[4, :size], vectors[5, :size]
    # Where only points of the set have a residual, its part of W gives the right-hand side.
    among = largest_of(complement.ranks, _outside(points[: kept.number[0]], residual)) == 0.0
    if among:
        _part_of(points, residual, found)
        space.vectors[0, :size] = found
        multiply_part(complement, kept, space.vectors[0, :size], space.vectors[1, :size])
        found[:] = space.vectors[1, :size]
    else:
        multiply(complement, residual, known)
        _part_of(points, known, found)
    for i in range(kept.number[0]):
        for a in range(3):
            for b in range(3):
                space.blocks[i, a, b] = tangent[points[i], a, b]
            space.blocks[i, a, a] = tangent[points[i], a, a] - memory.stuck[3 * points[i] + a]
    turn(space.blocks, found, right)
    # What is left is to be small beside r, and E W r may be larger.
    squares = np.array([dot(residual, residual), dot(right, right)])
    sum_over(complement.ranks, squares)
    if squares[0] < squares[1]:
        tolerance = max(tolerance * np.sqrt(squares[0] / squares[1]), memory.finest)
    gmres(complement, kept, right, tolerance, space, found)
    _spread(points, found, taken)
    for k in range(len(step)):
        step[k] = residual[k] - taken[k]
    if among:
        multiply(complement, step, coupled)
    else:
        multiply(complement, taken, coupled)
        for k in range(len(step)):
            coupled[k] = known[k] - coupled[k]
    for k in range(len(step)):
        step[k] -= memory.stuck[k] * coupled[k]


@part
def _outside(points: Ints, values: Floats) -> float:
    """1 if there is a value at another than these points, which are sorted, else 0."""
    place = 0
    for i in range(len(values) // 3):
        if place < len(points) and points[place] == i:
            place += 1
        elif values[3 * i] != 0.0 or values[3 * i + 1] != 0.0 or values[3 * i + 2] != 0.0:
            return 1.0
    return 0.0
