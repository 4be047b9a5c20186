# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compliance of the structure at the joint points, G = B A^-1 B^T, scaled to a unit diagonal.

With s the root of a point's own compliance, forces count as f = s F and gaps as g / s, both in
[J^(1/2)], so that G becomes I + S with small entries S, which is what the joints' iteration needs.
A rank has the entries of its own points in vectors, and their rows of S; of a block of low rank
between two ranks each has one factor.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.progress import Progress
from dolfinx_joints.joints.operator import GapOperator
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.batch import BatchScheduler
from dolfinx_joints.solvers.compliance.low_rank import LowRankMatrix
from dolfinx_joints.solvers.compliance.row_matrix import Parts, RowMatrix
from dolfinx_joints.solvers.compliance.unit_forces import UnitForces
from dolfinx_joints.solvers.effective_matrix import EffectiveMatrix
from dolfinx_joints.solvers.multigrid.bulk import IterativeSolver

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]


class Split(Protocol):
    """S, known by its products.

    Attributes:
        size: Number of rows of all ranks.
        local: Of the rank.
    """

    size: int
    local: int

    def whole(self) -> Floats | None:
        """The matrix, shape (size, size), None where it cannot be had (collective)."""

    def product(self, values: Floats, rows: Rows) -> Floats:
        """Times a vector that is zero but for some of the rank's rows, shape (local,) (collective).

        Rows are numbered among the rank's.
        """


class Compliance:
    """S and its scale for one set of coefficients.

    Args:
        effective: The bulk, A.
        operator: B with zero columns at constrained dofs, three rows per joint point.
        joints: The joints' operator, of which areas and places are taken.
        kind: ``dense``: all of S, made at once from `SMALLEST_AT_ONCE` to `LARGEST_WHOLE` unknowns
            and else by one back-substitution for each, 8 m^2 bytes over the ranks; ``compressed``:
            made in the same way (on several ranks by back-substitutions), less memory;
            ``matrix-free``: nothing is kept, each product takes a back-substitution; ``auto``:
            matrix-free if the bulk is solved by iteration, else dense up to `LARGEST_DENSE`
            unknowns, compressed above.
        largest: Own compliance to be used at most, shape (n, 2), [m/Pa].

    Attributes:
        effective: The bulk, A.
        kind: Which of the kinds it is.
        keeps_rows: Whether a rank may keep whole rows of S beside a compressed one.
        own: Compliance of each local point on its own area, normal and tangential (the mean of
            the directions in which it can move), shape (n, 2), [m/Pa].
        scale: s, three per local point, 1 where a point cannot move, [(m/N)^(1/2)].
        dead: Directions in which a point cannot move, such as the third in a plane, shape (n, 3).
        split: S.
        forms: What the compiled iteration has made of S, None before.
        rough: S to `ROUGH_COMPRESSION`; None where S is small, the places of the points are not
            known, or nothing is kept and the bulk is factored.
    """

    def __init__(
        self,
        effective: EffectiveMatrix,
        operator: PETSc.Mat,
        joints: GapOperator,
        *,
        kind: str = "auto",
        largest: Floats | None = None,
    ) -> None:
        """Solve for unit forces (collective)."""
        self.effective = effective
        self.forms: Any = None
        self._comm, self._joints = operator.comm.tompi4py(), joints
        self._forces = UnitForces(effective, operator)
        size = operator.getSize()[0]
        self.keeps_rows = kind != "compressed" or self._comm.size == 1
        self.kind = _chosen(kind, size, effective, joints)
        self.split: Split
        self.rough: Split | None = None
        if self.kind == "dense":
            columns = self._dense(operator, joints, largest)
            self.split = RowMatrix(columns, self._comm)
            if joints.points is not None and size > limits.LARGEST_DENSE:
                self.rough = self.roughly(columns)
            return
        known = self._at_once(size) if self.kind == "compressed" else None
        diagonal = self._forces.diagonal() if known is None else known[_own(operator)]
        self._scale(diagonal, joints.areas, largest)
        if self.kind == "matrix-free":
            self.split = _Products(self._forces.product, self.scale, self.dead, self._comm)
            if isinstance(effective.solver, IterativeSolver):
                rough = partial(self._forces.rough_product, tolerance=limits.ROUGH_COMPRESSION)
                self.rough = _Products(rough, self.scale, self.dead, self._comm)
            return
        scale = np.where(self.dead.ravel(), 0.0, self.scale)
        gaps = self._forces.gaps if known is None else lambda numbers: known[numbers].T
        fine = self._compressed(gaps, scale, limits.COMPRESSION)
        self.split = self._products(fine)
        self.rough = self._products(fine.rougher(limits.ROUGH_COMPRESSION))

    def _dense(self, operator: PETSc.Mat, joints: GapOperator, largest: Floats | None) -> Floats:
        """The rank's columns of S, shape (size, local); sets the scale (collective)."""
        size, own = operator.getSize()[0], _own(operator)
        columns = self._at_once(size)
        if columns is None:
            columns = self._columns(size)
        self._scale(columns[own], joints.areas, largest)
        every = Parts(self._forces.local, self._comm)
        columns /= every.all_of(self.scale)[:, None]
        columns /= self.scale
        columns[own] -= 1.0
        columns[every.all_of(self.dead.ravel())] = 0.0
        return columns

    def roughly(self, columns: Floats) -> Compressed:
        """A matrix like S to `ROUGH_COMPRESSION` from the rank's columns of it (collective)."""
        stop = self._comm.scan(columns.shape[1])
        mine = slice(stop - columns.shape[1], stop)

        def of_unit_diagonal(numbers: Rows) -> Floats:
            part = columns[numbers].T
            here = np.flatnonzero((numbers >= mine.start) & (numbers < mine.stop))
            part[numbers[here] - mine.start, here] += 1.0
            return part

        ones = np.ones(columns.shape[1])
        rough = self._compressed(of_unit_diagonal, ones, limits.ROUGH_COMPRESSION, np.float32)
        return Compressed(rough, ones, self.dead, self._comm, self.effective.scheduler)

    def _products(self, matrix: LowRankMatrix) -> Split:
        return Compressed(matrix, self.scale, self.dead, self._comm, self.effective.scheduler)

    def _at_once(self, size: int) -> Floats | None:
        """The rank's columns of G, shape (size, local), None where at once is no better, [m/N]."""
        fits = self.keeps_rows and limits.SMALLEST_AT_ONCE <= size <= limits.LARGEST_WHOLE
        return self._forces.at_once() if fits and self.effective.positive else None

    def _columns(self, size: int) -> Floats:
        """The rank's columns of G, shape (size, local), [m/N]."""
        columns = np.empty((size, self._forces.local))
        progress = Progress("compliance of the joints", size, "columns", self._comm.rank)
        for first in range(0, size, limits.BLOCK_COLUMNS):
            numbers = np.arange(first, min(first + limits.BLOCK_COLUMNS, size))
            columns[numbers] = self._forces.gaps(numbers).T
            progress.advance(len(numbers))
        progress.finish()
        return columns

    def _compressed(
        self,
        columns: Callable[[Rows], Floats],
        scale: Floats,
        tolerance: float,
        dtype: type = np.float64,
    ) -> LowRankMatrix:
        """Columns in blocks of low rank (collective)."""
        joints = self._joints
        assert joints.points is not None
        return LowRankMatrix(
            columns,
            joints.points,
            self._comm,
            scale=scale,
            joint=joints.joint,
            tolerance=tolerance,
            dtype=dtype,
            symmetric=self.effective.symmetric,
        )

    def _scale(self, diagonal: Floats, areas: Floats, largest: Floats | None) -> None:
        """Own compliances from those in each direction, shape (3 n,), [m/N]."""
        each = diagonal.reshape(-1, 3)
        live = np.maximum(np.count_nonzero(each[:, 1:] > 0.0, axis=1), 1)
        own = np.column_stack([each[:, 0], (each[:, 1] + each[:, 2]) / live])
        if largest is not None:
            own = np.minimum(own, largest / areas[:, None])
        self.own = areas[:, None] * own
        roots = np.where(each > 0.0, np.sqrt(np.repeat(own, (1, 2), axis=1)), 0.0)
        self.dead = roots == 0.0
        self.scale = np.where(self.dead, 1.0, roots).ravel()

    def destroy(self) -> None:
        """Free what the products need; the bulk's factor is left."""
        self._forces.destroy()


