# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compliance of the structure at the joint points, G = B A^-1 B^T (20), scaled to a unit diagonal.

With s = sqrt(c / w), the root of a diagonal entry of G, joint forces F are scaled to f = s F and
gaps to g / s, both in [J^(1/2)]. G then becomes I + S with a small S (22), as required by the
iteration on the joints. Each rank stores the vector entries and the rows of S of its points. If a
low-rank block belongs to two ranks, each of them stores one factor.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.common.progress import Progress
from dolfinx_joints.joints.operator import GapOperator
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.batch import BatchScheduler
from dolfinx_joints.solvers.compliance.low_rank import LowRankMatrix
from dolfinx_joints.solvers.compliance.row_matrix import Parts, RowMatrix
from dolfinx_joints.solvers.compliance.unit_forces import UnitForces
from dolfinx_joints.solvers.effective_matrix import EffectiveMatrix
from dolfinx_joints.solvers.multigrid.bulk import IterativeSolver


class Split(Protocol):
    """The matrix S, defined by its products with vectors.

    Attributes:
        size: Number of rows of all ranks.
        local: Number of rows of this rank.
    """

    size: int
    local: int

    def whole(self) -> Floats | None:
        """Return the matrix, shape (size, size), None if it is not stored (collective)."""

    def product(self, values: Floats, rows: Ints) -> Floats:
        """Return S times a vector that is zero except in some of the rank's rows (collective).

        Rows are local numbers; the vector and the product have the shape (local,).
        """


class Compliance:
    """Scaled compliance S and its scale for one set of coefficients.

    Args:
        effective: The bulk, A.
        operator: B with zero columns at constrained dofs, three rows per joint point.
        joints: Operator of the joints, with the areas and coordinates of the points.
        kind: ``dense``: all of S, 8 m^2 bytes on all ranks together for m unknowns. S is computed
            at once from `SMALLEST_AT_ONCE` to `LARGEST_WHOLE` unknowns, otherwise by one
            back-substitution per unknown. ``compressed``: less memory, computed in the same way (on
            several ranks by back-substitutions). ``matrix-free``: S is not stored and each product
            is a back-substitution. ``auto``: matrix-free if the bulk is solved by iteration,
            otherwise dense up to `LARGEST_DENSE` unknowns and compressed above.
        largest: Upper limit of ``own``, shape (n, 2), [m/Pa].

    Attributes:
        effective: The bulk, A.
        kind: ``dense``, ``compressed`` or ``matrix-free``.
        keeps_rows: True if a rank may store whole rows of S next to a compressed S.
        own: Compliance c of each local point to its own traction, normal and tangential (mean of
            the directions in which the point can move), shape (n, 2), [m/Pa].
        scale: s, three per local point, 1 where a point cannot move, [(m/N)^(1/2)].
        dead: Directions in which a point cannot move, such as the third in a plane, shape (n, 3).
        split: S.
        forms: S in the forms of the compiled corrections, None before the first correction.
        rough: S with the error `ROUGH_COMPRESSION`. None if S is small, if the points have no
            coordinates, or if S is not stored and the bulk is factored.
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
                self.rough = self.compressed_roughly(columns)
            return
        whole = self._at_once(size) if self.kind == "compressed" else None
        diagonal = self._forces.diagonal() if whole is None else whole[_diagonal_index(operator)]
        self._set_scale(diagonal, joints.areas, largest)
        if self.kind == "matrix-free":
            self.split = _Products(self._forces.product, self.scale, self.dead, self._comm)
            if isinstance(effective.solver, IterativeSolver):
                rough = partial(self._forces.rough_product, tolerance=limits.ROUGH_COMPRESSION)
                self.rough = _Products(rough, self.scale, self.dead, self._comm)
            return
        scale = np.where(self.dead.ravel(), 0.0, self.scale)
        gaps = self._forces.gaps if whole is None else lambda numbers: whole[numbers].T
        fine = self._compressed(gaps, scale, limits.COMPRESSION)
        self.split = self._as_split(fine)
        self.rough = self._as_split(fine.rougher(limits.ROUGH_COMPRESSION))

    def _dense(self, operator: PETSc.Mat, joints: GapOperator, largest: Floats | None) -> Floats:
        """Return the rank's columns of S, shape (size, local), and set the scale (collective)."""
        size, diagonal = operator.getSize()[0], _diagonal_index(operator)
        columns = self._at_once(size)
        if columns is None:
            columns = self._columns(size)
        self._set_scale(columns[diagonal], joints.areas, largest)
        unknowns = Parts(self._forces.local, self._comm)
        columns /= unknowns.all_of(self.scale)[:, None]
        columns /= self.scale
        columns[diagonal] -= 1.0
        columns[unknowns.all_of(self.dead.ravel())] = 0.0
        return columns

    def compressed_roughly(self, columns: Floats) -> Compressed:
        """Return S with the error `ROUGH_COMPRESSION` from the rank's columns (collective)."""
        stop = self._comm.scan(columns.shape[1])
        local = slice(stop - columns.shape[1], stop)

        def of_unit_diagonal(numbers: Ints) -> Floats:
            part = columns[numbers].T
            positions = np.flatnonzero((numbers >= local.start) & (numbers < local.stop))
            part[numbers[positions] - local.start, positions] += 1.0
            return part

        ones = np.ones(columns.shape[1])
        rough = self._compressed(of_unit_diagonal, ones, limits.ROUGH_COMPRESSION, np.float32)
        return Compressed(rough, ones, self.dead, self._comm, self.effective.scheduler)

    def _as_split(self, matrix: LowRankMatrix) -> Split:
        return Compressed(matrix, self.scale, self.dead, self._comm, self.effective.scheduler)

    def _at_once(self, size: int) -> Floats | None:
        """Return the rank's columns of G, shape (size, local), [m/N]; None if that is slower."""
        fits = self.keeps_rows and limits.SMALLEST_AT_ONCE <= size <= limits.LARGEST_WHOLE
        return self._forces.at_once() if fits and self.effective.positive else None

    def _columns(self, size: int) -> Floats:
        """Return the rank's columns of G, shape (size, local), [m/N]."""
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
        columns: Callable[[Ints], Floats],
        scale: Floats,
        tolerance: float,
        dtype: type = np.float64,
    ) -> LowRankMatrix:
        """Return the matrix with the given columns, in blocks of low rank (collective)."""
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

    def _set_scale(self, diagonal: Floats, areas: Floats, largest: Floats | None) -> None:
        """Set the scale from the diagonal of G, shape (3 n,), [m/N]."""
        c = diagonal.reshape(-1, 3)
        live = np.maximum(np.count_nonzero(c[:, 1:] > 0.0, axis=1), 1)
        own = np.column_stack([c[:, 0], (c[:, 1] + c[:, 2]) / live])
        if largest is not None:
            own = np.minimum(own, largest / areas[:, None])
        self.own = areas[:, None] * own
        roots = np.where(c > 0.0, np.sqrt(np.repeat(own, (1, 2), axis=1)), 0.0)
        self.dead = roots == 0.0
        self.scale = np.where(self.dead, 1.0, roots).ravel()

    def destroy(self) -> None:
        """Free the work vectors of the products; the bulk's factor is kept."""
        self._forces.destroy()


