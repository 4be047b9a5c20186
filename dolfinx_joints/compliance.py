# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compliance of the structure at the joint points, G = B A^-1 B^T, scaled to a unit diagonal.

With s the root of a point's own compliance, forces count as f = s F and gaps as g / s, both in
[J^(1/2)], so that G becomes I + S with small entries S, which is what the joints' iteration needs.
A vector of all points is the same on every rank; a rank keeps the rows of S of its own points.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.linear import BLOCK, EffectiveMatrix

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]


class DenseCompliance:
    """All of S, from one back-substitution per joint unknown.

    Args:
        effective: The bulk, A.
        operator: B with zero columns at constrained dofs, three rows per joint point.
        areas: Of the rank's points, shape (n,), [m^2].
        largest: Own compliance to be used at most, shape (n,), [m/Pa].

    Attributes:
        effective: The bulk, A.
        own: Compliance of each local point on its own area, normal and tangential (the mean of
            the directions in which it can move), shape (n, 2), [m/Pa].
        scale: s, three per point of all ranks, 1 where a point cannot move, [(m/N)^(1/2)].
        split: S.
        dead: Directions in which a point cannot move, such as the third in a plane, all ranks,
            shape (points, 3).
        size: Number of unknowns, three per point.
    """

    def __init__(
        self,
        effective: EffectiveMatrix,
        operator: PETSc.Mat,
        areas: Floats,
        largest: Floats | None = None,
    ) -> None:
        """Solve for each unit force (collective)."""
        self.effective = effective
        self._comm = operator.comm.tompi4py()
        self.size = operator.getSize()[0]
        start, stop = operator.getOwnershipRange()
        columns = np.empty((self.size, stop - start))
        for block, gaps in _unit_forces(effective, operator):
            columns[block] = gaps.T
        diagonal = columns[np.arange(start, stop), np.arange(stop - start)]
        self._scale(diagonal.reshape(-1, 3), areas, largest)
        columns /= self.scale[:, None]
        columns /= self.scale[start:stop]
        columns[np.arange(start, stop), np.arange(stop - start)] -= 1.0
        columns[self.dead.ravel()] = 0.0
        self.split = RowMatrix(columns, self._comm)

    def _scale(self, each: Floats, areas: Floats, largest: Floats | None) -> None:
        """Own compliances from those in each direction, shape (n, 3), [m/N]."""
        live = np.maximum(np.count_nonzero(each[:, 1:] > 0.0, axis=1), 1)
        own = np.column_stack([each[:, 0], (each[:, 1] + each[:, 2]) / live])
        if largest is not None:
            own = np.minimum(own, (largest / areas)[:, None])
        self.own = areas[:, None] * own
        roots = np.where(each > 0.0, np.sqrt(np.repeat(own, (1, 2), axis=1)), 0.0)
        every = np.concatenate(self._comm.allgather(roots))
        self.dead = every == 0.0
        self.scale = np.where(self.dead, 1.0, every).ravel()

    def destroy(self) -> None:
        """Free the bulk's matrices and factor."""
        self.effective.destroy()


class RowMatrix:
    """A symmetric matrix over the joint unknowns, of which a rank keeps its own columns.

    By symmetry a column of the rank's part is a row of the matrix, contiguous in memory: products
    with vectors that are mostly zero read only what they need.

    Args:
        columns: The rank's columns, shape (size, local).
        comm: Communicator of the ranks.

    Attributes:
        size: Number of rows.
    """

    def __init__(self, columns: Floats, comm: Any) -> None:
        """Keep them."""
        self._columns, self._comm, self.size = columns, comm, len(columns)
        stop = comm.scan(columns.shape[1])
        self._mine = (stop - columns.shape[1], stop)

    def product(self, values: Floats, rows: Rows) -> Floats:
        """Times a vector that is zero but for some rows, shape (size,) (collective)."""
        mine = np.zeros(self._columns.shape[1])
        _add_rows(self._columns, rows, values[rows], mine)
        return _gathered(self._comm, mine)

    def block(self, rows: Rows) -> Block:
        """The part of some rows, sorted, and the same columns (collective)."""
        first, last = np.searchsorted(rows, self._mine)
        here = rows[first:last] - self._mine[0]
        return Block(_picked(self._columns, rows, here), self._comm)

    def whole(self) -> Floats:
        """The matrix, shape (size, size) (collective)."""
        if self._comm.size == 1:
            return self._columns
        return np.hstack(self._comm.allgather(self._columns))

    def like(self, whole: Floats) -> RowMatrix:
        """Another matrix, given as a whole, kept in the same way."""
        part = whole[:, slice(*self._mine)]
        return RowMatrix(np.ascontiguousarray(part), self._comm)


class Block:
    """A square part of a `RowMatrix`."""

    def __init__(self, columns: Floats, comm: Any) -> None:
        """Keep the rank's columns."""
        self._columns, self._comm = columns, comm

    def product(self, values: Floats) -> Floats:
        """The part times a vector of its size (collective)."""
        return _gathered(self._comm, values @ self._columns)


def _gathered(comm: Any, mine: Floats) -> Floats:
    return mine if comm.size == 1 else np.concatenate(comm.allgather(mine))


def _unit_forces(effective: EffectiveMatrix, operator: PETSc.Mat) -> Iterator[tuple[slice, Floats]]:
    """Gaps at the rank's points under unit forces, block by block of the unknowns (collective)."""
    transposed = operator.transpose(PETSc.Mat())
    starts, numbers, entries = transposed.getValuesCSR()
    lines = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    order = np.argsort(numbers, kind="stable")
    lines, numbers, entries = lines[order], numbers[order], entries[order]
    local = operator.getLocalSize()[1]
    for first in range(0, operator.getSize()[0], BLOCK):
        last = min(first + BLOCK, operator.getSize()[0])
        part = slice(*np.searchsorted(numbers, (first, last)))
        right = np.zeros((local, last - first))
        right[lines[part], numbers[part] - first] = entries[part]
        moved = effective.solver.solve_block(right)
        size = (operator.getSizes()[1], (PETSc.DECIDE, last - first))
        dense = PETSc.Mat().createDense(size, array=np.asfortranarray(moved), comm=operator.comm)
        gaps = operator.matMult(dense)
        yield slice(first, last), gaps.getDenseArray(readonly=True)
        gaps.destroy()
        dense.destroy()
    transposed.destroy()


@njit(cache=True)
def _add_rows(matrix: Floats, rows: Rows, values: Floats, out: Floats) -> None:
    """Add up the rows of a matrix times values; four at a time pass over ``out`` once."""
    k = 0
    while k + 4 <= len(rows):
        r_0, r_1 = matrix[rows[k]], matrix[rows[k + 1]]
        r_2, r_3 = matrix[rows[k + 2]], matrix[rows[k + 3]]
        v_0, v_1, v_2, v_3 = values[k], values[k + 1], values[k + 2], values[k + 3]
        for j in range(len(out)):
            out[j] += v_0 * r_0[j] + v_1 * r_1[j] + v_2 * r_2[j] + v_3 * r_3[j]
        k += 4
    while k < len(rows):
        row, value = matrix[rows[k]], values[k]
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
