# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Deflation of GMRES by what moves the joints together: the largest eigenvalues of S.

Of (I + T P) x = b, where P is the part of S of a set of points, S = U diag(lambda) U^T + rest with
few columns in U takes the products: those far from one. P is solved for it by

    (I + T U L U^T)^-1 = I - T U (L^-1 + U^T T U)^-1 U^T,        L = diag(lambda),

with the rows of U of the set, as a preconditioner from the right.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from dolfinx_joints.common.kernels import njit, part
from dolfinx_joints.solvers.interface.compiled.products import Kept, turn
from dolfinx_joints.solvers.interface.compiled.ranks import Ranks, sum_over
from dolfinx_joints.solvers.interface.compliance import Split
from dolfinx_joints.solvers.interface.low_rank import SUMS

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

# Eigenvalues taken; more save fewer products than they cost (measured in docs/decisions).
VECTORS = 24

# Eigenvalues that take no products.
SMALLEST = 0.1

# Sets of fewer than this part of the points need few products without.
LEAST_SHARE = 0.4


class Deflation(NamedTuple):
    """The largest eigenvalues of S, and room for their vectors on a set.

    Attributes:
        points: Points of all ranks.
        vectors: U of the rank's unknowns, shape (k, m), k = 0 before it is known.
        inverse: 1 / lambda, shape (k,).
        here: Room for U on a set, shape (k, m).
        turned: Room for T U on a set, likewise.
        small: (L^-1 + U^T T U)^-1, shape (k, k).
        amounts: Room for two vectors, shape (2, k).
    """

    points: int
    vectors: Singles
    inverse: Floats
    here: Singles
    turned: Singles
    small: Floats
    amounts: Floats


def deflation_of(split: Split | None, comm: Any) -> Deflation:
    """The largest eigenvalues of a symmetric S; none of None (collective)."""
    size, local = (0, 0) if split is None else (split.size, split.local)
    values: Floats = np.empty(0)
    vectors: Singles = np.empty((0, local), dtype=np.float32)
    if split is not None and size > 4 * VECTORS:
        values, vectors = _largest(split, comm)
    return Deflation(
        size // 3,
        vectors,
        np.reciprocal(values),
        np.empty_like(vectors),
        np.empty_like(vectors),
        np.empty((len(values), len(values))),
        np.empty((2, len(values))),
    )


def _largest(split: Split, comm: Any) -> tuple[Floats, Singles]:
    """Eigenvalues and the rank's part of their vectors, shape (k, m) (collective).

    Rank 0 searches and hands out what is to be multiplied, None at the end: ranks whose rounding
    differs could not search alike.
    """
    rows, ends = np.arange(split.local), np.cumsum(comm.allgather(split.local))[:-1]
    if comm.rank > 0:
        while (part := comm.scatter(None)) is not None:
            comm.gather(split.product(part, rows))
        found: tuple[Floats, Singles] = comm.scatter(None)
        return found

    def multiply(x: Floats) -> Floats:
        part = comm.scatter(np.split(x.ravel(), ends))
        return np.concatenate(comm.gather(split.product(part, rows)))

    values, every = np.empty(0), np.empty((split.size, 0))
    product = LinearOperator((split.size, split.size), matvec=multiply, dtype=np.float64)
    # Without it steps take longer and nothing else: where S is zero, or the search fails.
    with suppress(ArpackError):
        values, every = eigsh(product, k=VECTORS, which="LA", v0=np.ones(split.size), tol=1e-3)
    comm.scatter([None] * comm.size)
    large = values > SMALLEST
    vectors = np.split(np.ascontiguousarray(every[:, large], dtype=np.float32), ends)
    return comm.scatter([(values[large], np.ascontiguousarray(part.T)) for part in vectors])


@njit(fastmath=SUMS, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def dot(a: NDArray[Any], b: NDArray[Any]) -> Any:
    """Product a . b, summed in any order, in the precision of both."""
    total = a.dtype.type(0.0)
    for k in range(len(a)):
        total += a[k] * b[k]
    return total


@part
def prepare(deflation: Deflation, kept: Kept, blocks: Singles, ranks: Ranks) -> bool:
    """Set up the preconditioner of a set with its blocks of T; whether it pays (collective)."""
    count, points = kept.number[0], kept.points
    if not len(deflation.vectors) or kept.number[1] < LEAST_SHARE * deflation.points:
        return False
    many, size = len(deflation.vectors), 3 * count
    here, turned = _rows(deflation.here, size), _rows(deflation.turned, size)
    for v in range(many):
        vector = deflation.vectors[v]
        for i in range(count):
            for a in range(3):
                here[v, 3 * i + a] = vector[3 * points[i] + a]
        turn(blocks, here[v], turned[v])
    small = deflation.small
    small[:] = np.dot(here, turned.T)
    sum_over(ranks, small.reshape(-1))
    for v in range(len(small)):
        small[v, v] += deflation.inverse[v]
    return _invert(small)


@part
def _rows(room: Singles, size: int) -> Singles:
    """Rows of this length, one after the other in the room."""
    return room.reshape(-1)[: len(room) * size].reshape(len(room), size)


@part
def _invert(matrix: Floats) -> bool:
    """Replace a small matrix by its inverse (Gauss and Jordan, no pivots); whether it has one."""
    for p in range(len(matrix)):
        pivot = matrix[p, p]
        if not abs(pivot) > 0.0:
            return False
        matrix[p, p] = 1.0
        for k in range(len(matrix)):
            matrix[p, k] /= pivot
        for i in range(len(matrix)):
            factor = matrix[i, p]
            if i != p and factor != 0.0:
                matrix[i, p] = 0.0
                for k in range(len(matrix)):
                    matrix[i, k] -= factor * matrix[p, k]
    return True


@part
def deflate(deflation: Deflation, values: Singles, out: Singles, ranks: Ranks) -> None:
    """Values less T U (L^-1 + U^T T U)^-1 U^T values (collective)."""
    size, amounts = len(values), deflation.amounts
    here, turned = _rows(deflation.here, size), _rows(deflation.turned, size)
    for v in range(len(here)):
        amounts[0, v] = dot(here[v], values)
    sum_over(ranks, amounts[0])
    for k in range(size):
        out[k] = values[k]
    for v in range(len(here)):
        amount, away = np.float32(dot(deflation.small[v], amounts[0])), turned[v]
        for k in range(size):
            out[k] -= amount * away[k]