def _diagonal_index(operator: PETSc.Mat) -> tuple[Ints, Ints]:
    """Return the positions (rows, columns) of the diagonal in the rank's columns."""
    start, stop = operator.getOwnershipRange()
    return np.arange(start, stop), np.arange(stop - start)


def _chosen(kind: str, size: int, effective: EffectiveMatrix, joints: GapOperator) -> str:
    """Return the kind of compliance that is used."""
    if kind == "compressed" and joints.points is None:
        raise ValueError(
            "compliance='compressed' needs the coordinates of the joint points; a system made from "
            "matrices has none. Use 'dense' or 'matrix-free'."
        )
    if kind != "auto":
        return kind
    if isinstance(effective.solver, IterativeSolver):
        return "matrix-free"
    return "dense" if size <= limits.LARGEST_DENSE or joints.points is None else "compressed"


class _Products:
    """Scaled compliance S, computed by products with G."""

    def __init__(
        self,
        multiply: Callable[[Floats], Floats],
        scale: Floats,
        dead: NDArray[np.bool_],
        comm: Any,
    ) -> None:
        """Store the parts (collective)."""
        self._multiply, self._scale, self._comm = multiply, scale, comm
        self.live, self.local = ~dead.ravel(), len(scale)
        self.size = comm.allreduce(self.local)

    def product(self, values: Floats, rows: Ints) -> Floats:
        """Return S times a vector, both with the rank's entries, shape (local,) (collective)."""
        gaps = self._multiply(values / self._scale)
        return np.where(self.live, gaps / self._scale - values, 0.0)

    def whole(self) -> Floats | None:
        """Return None: the matrix is not stored."""
        return None


class Compressed(_Products):
    """Scaled compliance S in blocks of low rank.

    Attributes:
        matrix: The blocks.
        live: True for each unknown of the rank that can move, shape (local,).
    """

    def __init__(
        self,
        matrix: LowRankMatrix,
        scale: Floats,
        dead: NDArray[np.bool_],
        comm: Any,
        scheduler: BatchScheduler | None,
    ) -> None:
        """Store the matrix; with a scheduler, the products of several runs are batched."""
        multiply = (
            matrix.product
            if scheduler is None
            else partial(scheduler.request, self, matrix.products)
        )
        super().__init__(multiply, scale, dead, comm)
        self.matrix = matrix

    def whole(self) -> Floats:
        """Return the matrix, shape (size, size), on every rank (collective)."""
        columns = self.columns()
        if self._comm.size == 1:
            return columns
        return np.hstack(self._comm.allgather(columns))

    def columns(self) -> Floats:
        """Return the rank's columns, stored row by row, shape (size, local) (collective)."""
        columns = self.matrix.columns()
        parts = Parts(self.local, self._comm)
        columns /= parts.all_of(self._scale)[:, None] * self._scale
        columns[parts.first + np.arange(self.local), np.arange(self.local)] -= 1.0
        columns[~parts.all_of(self.live)] = 0.0
        return columns