def _own(operator: PETSc.Mat) -> tuple[Rows, Rows]:
    """Where the rank's columns have the diagonal."""
    start, stop = operator.getOwnershipRange()
    return np.arange(start, stop), np.arange(stop - start)


def _chosen(kind: str, size: int, effective: EffectiveMatrix, joints: GapOperator) -> str:
    """The kind of compliance to be made."""
    if kind == "compressed" and joints.points is None:
        raise ValueError(
            "compliance is 'compressed', but the places of the joint points are not known: this "
            "system comes from matrices; take 'dense' or 'matrix-free'."
        )
    if kind != "auto":
        return kind
    if isinstance(effective.solver, IterativeSolver):
        return "matrix-free"
    return "dense" if size <= limits.LARGEST_DENSE or joints.points is None else "compressed"


class _Products:
    """S from products with G."""

    def __init__(
        self,
        multiply: Callable[[Floats], Floats],
        scale: Floats,
        dead: NDArray[np.bool_],
        comm: Any,
    ) -> None:
        """Keep what is needed (collective)."""
        self._multiply, self._scale, self._comm = multiply, scale, comm
        self.live, self.local = ~dead.ravel(), len(scale)
        self.size = comm.allreduce(self.local)

    def product(self, values: Floats, rows: Rows) -> Floats:
        """Times a vector, the rank's part of both, shape (local,) (collective)."""
        gaps = self._multiply(values / self._scale)
        return np.where(self.live, gaps / self._scale - values, 0.0)

    def whole(self) -> Floats | None:
        """Not kept."""
        return None


class Compressed(_Products):
    """S in blocks of low rank.

    Attributes:
        matrix: The blocks.
        live: Whether an unknown of the rank can move, shape (local,).
    """

    def __init__(
        self,
        matrix: LowRankMatrix,
        scale: Floats,
        dead: NDArray[np.bool_],
        comm: Any,
        scheduler: BatchScheduler | None,
    ) -> None:
        """Keep the matrix; several runs multiply with it through rounds."""
        multiply = (
            matrix.product
            if scheduler is None
            else partial(scheduler.request, self, matrix.products)
        )
        super().__init__(multiply, scale, dead, comm)
        self.matrix = matrix

    def whole(self) -> Floats:
        """The matrix, shape (size, size), on every rank (collective)."""
        columns = self.columns()
        if self._comm.size == 1:
            return columns
        return np.hstack(self._comm.allgather(columns))

    def columns(self) -> Floats:
        """Columns of the rank's rows, one after the other, shape (size, local) (collective)."""
        every = self.matrix.columns()
        parts = Parts(self.local, self._comm)
        every /= parts.all_of(self._scale)[:, None] * self._scale
        every[parts.first + np.arange(self.local), np.arange(self.local)] -= 1.0
        every[~parts.all_of(self.live)] = 0.0
        return every
