# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A system whose displacement is sought in few shapes of the body, u = V q."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.joints.operator import GapOperator
from dolfinx_joints.model.system import MatrixSystem

Floats = NDArray[np.float64]

# Of a vector's norm, below which what is left of it beside a basis is rounding.
ROUNDING = 1e-13


class Basis:
    """Columns V that a displacement is sought in: V^T V = 1, zero at constrained dofs.

    So 2-norms of q are those of u = V q. It grows by columns and never turns: coordinates that were
    right before it grew still are, followed by zeros.

    Args:
        system: The system.

    Attributes:
        size: Number of columns.
        comm: Communicator of the ranks.
    """

    def __init__(self, system: MatrixSystem) -> None:
        """Without columns (collective)."""
        self._like, self._fixed = system.mass.createVecRight(), system.constrained
        self.comm: Any = self._like.comm.tompi4py()
        self._kept = np.empty((self._like.getLocalSize(), 64), order="F")
        self.size = 0

    @property
    def columns(self) -> Floats:
        """V, rows of the rank, shape (local dofs, size)."""
        return self._kept[:, : self.size]

    def coordinates(self, vectors: Floats) -> Floats:
        """V^T of vectors or forces, shape (size, ...), on every rank (collective)."""
        return self.sum(self.columns.T @ vectors)

    def expand(self, coordinates: Floats) -> list[PETSc.Vec]:
        """Vectors V q of the columns of q, shape (size at some time, k)."""
        rows = self.columns[:, : len(coordinates)] @ coordinates
        return [self.vector(row) for row in rows.T]

    def vector(self, rows: Floats) -> PETSc.Vec:
        """A vector of the body from the rank's rows."""
        vector = self._like.duplicate()
        vector.setArray(rows)
        return vector

    def add(self, vectors: Floats, dropped: float = ROUNDING) -> None:
        """Take in what vectors, shape (local dofs, k), have beside the basis (collective).

        Args:
            vectors: Owned rows.
            dropped: Of the norm of a vector, what counts as nothing.
        """
        new = np.array(vectors, order="F")
        new[self._fixed] = 0.0
        norms = np.sqrt(self.sum(np.einsum("ij,ij->j", new, new)))
        new = new[:, norms > 0.0] / norms[norms > 0.0]
        for first in (True, False):  # twice, or rounding is left along the basis
            new -= self.columns @ self.coordinates(new)
            squares, turn = np.linalg.eigh(self.sum(new.T @ new))
            there = squares > dropped**2 if first else squares > 0.0
            new = new @ (turn[:, there] / np.sqrt(squares[there]))
        self._append(new)

    def _append(self, new: Floats) -> None:
        size = self.size + new.shape[1]
        if size > self._kept.shape[1]:
            kept = np.empty((len(self._kept), max(size, self._kept.shape[1] * 5 // 4)), order="F")
            kept[:, : self.size] = self.columns
            self._kept = kept
        self._kept[:, self.size : size] = new
        self.size = size

    def sum(self, parts: Floats) -> Floats:
        """Sum over the ranks, the same on each (collective)."""
        return parts if self.comm.size == 1 else np.sum(self.comm.allgather(parts), axis=0)


class Projection:
    """Matrices, loads and gaps of a system in a basis, brought up to it as it grows.

    Args:
        system: The system, without moving supports, with joints.
        basis: V.

    Attributes:
        system: The system.
        basis: The basis.
        mass: V^T M V, shape (r, r); the other arrays are of as many rows.
        stiffness: V^T K V.
        loads: V^T times the patterns of the loads, shape (r, patterns).
        gaps: B V at the rank's joint points, shape (3 points, r).
    """

    def __init__(self, system: MatrixSystem, basis: Basis) -> None:
        """Nothing is multiplied yet."""
        self.system, self.basis = system, basis
        self.mass, self.stiffness = np.zeros((2, 0, 0))
        patterns = [vector.array_r for vector, _ in system.patterns]
        self._patterns = np.column_stack(patterns) if patterns else np.zeros((len(basis.columns), 0))
        self.loads = np.zeros((0, len(patterns)))
        assert system.contact is not None
        self._contact = system.contact
        rows = self._contact.operator.matrix.getLocalSize()[0]
        self.gaps = np.zeros((rows, 0))

    def update(self) -> None:
        """Multiply with the columns that are new (collective)."""
        basis, system, known = self.basis, self.system, len(self.mass)
        new = basis.columns[:, known:]
        if not new.shape[1]:
            return
        for name, matrix in (("mass", system.mass), ("stiffness", system.stiffness)):
            columns = basis.coordinates(multiplied(matrix, new))
            whole = np.zeros((basis.size, basis.size))
            whole[:known, :known] = getattr(self, name)
            whole[:, known:], whole[known:, :] = columns, columns.T
            setattr(self, name, whole)
        self.loads = np.vstack([self.loads, basis.sum(new.T @ self._patterns)])
        jumps = multiplied(self._contact.operator.matrix, new)
        self.gaps = np.hstack([self.gaps, jumps])

    def reduced(self) -> MatrixSystem:
        """The system of q: M, K and C, loads, and joints with the same points (collective)."""
        self.update()
        given, system = self._contact.operator, self.system
        rows = (given.matrix.getSizes()[0], (PETSc.DECIDE, self.basis.size))
        operator = GapOperator(
            self._matrix(self.gaps, rows), given.areas, given.joint, given.names
        )
        mass = self.square(self.mass)
        return replace(
            system,
            mass=mass,
            stiffness=self.square(self.stiffness),
            contact=self._contact.on(operator),
            patterns=[
                (share(column, mass.createVecRight()), factor)
                for column, (_, factor) in zip(self.loads.T, system.patterns, strict=True)
            ],
            constrained=np.empty(0, dtype=np.int64),
            components=1,
            shared=None,
        )

    def square(self, whole: Floats) -> PETSc.Mat:
        """A matrix of coordinates that every rank has as a whole (collective)."""
        size = (PETSc.DECIDE, len(whole))
        rows = slice(*share(whole[0], self.coordinate_vector()).getOwnershipRange())
        return self._matrix(whole[rows], (size, size))

    def coordinate_vector(self) -> PETSc.Vec:
        """A vector of coordinates (collective)."""
        return PETSc.Vec().createMPI((PETSc.DECIDE, self.basis.size), comm=self.system.mass.comm)

    def _matrix(self, rows: Floats, size: Any) -> PETSc.Mat:
        """A matrix with every entry of the rank's rows stored (collective)."""
        count, columns = rows.shape
        starts = np.arange(0, count * columns + 1, columns, dtype=PETSc.IntType)
        numbers = np.tile(np.arange(columns, dtype=PETSc.IntType), count)
        comm = self.system.mass.comm
        matrix = PETSc.Mat().createAIJ(size, csr=(starts, numbers, rows.ravel()), comm=comm)
        matrix.assemble()
        return matrix


def share(whole: Floats, vector: PETSc.Vec) -> PETSc.Vec:
    """The vector, filled with the rank's part of what all ranks have; zero beyond it."""
    start, stop = vector.getOwnershipRange()
    part = np.zeros(stop - start)
    there = whole[start:stop]
    part[: len(there)] = there
    vector.setArray(part)
    return vector


def multiplied(matrix: PETSc.Mat, columns: Floats) -> Floats:
    """A matrix times the owned rows of columns, one by one: blocked formats know no more."""
    x, y = matrix.createVecs()
    found = np.empty((y.getLocalSize(), columns.shape[1]), order="F")
    for i, column in enumerate(columns.T):
        x.setArray(column)
        matrix.mult(x, y)
        found[:, i] = y.array_r
    return found


def as_columns(vectors: Iterable[PETSc.Vec]) -> Floats:
    """Owned rows of vectors, shape (local dofs, k)."""
    return np.column_stack([vector.array_r for vector in vectors])
