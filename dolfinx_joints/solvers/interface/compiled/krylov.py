# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""GMRES on a kept part of S, compiled as a whole; `solvers.interface.gmres` in one function."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.kernels import njit, part
from dolfinx_joints.solvers.interface.compiled.products import Kept, multiply_part
from dolfinx_joints.solvers.interface.gmres import ROUNDING
from dolfinx_joints.solvers.interface.low_rank import SUMS

Floats = NDArray[np.float64]


# Columns of `Space.small` behind the triangle.
LEFT, COLUMN, COSINE, SINE = -1, -2, -3, -4


class Space(NamedTuple):
    """Room for a Krylov space of so many products, and for vectors beside it.

    Attributes:
        basis: Its directions, shape (products + 1, m).
        small: R of the Hessenberg matrix; then what is left of the right-hand side, a column of the
            Hessenberg matrix, and its rotations; shape (products + 1, products + 4).
        blocks: Blocks of the points of a set, shape (points, 3, 3).
        vectors: Vectors of the length of a set, shape (4, m).
    """

    basis: Floats
    small: Floats
    blocks: Floats
    vectors: Floats


def space_of(size: int, products: int) -> Space:
    """Room for m unknowns."""
    return Space(
        np.empty((products + 1, size)),
        np.zeros((products + 1, products + 4)),
        np.empty((size // 3, 3, 3)),
        np.empty((4, size)),
    )


@part
def turn(blocks: Floats, values: Floats, out: Floats) -> None:
    """Blocks, of which there may be more, times a vector (3 n,)."""
    for i in range(len(values) // 3):
        t, a, b, c = blocks[i], values[3 * i], values[3 * i + 1], values[3 * i + 2]
        out[3 * i] = t[0, 0] * a + t[0, 1] * b + t[0, 2] * c
        out[3 * i + 1] = t[1, 0] * a + t[1, 1] * b + t[1, 2] * c
        out[3 * i + 2] = t[2, 0] * a + t[2, 1] * b + t[2, 2] * c


@part
def gmres(
    split: Any,
    kept: Kept,
    right: Floats,
    tolerance: float,
    space: Space,
    every: Floats,
    solution: Floats,
) -> int:
    """Solve (I + T P) x = b for the part P of S; the number of products.

    Args:
        split: S.
        kept: The part P.
        right: b, shape (3 count,).
        tolerance: Largest residual accepted, relative to b in the 2-norm.
        space: T, as ``blocks``, and where to work; its length limits the products.
        every: Room for a vector of all unknowns.
        solution: x, written to.
    """
    size = len(right)
    product, small = space.vectors[0, :size], space.small
    norm, most = np.sqrt(_dot(right, right)), min(len(space.basis) - 1, size)
    for k in range(size):
        solution[k] = right[k]
    if norm == 0.0 or most == 0:
        return 0
    for k in range(size):
        space.basis[0, k] = right[k] / norm
    small[0, LEFT], count = norm, 0
    for j in range(most):
        old, new = space.basis[j, :size], space.basis[j + 1, :size]
        multiply_part(split, kept, old, every, product)
        turn(space.blocks, product, new)
        for k in range(size):
            new[k] += old[k]
        ended, count = _orthogonalise(space, size, j), j + 1
        if ended or abs(small[j + 1, LEFT]) <= tolerance * norm:
            break
    _combine(space, count, solution)
    return count


@njit(fastmath=SUMS, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _dot(a: Floats, b: Floats) -> float:
    total = 0.0
    for k in range(len(a)):
        total += a[k] * b[k]
    return total


@part
def _orthogonalise(space: Space, size: int, j: int) -> bool:
    """Take up the direction j + 1 and rotate its column; whether it is the last."""
    new, small = space.basis[j + 1, :size], space.small
    whole = np.sqrt(_dot(new, new))
    for i in range(j + 2):
        small[i, COLUMN] = 0.0
    for _ in range(2):  # twice: a single pass loses orthogonality
        for i in range(j + 1):
            old = space.basis[i, :size]
            part = _dot(old, new)
            small[i, COLUMN] += part
            for k in range(size):
                new[k] -= part * old[k]
    length = np.sqrt(_dot(new, new))
    for i in range(j):
        c, s = small[i, COSINE], small[i, SINE]
        a, b = small[i, COLUMN], small[i + 1, COLUMN]
        small[i, j], small[i + 1, COLUMN] = c * a + s * b, c * b - s * a
    last = small[j, COLUMN]
    norm = np.hypot(last, length)
    if norm <= ROUNDING * whole:  # singular: what this direction would add is rounding, made large
        norm, length = 0.0, 0.0
    c, s = (last / norm, length / norm) if norm > 0.0 else (1.0, 0.0)
    small[j, j], small[j, COSINE], small[j, SINE] = norm, c, s
    small[j + 1, LEFT] = -s * small[j, LEFT]
    small[j, LEFT] *= c
    if length > 0.0:
        for k in range(size):
            new[k] /= length
    return not length > ROUNDING * whole


@part
def _combine(space: Space, count: int, solution: Floats) -> None:
    """The solution in the space found so far."""
    small, size = space.small, len(solution)
    for k in range(size):
        solution[k] = 0.0
    for i in range(count - 1, -1, -1):
        rest = small[i, LEFT]
        for k in range(i + 1, count):
            rest -= small[i, k] * small[k, COLUMN]
        weight = rest / small[i, i] if small[i, i] != 0.0 else 0.0
        small[i, COLUMN] = weight
        for k in range(size):
            solution[k] += weight * space.basis[i, k]
