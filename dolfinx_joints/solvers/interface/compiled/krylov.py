# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""GMRES on a kept part of S, compiled as a whole; `solvers.interface.gmres` in one function."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.kernels import njit
from dolfinx_joints.solvers.interface.compiled.products import Kept, multiply_part
from dolfinx_joints.solvers.interface.gmres import ROUNDING
from dolfinx_joints.solvers.interface.low_rank import SUMS

Floats = NDArray[np.float64]


class Space(NamedTuple):
    """Room for a Krylov space of so many products, and for vectors beside it.

    Attributes:
        basis: Its directions, shape (products + 1, m).
        triangle: R of the Hessenberg matrix, shape (products, products).
        turns: Its rotations, shape (products, 2).
        left: What is left of the right-hand side, shape (products + 1,).
        column: A column of the Hessenberg matrix, shape (products + 1,).
        blocks: Blocks of the points of a set, shape (points, 3, 3).
        vectors: Vectors of the length of a set, shape (4, m).
    """

    basis: Floats
    triangle: Floats
    turns: Floats
    left: Floats
    column: Floats
    blocks: Floats
    vectors: Floats


def space_of(size: int, products: int) -> Space:
    """Room for m unknowns."""
    return Space(
        np.empty((products + 1, size)),
        np.zeros((products, products)),
        np.empty((products, 2)),
        np.zeros(products + 1),
        np.empty(products + 1),
        np.empty((size // 3, 3, 3)),
        np.empty((4, size)),
    )


@njit(cache=True)
def turn(blocks: Floats, values: Floats, out: Floats) -> None:
    """Blocks (n, 3, 3) times a vector (3 n,)."""
    for i in range(len(blocks)):
        t, a, b, c = blocks[i], values[3 * i], values[3 * i + 1], values[3 * i + 2]
        out[3 * i] = t[0, 0] * a + t[0, 1] * b + t[0, 2] * c
        out[3 * i + 1] = t[1, 0] * a + t[1, 1] * b + t[1, 2] * c
        out[3 * i + 2] = t[2, 0] * a + t[2, 1] * b + t[2, 2] * c


@njit(cache=True)
def gmres(
    split: Any,
    kept: Kept,
    blocks_last: bool,
    right: Floats,
    tolerance: float,
    space: Space,
    every: Floats,
    solution: Floats,
) -> int:
    """Solve (I + T P) x = b, or (I + P T) x = b, for the part P of S; the number of products.

    Args:
        split: S.
        kept: The part P.
        blocks_last: Whether T, which is ``space.blocks``, is applied after P, or before it.
        right: b, shape (3 count,).
        tolerance: Largest residual accepted, relative to b in the 2-norm.
        space: Where to work; its length limits the products.
        every: Room for a vector of all unknowns.
        solution: x, written to.
    """
    size = len(right)
    blocks, product = space.blocks[: size // 3], space.vectors[0, :size]
    norm, most = np.sqrt(_dot(right, right)), min(len(space.basis) - 1, size)
    solution[:] = right
    if norm == 0.0 or most == 0:
        return 0
    first = space.basis[0, :size]
    for k in range(size):
        first[k] = right[k] / norm
    space.left[0], count = norm, 0
    for j in range(most):
        old, new = space.basis[j, :size], space.basis[j + 1, :size]
        if blocks_last:
            multiply_part(split, kept, old, every, product)
            turn(blocks, product, new)
        else:
            turn(blocks, old, product)
            multiply_part(split, kept, product, every, new)
        for k in range(size):
            new[k] += old[k]
        ended, count = _orthogonalise(space, size, j), j + 1
        if ended or abs(space.left[j + 1]) <= tolerance * norm:
            break
    _combine(space, count, solution)
    return count


@njit(cache=True, fastmath=SUMS)
def _dot(a: Floats, b: Floats) -> float:
    total = 0.0
    for k in range(len(a)):
        total += a[k] * b[k]
    return total


@njit(cache=True)
def _orthogonalise(space: Space, size: int, j: int) -> bool:
    """Take up the direction j + 1 and rotate its column; whether it is the last."""
    new, column, turns = space.basis[j + 1, :size], space.column, space.turns
    whole = np.sqrt(_dot(new, new))
    column[: j + 2] = 0.0
    for _ in range(2):  # twice: a single pass loses orthogonality
        for i in range(j + 1):
            old = space.basis[i, :size]
            part = _dot(old, new)
            column[i] += part
            for k in range(size):
                new[k] -= part * old[k]
    length = np.sqrt(_dot(new, new))
    column[j + 1] = length
    for i in range(j):
        c, s = turns[i]
        a, b = column[i], column[i + 1]
        column[i], column[i + 1] = c * a + s * b, c * b - s * a
    norm = np.hypot(column[j], length)
    if norm <= ROUNDING * whole:  # singular: what this direction would add is rounding, made large
        norm, length = 0.0, 0.0
    turns[j, 0], turns[j, 1] = (column[j] / norm, length / norm) if norm > 0.0 else (1.0, 0.0)
    column[j] = norm
    space.triangle[: j + 1, j] = column[: j + 1]
    space.left[j + 1] = -turns[j, 1] * space.left[j]
    space.left[j] *= turns[j, 0]
    if length > 0.0:
        for k in range(size):
            new[k] /= length
    return not length > ROUNDING * whole


@njit(cache=True)
def _combine(space: Space, count: int, solution: Floats) -> None:
    """The solution in the space found so far."""
    weights, size = space.column, len(solution)
    solution[:] = 0.0
    for i in range(count - 1, -1, -1):
        rest = space.left[i]
        for k in range(i + 1, count):
            rest -= space.triangle[i, k] * weights[k]
        pivot, direction = space.triangle[i, i], space.basis[i, :size]
        weights[i] = rest / pivot if pivot != 0.0 else 0.0
        for k in range(size):
            solution[k] += weights[i] * direction[k]
