# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""GMRES for the small systems of the joints, which differ from the identity by little."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.kernels import njit
from dolfinx_joints.common.mpi import summed

Floats = NDArray[np.float64]

# What is left of a direction that depends on the others, relative to it.
ROUNDING = 1e-14

# Part of its square that a direction keeps where once is enough to make it orthogonal.
AGAIN = 0.01


def gmres(
    apply: Callable[[Floats], Floats],
    right: Floats,
    *,
    tolerance: float,
    most: int,
    comm: Any,
) -> tuple[Floats, int]:
    """Solve A x = b from x = 0 without restarts (Saad and Schultz 1986).

    The ranks wait for each other once in a product, apart from what ``apply`` does: norms follow
    from the sums that make directions orthogonal. These are of (A - h) v, h the last entry on the
    diagonal, so that for A near the identity little goes by that; where most of a direction goes,
    it is made orthogonal once more.

    Args:
        apply: A times a vector.
        right: b, the rank's part of it, shape (n,).
        tolerance: Largest residual accepted, relative to b in the 2-norm.
        most: Products spent at most; the best solution found is then returned.
        comm: Communicator of the ranks.

    Returns:
        The rank's part of x, and the number of products (collective).
    """
    square, count = summed(comm, np.array([right @ right, len(right)], dtype=np.float64))
    size, most = float(np.sqrt(square)), min(most, int(count))
    if size == 0.0 or most == 0:
        return right.copy(), 0
    basis = np.empty((most + 1, len(right)))
    triangle, turns = np.zeros((most, most)), np.empty((most, 2))
    left, shift = np.zeros(most + 1), 0.0
    basis[0], left[0] = right / size, size
    for j in range(most):
        new = apply(basis[j]) - shift * basis[j]
        column = summed(comm, _along(basis, new, j))
        rest = _taken_off(basis, new, column, j)
        whole = np.sqrt(max(column[j + 1] + 2.0 * shift * column[j] + shift * shift, 0.0))
        if not rest > AGAIN * column[j + 1]:
            more = summed(comm, _along(basis, new, j))
            rest = _taken_off(basis, new, more, j)
            column[: j + 1] += more[: j + 1]
        column[j] += shift
        shift = column[j]
        column[j + 1] = np.sqrt(max(rest, 0.0))
        ended = _rotated(triangle, turns, left, column, whole, j)
        if ended or abs(left[j + 1]) <= tolerance * size:
            break
        basis[j + 1] = new / column[j + 1]
    return _combined(basis, triangle, left, j + 1), j + 1


@njit(cache=True)
def _along(basis: Floats, new: Floats, j: int) -> Floats:
    """Products of a direction with the j + 1 of the basis, and with itself, of this rank."""
    found = np.zeros(j + 2)
    for i in range(j + 1):
        for k in range(len(new)):
            found[i] += basis[i, k] * new[k]
    for k in range(len(new)):
        found[j + 1] += new[k] * new[k]
    return found


@njit(cache=True)
def _taken_off(basis: Floats, new: Floats, column: Floats, j: int) -> float:
    """Take amounts of the basis off a direction; what that leaves of its square, by Pythagoras."""
    rest = column[j + 1]
    for i in range(j + 1):
        rest -= column[i] * column[i]
        for k in range(len(new)):
            new[k] -= column[i] * basis[i, k]
    return rest


@njit(cache=True)
def _rotated(
    triangle: Floats, turns: Floats, left: Floats, column: Floats, whole: float, j: int
) -> bool:
    """Rotate a column of the Hessenberg matrix; whether its direction is the last."""
    length = column[j + 1]
    for i in range(j):
        c, s = turns[i]
        a, b = column[i], column[i + 1]
        column[i], column[i + 1] = c * a + s * b, c * b - s * a
    norm = np.hypot(column[j], length)
    if norm <= ROUNDING * whole:  # singular: what this direction would add is rounding, made large
        norm, length = 0.0, 0.0
    turns[j, 0], turns[j, 1] = (column[j] / norm, length / norm) if norm > 0.0 else (1.0, 0.0)
    column[j] = norm
    triangle[: j + 1, j] = column[: j + 1]
    left[j + 1] = -turns[j, 1] * left[j]
    left[j] *= turns[j, 0]
    return not length > ROUNDING * whole


@njit(cache=True)
def _combined(basis: Floats, triangle: Floats, left: Floats, count: int) -> Floats:
    """The solution in the space found so far."""
    weights, solution = np.zeros(count), np.zeros(basis.shape[1])
    for i in range(count - 1, -1, -1):
        rest = left[i]
        for k in range(i + 1, count):
            rest -= triangle[i, k] * weights[k]
        weights[i] = rest / triangle[i, i] if triangle[i, i] != 0.0 else 0.0
        solution += weights[i] * basis[i]
    return solution
