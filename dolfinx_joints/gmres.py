# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""GMRES for the small systems of the joints, which differ from the identity by little."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


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
    triangle = np.zeros((most, most))
    turns = np.empty((most, 2))
    left = np.zeros(most + 1)
    basis[0], left[0] = right / size, size
    for j in range(most):
        new = apply(basis[j])
        known = basis[: j + 1]
        column = known @ new
        new -= column @ known
        again = known @ new  # once more: a single pass loses orthogonality
        new -= again @ known
        column += again
        length = float(np.sqrt(new @ new))
        for i in range(j):
            c, s = turns[i]
            column[i], column[i + 1] = (
                c * column[i] + s * column[i + 1],
                c * column[i + 1] - s * column[i],
            )
        norm = float(np.hypot(column[j], length))
        if norm == 0.0:
            return _combined(basis, triangle, left, j), j + 1
        turns[j] = column[j] / norm, length / norm
        triangle[: j + 1, j] = column
        triangle[j, j] = norm
        left[j + 1] = -turns[j, 1] * left[j]
        left[j] *= turns[j, 0]
        if abs(left[j + 1]) <= tolerance * size or length == 0.0:
            return _combined(basis, triangle, left, j + 1), j + 1
        basis[j + 1] = new / length
    return _combined(basis, triangle, left, most), most


def _combined(basis: Floats, triangle: Floats, left: Floats, count: int) -> Floats:
    """The solution in the space found so far."""
    weights = np.zeros(count)
    for i in range(count - 1, -1, -1):
        weights[i] = (left[i] - triangle[i, i + 1 : count] @ weights[i + 1 :]) / triangle[i, i]
    return weights @ basis[:count]
