# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""GMRES for (I + T P) x = b with a kept part P of S, in single precision (Saad and Schultz 1986).

Newton's method corrects what single precision leaves. Vectors are relative to the right-hand side.
The matrix is close to the identity: each direction is made orthogonal after the last entry on the
diagonal of the Hessenberg matrix has been subtracted, so that little cancels.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.kernels import njit, part
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.compliance.own_blocks import SUMS
from dolfinx_joints.solvers.interface.compiled.products import Kept, multiply_part, turn
from dolfinx_joints.solvers.interface.compiled.ranks import Ranks, sum_over

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

# Columns of `Space.small` behind the triangle.
LEFT, COLUMN, COSINE, SINE, SHIFT = -1, -2, -3, -4, -5


class Space(NamedTuple):
    """Room for a Krylov space of so many products, and for vectors beside it.

    Attributes:
        basis: Its directions, shape (products + 1, m).
        small: R of the Hessenberg matrix; then what is left of the right-hand side, a column of the
            Hessenberg matrix, its rotations and what is on its diagonal; shape (products + 1,
            products + 5).
        sums: Products of a direction with the others, shape (products + 2,).
        blocks: Blocks of the points of a set, shape (points, 3, 3).
        vectors: Vectors of the length of a set, shape (2, m).
    """

    basis: Singles
    small: Floats
    sums: Floats
    blocks: Singles
    vectors: Singles


def space_of(size: int, products: int) -> Space:
    """Room for m unknowns of the rank."""
    return Space(
        np.empty((products + 1, size), dtype=np.float32),
        np.zeros((products + 1, products + 5)),
        np.zeros(products + 2),
        np.empty((size // 3, 3, 3), dtype=np.float32),
        np.empty((2, size), dtype=np.float32),
    )


@part
def gmres(
    split: Any,
    kept: Kept,
    right: Floats,
    tolerance: float,
    space: Space,
    solution: Floats,
) -> int:
    """Solve (I + T P) x = b for the part P of S; the number of products (collective).

    Args:
        split: S.
        kept: The part P.
        right: b, shape (3 number,).
        tolerance: Largest residual accepted, relative to b in the 2-norm.
        space: T, as ``blocks``, and where to work; its length limits the products.
        solution: x, written to.
    """
    size, small, ranks, shift = len(right), space.small, split.ranks, 0.0
    product = space.vectors[0, :size]
    norm, most, count = np.sqrt(_square(ranks, right)), len(space.basis) - 1, 0
    most = min(most, 3 * kept.number[1])
    if norm > 0.0:
        for k in range(size):
            space.basis[0, k] = right[k] / norm
        small[0, LEFT] = 1.0
        while count < most:
            old, new = space.basis[count, :size], space.basis[count + 1, :size]
            multiply_part(split, kept, old, product)
            turn(space.blocks, product, new)
            off = np.float32(shift)
            for k in range(size):
                new[k] += old[k] - off * old[k]
            ended, count = _orthogonalise(space, size, count, shift, ranks), count + 1
            shift = small[count - 1, SHIFT]
            if ended or abs(small[count, LEFT]) <= tolerance:
                break
        _combine(space, count, product)
    for k in range(size):
        solution[k] = norm * product[k] if norm > 0.0 else 0.0
    return count


@njit(fastmath=SUMS, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def dot(a: NDArray[Any], b: NDArray[Any]) -> Any:
    """Product a . b, summed in any order, in the precision of both."""
    total = a.dtype.type(0.0)
    for k in range(len(a)):
        total += a[k] * b[k]
    return total


@part
def _square(ranks: Ranks, values: Floats) -> float:
    """Sum of squares over the ranks (collective)."""
    total = np.array([dot(values, values)])
    sum_over(ranks, total)
    return float(total[0])


@part
def _along(space: Space, size: int, j: int, ranks: Ranks) -> None:
    """Products of the direction j + 1 with those before it and itself, as sums (collective)."""
    new, found = space.basis[j + 1, :size], space.sums[: j + 2]
    for i in range(j + 2):
        found[i] = dot(space.basis[i, :size], new)
    sum_over(ranks, found)


@part
def _take_off(space: Space, size: int, j: int) -> float:
    """Take these amounts off the direction; what that leaves of its square, by Pythagoras."""
    new, found = space.basis[j + 1, :size], space.sums
    rest = found[j + 1]
    for i in range(j + 1):
        old, along = space.basis[i, :size], np.float32(found[i])
        space.small[i, COLUMN] += found[i]
        rest -= found[i] * found[i]
        for k in range(size):
            new[k] -= along * old[k]
    return rest


@part
def _orthogonalise(space: Space, size: int, j: int, shift: float, ranks: Ranks) -> bool:
    """Take up the direction j + 1 and rotate its column; whether it is the last (collective).

    Directions are those of A - shift, see above.
    """
    new, small = space.basis[j + 1, :size], space.small
    for i in range(j + 2):
        small[i, COLUMN] = 0.0
    _along(space, size, j, ranks)
    square, last = space.sums[j + 1], space.sums[j]
    whole = np.sqrt(max(square + 2.0 * shift * last + shift * shift, 0.0))
    rest = _take_off(space, size, j)
    if not rest > limits.ORTHOGONAL_REST * square:
        _along(space, size, j, ranks)
        rest = _take_off(space, size, j)
    small[j, COLUMN] += shift
    small[j, SHIFT] = small[j, COLUMN]
    length = np.sqrt(max(rest, 0.0))
    for i in range(j):
        c, s = small[i, COSINE], small[i, SINE]
        a, b = small[i, COLUMN], small[i + 1, COLUMN]
        small[i, j], small[i + 1, COLUMN] = c * a + s * b, c * b - s * a
    last = small[j, COLUMN]
    norm = np.hypot(last, length)
    if norm <= limits.SINGLE_ROUNDING * whole:  # singular: the direction would be rounding error
        norm, length = 0.0, 0.0
    c, s = (last / norm, length / norm) if norm > 0.0 else (1.0, 0.0)
    small[j, j], small[j, COSINE], small[j, SINE] = norm, c, s
    small[j + 1, LEFT] = -s * small[j, LEFT]
    small[j, LEFT] *= c
    if length > 0.0:
        each = np.float32(1.0 / length)
        for k in range(size):
            new[k] *= each
    return not length > limits.SINGLE_ROUNDING * whole


@part
def _combine(space: Space, count: int, solution: Singles) -> None:
    """The solution in the space found so far."""
    small, size = space.small, len(solution)
    for k in range(size):
        solution[k] = np.float32(0.0)
    for i in range(count - 1, -1, -1):
        rest = small[i, LEFT]
        for k in range(i + 1, count):
            rest -= small[i, k] * small[k, COLUMN]
        weight = rest / small[i, i] if small[i, i] != 0.0 else 0.0
        small[i, COLUMN] = weight
        each, direction = np.float32(weight), space.basis[i, :size]
        for k in range(size):
            solution[k] += each * direction[k]
