# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton's corrections of the joint forces, (I + T S) d = r, as in `interface.corrections`."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.kernels import njit
from dolfinx_joints.solvers.interface.compiled.krylov import Space, gmres, turn
from dolfinx_joints.solvers.interface.compiled.products import (
    Dense,
    Kept,
    cost,
    hold,
    multiply,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# Products that a correction takes as a rule; a change of T (between 0 and 1) that is none.
PRODUCTS, SAME = 15, 1e-12


class Memory(NamedTuple):
    """What corrections keep from one to the next, and room to work in.

    Attributes:
        active: Set of the active points.
        changed: Set of the points that do not stick, with their part of W.
        tied: W, of size zero before it is made.
        stuck: T0, shape (m,), empty where there is no W to be had.
        missed: Entries that W would have saved to be read so far, shape (1,).
        finest: Tolerance that systems of active points are solved to at best.
        space: Room for GMRES.
        step: d, the correction, shape (m,).
        coupled: S d.
        vectors: Room for four more, shape (4, m).
        numbers: Room for numbers of rows, shape (m,).
        found: Room for numbers of points, shape (2, n).
    """

    active: Kept
    changed: Kept
    tied: Dense
    stuck: Floats
    missed: Floats
    finest: float
    space: Space
    step: Floats
    coupled: Floats
    vectors: Floats
    numbers: Ints
    found: Ints


@njit(cache=True)
def correct(
    split: Any,
    inner: Any,
    residual: Floats,
    tangent: Floats,
    least: float,
    tolerance: float,
    memory: Memory,
) -> int:
    """Write d and S d to the memory; the number of products.

    Args:
        split: S.
        inner: S inside the system of active points.
        residual: r, shape (m,).
        tangent: T, shape (points, 3, 3).
        least: Entries of r up to this one are left as they are.
        tolerance: Of the residual, relative to r.
        memory: What is kept.
    """
    left, loaded = memory.vectors[0], 0
    for k in range(len(residual)):
        left[k] = residual[k] if abs(residual[k]) > least else 0.0
        loaded += left[k] != 0.0
    active = _differing(tangent, memory.stuck, False, memory.found[0])
    if len(memory.stuck):
        changed = _differing(tangent, memory.stuck, True, memory.found[1])
        unknowns, others, size = 3 * len(active), 3 * len(changed), len(residual)
        systems = min(float(unknowns) ** 2, cost(inner, unknowns))
        first = PRODUCTS * systems + cost(split, unknowns)
        second = PRODUCTS * float(others) ** 2 + float(loaded + others) * size
        if second < first:
            if len(memory.tied.rows):
                return _correct_changed(left, tangent, changed, tolerance, memory)
            memory.missed[0] += first - second
    return _correct_active(split, inner, left, tangent, active, tolerance, memory)


@njit(cache=True)
def _differing(tangent: Floats, stuck: Floats, from_stuck: bool, found: Ints) -> Ints:
    """Points whose block differs from zero, or from T0."""
    count = 0
    for i in range(len(tangent)):
        differs, same = False, SAME if from_stuck else 0.0
        for a in range(3):
            for b in range(3):
                expected = stuck[3 * i + a] if a == b and from_stuck else 0.0
                differs = differs or not abs(tangent[i, a, b] - expected) <= same
        if differs:
            found[count] = i
            count += 1
    return found[:count]


@njit(cache=True)
def _correct_active(
    split: Any,
    inner: Any,
    residual: Floats,
    tangent: Floats,
    active: Ints,
    tolerance: float,
    memory: Memory,
) -> int:
    """The system of the active points; the others' corrections are their residuals."""
    kept, space, step, coupled = memory.active, memory.space, memory.step, memory.coupled
    hold(inner, kept, active)
    points = kept.points[: kept.count[0]]
    size = 3 * len(points)
    right, moved, found = space.vectors[1, :size], space.vectors[2, :size], space.vectors[3, :size]
    step[:], coupled[:], others = residual, 0.0, False
    for i in range(len(points)):
        space.blocks[i] = tangent[points[i]]
        for a in range(3):
            right[3 * i + a], step[3 * points[i] + a] = residual[3 * points[i] + a], 0.0
    for k in range(len(step)):
        others = others or step[k] != 0.0
    if others:
        multiply(split, step, memory.numbers, coupled)
        for i in range(len(points)):
            for a in range(3):
                found[3 * i + a] = coupled[3 * points[i] + a]
        turn(space.blocks[: len(points)], found, moved)
        for k in range(size):
            right[k] -= moved[k]
    tolerance = max(tolerance, memory.finest)
    products = gmres(inner, kept, True, right, tolerance, space, memory.vectors[1], found)
    here, caused = memory.vectors[2], memory.vectors[3]
    here[:] = 0.0
    for i in range(len(points)):
        for a in range(3):
            here[3 * points[i] + a] = found[3 * i + a]
    multiply(split, here, memory.numbers, caused)
    for k in range(len(step)):
        step[k] += here[k]
        coupled[k] += caused[k]
    return products


@njit(cache=True)
def _correct_changed(
    residual: Floats, tangent: Floats, changed: Ints, tolerance: float, memory: Memory
) -> int:
    """The system of the points that do not stick: q = r - E y, d = q - T0 W q, S d = W q."""
    kept, space, tied, stuck = memory.changed, memory.space, memory.tied, memory.stuck
    step, coupled, taken, known = memory.step, memory.coupled, memory.vectors[2], memory.vectors[3]
    hold(tied, kept, changed)
    points = kept.points[: kept.count[0]]
    size, products = 3 * len(points), 0
    right, turned, found = space.vectors[1, :size], space.vectors[2, :size], space.vectors[3, :size]
    multiply(tied, residual, memory.numbers, known)
    taken[:], coupled[:] = 0.0, 0.0
    if size:
        for i in range(len(points)):
            space.blocks[i] = tangent[points[i]]
            for a in range(3):
                k = 3 * points[i] + a
                space.blocks[i, a, a] -= stuck[k]
                right[3 * i + a] = known[k]
        products = gmres(tied, kept, False, right, tolerance, space, memory.vectors[1], found)
        turn(space.blocks[: len(points)], found, turned)
        for i in range(len(points)):
            for a in range(3):
                taken[3 * points[i] + a] = turned[3 * i + a]
        multiply(tied, taken, memory.numbers, coupled)
    for k in range(len(step)):
        coupled[k] = known[k] - coupled[k]
        step[k] = residual[k] - taken[k] - stuck[k] * coupled[k]
    return products
