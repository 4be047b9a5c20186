# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""GMRES for the small systems of the joints, which differ from the identity by little."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.kernels import njit

Floats = NDArray[np.float64]

# What is left of a direction that depends on the others, relative to it.
ROUNDING = 1e-14


def gmres(
    apply: Callable[[Floats], Floats], right: Floats, *, tolerance: float, most: int
) -> tuple[Floats, int]:
    """Solve A x = b from x = 0 without restarts (Saad and Schultz 1986).

    Args:
        apply: A times a vector; the same on every rank.
        right: b, shape (n,).
        tolerance: Largest residual accepted, relative to b in the 2-norm.
        most: Products spent at most; the best solution found is then returned.

    Returns:
        x, and the number of products.
    """
    size = float(np.sqrt(right @ right))
    most = min(most, len(right))
    if size == 0.0 or most == 0:
        return right.copy(), 0
    basis = np.empty((most + 1, len(right)))
    triangle, turns = np.zeros((most, most)), np.empty((most, 2))
    left = np.zeros(most + 1)
    basis[0], left[0] = right / size, size
    for j in range(most):
        ended = _orthogonalise(basis, triangle, turns, left, apply(basis[j]), j)
        if ended or abs(left[j + 1]) <= tolerance * size:
            break
    return _combined(basis, triangle, left, j + 1), j + 1


@njit(cache=True)
def _orthogonalise(
    basis: Floats, triangle: Floats, turns: Floats, left: Floats, new: Floats, j: int
) -> bool:
    """Add a direction and rotate its column of the Hessenberg matrix; whether it is the last."""
    column = np.zeros(j + 2)
    whole = np.sqrt((new * new).sum())
    for _ in range(2):  # twice: a single pass loses orthogonality
        for i in range(j + 1):
            part = 0.0
            for k in range(len(new)):
                part += basis[i, k] * new[k]
            column[i] += part
            for k in range(len(new)):
                new[k] -= part * basis[i, k]
    length = np.sqrt((new * new).sum())
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
    triangle[: j + 1, j] = column[: j + 1]
    left[j + 1] = -turns[j, 1] * left[j]
    left[j] *= turns[j, 0]
    if length > 0.0:
        basis[j + 1] = new / length
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
