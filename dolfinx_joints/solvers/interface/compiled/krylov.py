# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""GMRES for (I + T P) x = b with a stored part P of S or W, in single precision.

Algorithm of Saad and Schultz (1986); Newton's method corrects the error of single precision.
Vectors are divided by the norm of b. A = I + T P is close to the identity. To avoid cancellation, a
new direction is computed with A less a shift, the last diagonal entry of the Hessenberg matrix.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.kernels import njit, part
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.compliance.own_blocks import SUMS
from dolfinx_joints.solvers.interface.compiled.products import Kept, apply_blocks, multiply_part
from dolfinx_joints.solvers.interface.compiled.ranks import Ranks, sum_over

Singles = NDArray[np.float32]

# Columns of `Space.small` after the triangle.
RESIDUAL, COLUMN, COSINE, SINE, SHIFT = -1, -2, -3, -4, -5


class Space(NamedTuple):
    """Work arrays for a Krylov space, and for vectors of a set of points.

    Attributes:
        basis: Basis of the space, shape (products + 1, m).
        small: Triangle R of the rotated Hessenberg matrix; then, as columns, its diagonal, the
            sines and cosines of the rotations, the present column and the projected residual;
            shape (products + 1, products + 5).
        sums: Dot products of a direction with the other directions, shape (products + 2,).
        blocks: Blocks of the points of a set, shape (points, 3, 3).
        vectors: Vectors of the length of a set, shape (2, m).
    """

    basis: Singles
    small: Floats
    sums: Floats
    blocks: Singles
    vectors: Singles


def space_of(size: int, products: int) -> Space:
    """Return work arrays for the number of local unknowns and a number of products."""
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
    right_hand_side: Floats,
    tolerance: float,
    space: Space,
    solution: Floats,
) -> int:
    """Solve (I + T P) x = b for the part P of S; return the number of products (collective).

    Args:
        split: S.
        kept: Set of points with the part P.
        right_hand_side: b, shape (3 number,).
        tolerance: Largest residual accepted, relative to b in the 2-norm.
        space: T, as ``blocks``, and work arrays; their length limits the number of products.
        solution: Output x, shape (3 number,).
    """
    size, small, ranks, shift = len(right_hand_side), space.small, split.ranks, 0.0
    product = space.vectors[0, :size]
    norm, largest_count, count = np.sqrt(_square(ranks, right_hand_side)), len(space.basis) - 1, 0
    largest_count = min(largest_count, 3 * kept.number[1])
    if norm > 0.0:
        for k in range(size):
            space.basis[0, k] = right_hand_side[k] / norm
        small[0, RESIDUAL] = 1.0
        while count < largest_count:
            old, new = space.basis[count, :size], space.basis[count + 1, :size]
            multiply_part(split, kept, old, product)
            apply_blocks(space.blocks, product, new)
            factor = np.float32(shift)
            for k in range(size):
                new[k] += old[k] - factor * old[k]
            ended, count = _orthogonalise(space, size, count, shift, ranks), count + 1
            shift = small[count - 1, SHIFT]
            if ended or abs(small[count, RESIDUAL]) <= tolerance:
                break
        _combine(space, count, product)
    for k in range(size):
        solution[k] = norm * product[k] if norm > 0.0 else 0.0
    return count


@njit(fastmath=SUMS, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def dot(a: NDArray[Any], b: NDArray[Any]) -> Any:
    """Return a . b, summed in any order, in the precision of a and b."""
    total = a.dtype.type(0.0)
    for k in range(len(a)):
        total += a[k] * b[k]
    return total


@part
def _square(ranks: Ranks, values: Floats) -> float:
    """Return the sum of squares over the ranks (collective)."""
    total = np.array([dot(values, values)])
    sum_over(ranks, total)
    return float(total[0])


@part
def _dot_products(space: Space, size: int, j: int, ranks: Ranks) -> None:
    """Write the dot products of direction j + 1 with directions 0 to j + 1 (collective)."""
    new, products = space.basis[j + 1, :size], space.sums[: j + 2]
    for i in range(j + 2):
        products[i] = dot(space.basis[i, :size], new)
    sum_over(ranks, products)


@part
def _subtract_projections(space: Space, size: int, j: int) -> float:
    """Subtract the projections from direction j + 1; return its squared norm by Pythagoras."""
    new, products = space.basis[j + 1, :size], space.sums
    square = products[j + 1]
    for i in range(j + 1):
        old, factor = space.basis[i, :size], np.float32(products[i])
        space.small[i, COLUMN] += products[i]
        square -= products[i] * products[i]
        for k in range(size):
            new[k] -= factor * old[k]
    return square


@part
def _orthogonalise(space: Space, size: int, j: int, shift: float, ranks: Ranks) -> bool:
    """Make direction j + 1 orthogonal, and rotate its column of the Hessenberg matrix (collective).

    Return True if the direction is the last one. Directions belong to A - shift, see the module.
    """
    new, small = space.basis[j + 1, :size], space.small
    for i in range(j + 2):
        small[i, COLUMN] = 0.0
    _dot_products(space, size, j, ranks)
    square, last = space.sums[j + 1], space.sums[j]
    whole = np.sqrt(max(square + 2.0 * shift * last + shift * shift, 0.0))
    new_square = _subtract_projections(space, size, j)
    if not new_square > limits.ORTHOGONAL_REST * square:
        _dot_products(space, size, j, ranks)
        new_square = _subtract_projections(space, size, j)
    small[j, COLUMN] += shift
    small[j, SHIFT] = small[j, COLUMN]
    length = np.sqrt(max(new_square, 0.0))
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
    small[j + 1, RESIDUAL] = -s * small[j, RESIDUAL]
    small[j, RESIDUAL] *= c
    if length > 0.0:
        factor = np.float32(1.0 / length)
        for k in range(size):
            new[k] *= factor
    return not length > limits.SINGLE_ROUNDING * whole


@part
def _combine(space: Space, count: int, solution: Singles) -> None:
    """Write the solution in the present Krylov space."""
    small, size = space.small, len(solution)
    for k in range(size):
        solution[k] = np.float32(0.0)
    for i in range(count - 1, -1, -1):
        value = small[i, RESIDUAL]
        for k in range(i + 1, count):
            value -= small[i, k] * small[k, COLUMN]
        weight = value / small[i, i] if small[i, i] != 0.0 else 0.0
        small[i, COLUMN] = weight
        factor, direction = np.float32(weight), space.basis[i, :size]
        for k in range(size):
            solution[k] += factor * direction[k]
