# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Matrices over the joint unknowns, spread over the ranks."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.kernels import njit

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]


class RowMatrix:
    """A matrix over the joint unknowns, of which a rank keeps its own rows, column by column.

    Each column of the rank's rows is contiguous in memory: products with vectors that are mostly
    zero read only what they need. Taken or given as a whole, the matrix must be symmetric.

    Args:
        columns: Columns of the rank's rows, one after the other, shape (size, local).
        comm: Communicator of the ranks.

    Attributes:
        size: Number of rows.
        nbytes: Memory of the rank's rows [bytes].
    """

    def __init__(self, columns: Floats, comm: Any) -> None:
        """Keep them."""
        self._columns, self._comm, self.size = columns, comm, len(columns)
        self.nbytes = columns.nbytes
        stop = comm.scan(columns.shape[1])
        self._mine = (stop - columns.shape[1], stop)
        self._widest = max(comm.allgather(columns.shape[1]))

    def product(self, values: Floats, rows: Rows) -> Floats:
        """Times a vector that is zero but for some rows, shape (size,) (collective)."""
        mine = np.zeros(self._columns.shape[1])
        add_rows(self._columns, rows, values, mine)
        return gathered(self._comm, mine)

    def block(self, rows: Rows) -> Block:
        """The part of some rows, sorted, and the same columns (collective)."""
        first, last = np.searchsorted(rows, self._mine)
        here = rows[first:last] - self._mine[0]
        return Block(_picked(self._columns, rows, here), self._comm)

    def cost(self, rows: int) -> float:
        """Entries that a product with so many nonzero values reads."""
        return float(rows * self._widest)

    def whole(self) -> Floats:
        """The matrix, shape (size, size) (collective)."""
        if self._comm.size == 1:
            return self._columns
        return np.hstack(self._comm.allgather(self._columns))

    @classmethod
    def of(cls, whole: Floats, comm: Any) -> RowMatrix:
        """A matrix given as a whole, in columns of about equal numbers of points."""
        points = np.linspace(0, len(whole) // 3, comm.size + 1).astype(np.int64)
        part = whole[:, 3 * points[comm.rank] : 3 * points[comm.rank + 1]]
        return cls(np.ascontiguousarray(part), comm)


class Block:
    """A square part of a `RowMatrix`."""

    def __init__(self, columns: Floats, comm: Any) -> None:
        """Keep the columns of the rank's rows."""
        self._columns, self._comm = columns, comm

    def product(self, values: Floats) -> Floats:
        """The part times a vector of its size (collective)."""
        return gathered(self._comm, values @ self._columns)


def gathered(comm: Any, mine: Floats) -> Floats:
    """Parts of all ranks, one after the other (collective)."""
    return mine if comm.size == 1 else np.concatenate(comm.allgather(mine))


@njit(cache=True)
def add_rows(matrix: NDArray[Any], rows: Rows, values: Floats, out: NDArray[Any]) -> None:
    """Add some rows of a matrix times their values; four at a time pass over ``out`` once."""
    k, number = 0, matrix.dtype.type
    while k + 4 <= len(rows):
        r_0, r_1 = matrix[rows[k]], matrix[rows[k + 1]]
        r_2, r_3 = matrix[rows[k + 2]], matrix[rows[k + 3]]
        v_0, v_1 = number(values[rows[k]]), number(values[rows[k + 1]])
        v_2, v_3 = number(values[rows[k + 2]]), number(values[rows[k + 3]])
        for j in range(len(out)):
            out[j] += v_0 * r_0[j] + v_1 * r_1[j] + v_2 * r_2[j] + v_3 * r_3[j]
        k += 4
    while k < len(rows):
        row, value = matrix[rows[k]], number(values[rows[k]])
        for j in range(len(out)):
            out[j] += value * row[j]
        k += 1


@njit(cache=True)
def _picked(matrix: Floats, rows: Rows, columns: Rows) -> Floats:
    """matrix[rows][:, columns] without the copy between."""
    part = np.empty((len(rows), len(columns)))
    for i in range(len(rows)):
        line = matrix[rows[i]]
        for j in range(len(columns)):
            part[i, j] = line[columns[j]]
    return part
