# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Matrices of the joint unknowns, distributed to the ranks by rows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.common.kernels import njit
from dolfinx_joints.solvers.compliance.own_blocks import SUMS


class RowMatrix:
    """Dense matrix of the joint unknowns; each rank stores the rows of its points.

    Each column of the rank's rows is contiguous in memory, so that products with vectors that are
    mostly zero read only the necessary columns. Vectors contain the rank's unknowns; a product
    gathers the unknowns of all ranks. `whole` and `of` require a symmetric matrix.

    Args:
        columns: Columns of the rank's rows, one per array row, shape (size, local).
        comm: Communicator of the ranks.

    Attributes:
        size: Number of rows of all ranks.
        local: Number of rows of this rank.
    """

    def __init__(self, columns: Floats, comm: Any) -> None:
        """Store the columns (collective)."""
        self._columns, self._comm, self.size = columns, comm, len(columns)
        self.local = columns.shape[1]
        self._unknowns = Parts(columns.shape[1], comm)

    def product(self, values: Floats, rows: Ints) -> Floats:
        """Return the matrix times a vector with nonzero entries in some rows only (collective).

        Args:
            values: Vector of the rank, shape (local,).
            rows: Sorted local numbers of the nonzero entries.
        """
        vector = values
        if self._comm.size > 1:
            parts = Parts(len(rows), self._comm)
            vector = np.zeros(self.size)
            rows, entries = parts.all_of(rows + self._unknowns.first), parts.all_of(values[rows])
            vector[rows] = entries
        out = np.zeros(self._columns.shape[1])
        add_rows(self._columns, rows, vector, out)
        return out

    def columns(self) -> Floats:
        """Return the columns of the rank's rows, shape (size, local)."""
        return self._columns

    def whole(self) -> Floats:
        """Return the matrix, shape (size, size), on every rank (collective)."""
        if self._comm.size == 1:
            return self._columns
        return np.hstack(self._comm.allgather(self._columns))

    @classmethod
    def of(cls, whole: Floats, comm: Any, local: int) -> RowMatrix:
        """Return the distributed form of a matrix; the rank stores ``local`` rows (collective)."""
        first = Parts(local, comm).first
        return cls(np.ascontiguousarray(whole[:, first : first + local]), comm)


class Parts:
    """Parts of a vector on the ranks.

    Args:
        count: Length of this rank's part.
        comm: Communicator of the ranks.

    Attributes:
        counts: Length of each rank's part.
        first: Total length of the parts of lower ranks.
    """

    def __init__(self, count: int, comm: Any) -> None:
        """Gather the lengths (collective)."""
        self._comm = comm
        self.counts = [count] if comm.size == 1 else comm.allgather(count)
        self.first = sum(self.counts[: comm.rank])

    def all_of(self, part: NDArray[Any]) -> NDArray[Any]:
        """Return the parts of all ranks, one after the other (collective)."""
        if self._comm.size == 1:
            return part
        gathered = np.empty(sum(self.counts), part.dtype)
        self._comm.Allgatherv(np.ascontiguousarray(part), [gathered, self.counts])
        return gathered


@njit(cache=True)
def add_rows(matrix: NDArray[Any], rows: Ints, values: Floats, out: NDArray[Any]) -> None:
    """Add the given rows of a matrix, times their values, to ``out``; four rows in one pass."""
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


@njit(cache=True, fastmath=SUMS)
def multiply_lower(matrix: NDArray[Any], values: NDArray[Any], out: NDArray[Any]) -> None:
    """Write a symmetric matrix times a vector to ``out``; only the lower triangle is read.

    The three rows of a point are multiplied in one pass. All arrays have the same type.
    """
    number = matrix.dtype.type
    out[:] = number(0.0)
    for i in range(0, len(values), 3):
        r_0, r_1, r_2 = matrix[i], matrix[i + 1], matrix[i + 2]
        v_0, v_1, v_2 = values[i], values[i + 1], values[i + 2]
        sum_0, sum_1, sum_2 = number(0.0), number(0.0), number(0.0)
        for j in range(i):
            sum_0 += r_0[j] * values[j]
            sum_1 += r_1[j] * values[j]
            sum_2 += r_2[j] * values[j]
            out[j] += r_0[j] * v_0 + r_1[j] * v_1 + r_2[j] * v_2
        out[i] += sum_0 + r_0[i] * v_0 + r_1[i] * v_1 + r_2[i] * v_2
        out[i + 1] += sum_1 + r_1[i] * v_0 + r_1[i + 1] * v_1 + r_2[i + 1] * v_2
        out[i + 2] += sum_2 + r_2[i] * v_0 + r_2[i + 1] * v_1 + r_2[i + 2] * v_2
