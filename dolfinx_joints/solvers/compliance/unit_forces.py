# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gaps of the joints under forces on them, G F with G = B A^-1 B^T: columns, products, diagonal."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.mpi import of_ranks, summed
from dolfinx_joints.common.progress import LOGGER
from dolfinx_joints.joints.operator import diagonal_compliance
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.compliance.own_blocks import unknowns_of
from dolfinx_joints.solvers.compliance.schur_complement import schur_complement
from dolfinx_joints.solvers.direct import DirectSolver, multiplied
from dolfinx_joints.solvers.effective_matrix import EffectiveMatrix
from dolfinx_joints.solvers.multigrid.bulk import IterativeSolver

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]


class UnitForces:
    """G of a factored or iterated bulk, by back-substitutions or all at once.

    Args:
        effective: The bulk, A.
        operator: B with zero columns at constrained dofs, three rows per joint point.

    Attributes:
        local: Number of the rank's joint unknowns.
    """

    def __init__(self, effective: EffectiveMatrix, operator: PETSc.Mat) -> None:
        """Keep the entries of B (collective)."""
        self._effective, self._operator = effective, operator
        self.local = operator.getLocalSize()[0]
        self._points = operator.createVecLeft()
        self._nodal, self._moved = operator.createVecRight(), operator.createVecRight()

    @cached_property
    def _rows(self) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """The rank's rows of B: starts, columns and values."""
        starts, columns, values = self._operator.getValuesCSR()
        return starts, columns, values

    @cached_property
    def _columns(self) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Entries of the rank's columns of B, sorted by row: rows, local columns and values.

        (Collective when first asked for.)
        """
        transposed = self._operator.transpose(PETSc.Mat())
        starts, numbers, entries = transposed.getValuesCSR()
        transposed.destroy()
        order = np.argsort(numbers, kind="stable")
        lines = np.repeat(np.arange(len(starts) - 1), np.diff(starts))[order]
        return numbers[order], lines, entries[order]

    def gaps(self, numbers: Rows) -> Floats:
        """Columns of G at the rank's points, shape (local, k), [m/N] (collective).

        Args:
            numbers: Of the unknowns that carry a unit force each, shape (k,).
        """
        columns = np.empty((self.local, len(numbers)))
        # More right-hand sides at once take memory of the size of the body and no less time.
        for first in range(0, len(numbers), limits.BLOCK_COLUMNS):
            some = slice(first, first + limits.BLOCK_COLUMNS)
            columns[:, some] = self._block(numbers[some])
        return columns

    def at_once(self) -> Floats | None:
        """All columns of G at the rank's points, shape (size, local), [m/N] (collective).

        None, with a warning, where the way over a Schur complement fails.
        """
        size, rank = self._operator.getSize()[0], self._operator.comm.rank
        some = np.unique(np.linspace(0, size - 1, limits.SAMPLES).astype(np.int64))
        known = self.gaps(some)  # sees whether the bulk is singular
        if rank == 0:
            LOGGER.info("compliance of the joints: %d columns at once, by a factorization", size)
        try:
            columns = schur_complement(self._effective.constrained, self._operator)
            for first in range(0, size, limits.BLOCK_COLUMNS):
                numbers = np.arange(first, min(first + limits.BLOCK_COLUMNS, size))
                columns[numbers] -= self._of_modes(numbers).T
            self._compare(columns[some].T, known)
        except (JointsError, PETSc.Error, MemoryError) as error:
            if rank == 0:
                LOGGER.warning("compliance of the joints, column by column: %s", error)
            return None
        return columns

    def _compare(self, found: Floats, known: Floats) -> None:
        """Raise an error if columns are not those that have been solved for (collective)."""
        mine = np.array([np.abs(each).max(initial=0.0) for each in (found - known, known)])
        error, largest = of_ranks(self._operator.comm.tompi4py(), mine).max(axis=0)
        if not error <= limits.AT_ONCE_ERROR * largest:
            raise JointsError(f"all at once it would be wrong by {error:.1e} of {largest:.1e} m/N")

    def _block(self, numbers: Rows) -> Floats:
        """Some columns, solved for at once."""
        solver = self._effective.solver
        if isinstance(solver, DirectSolver) and solver.package == "mumps":
            rows = self._on_rank_0(numbers)
            moved = solver.solve_sparse(rows)
            rows.destroy()
        else:
            moved = solver.solve_block(self._right(numbers))
        return multiplied(self._operator, moved) - self._of_modes(numbers)

    @cached_property
    def _modal(self) -> tuple[Floats, Floats] | None:
        """B Z and W of `EffectiveMatrix.modal_parts` (collective when first asked for)."""
        parts = self._effective.modal_parts()
        if parts is None:
            return None
        return np.ascontiguousarray(multiplied(self._operator, parts[0])), parts[1]

    def _of_modes(self, numbers: Rows) -> Floats:
        """What exact and damped modes take from columns of G, shape (local, k) (collective)."""
        if self._modal is None:
            return np.zeros((self.local, len(numbers)))
        gaps, small = self._modal
        first, stop = self._operator.getOwnershipRange()
        here = np.flatnonzero((numbers >= first) & (numbers < stop))
        loaded = np.zeros((len(numbers), len(small)))
        loaded[here] = gaps[numbers[here] - first]
        every = summed(self._operator.comm.tompi4py(), loaded)
        taken: Floats = gaps @ (small @ every.T)
        return taken

    def _right(self, numbers: Rows) -> Floats:
        """Owned rows of B^T for some unknowns, shape (local dofs, k)."""
        rows, lines, entries = self._columns
        firsts = np.searchsorted(rows, numbers)
        counts = np.searchsorted(rows, numbers, side="right") - firsts
        taken = ranges(firsts, counts)
        right = np.zeros((self._operator.getLocalSize()[1], len(numbers)))
        right[lines[taken], np.repeat(np.arange(len(numbers)), counts)] = entries[taken]
        return right

    def _on_rank_0(self, numbers: Rows) -> PETSc.Mat:
        """Rows of B of some unknowns as a matrix on rank 0 (collective)."""
        starts, columns, values = self._rows
        first, stop = self._operator.getOwnershipRange()
        here = np.flatnonzero((numbers >= first) & (numbers < stop))
        own = numbers[here] - first
        counts = starts[own + 1] - starts[own]
        taken, comm = ranges(starts[own], counts), self._operator.comm
        mine = (np.repeat(here, counts), columns[taken], values[taken])
        parts = comm.tompi4py().gather(mine, root=0)
        count, dofs = 0 if parts is None else len(numbers), self._operator.getSize()[1]
        empty = tuple(part[:0] for part in mine)
        at, columns, values = (
            np.concatenate(each) for each in zip(*(parts or [empty]), strict=True)
        )
        order = np.argsort(at, kind="stable")
        starts = np.append(0, np.cumsum(np.bincount(at, minlength=count)[:count]))
        return PETSc.Mat().createAIJ(
            ((count, len(numbers)), (dofs if count else 0, dofs)),
            csr=(starts.astype(PETSc.IntType), columns[order], values[order]),
            comm=comm,
        )

    def product(self, forces: Floats) -> Floats:
        """G F at the rank's points, F likewise (collective)."""
        self._load(forces)
        self._effective.solve(self._nodal, self._moved)
        return self._gaps()

    def rough_product(self, forces: Floats, tolerance: float) -> Floats:
        """G F to a tolerance, for a bulk solved by iteration (collective)."""
        assert isinstance(self._effective.solver, IterativeSolver)
        self._load(forces)
        self._effective.solve(self._nodal, self._moved, tolerance=tolerance)
        return self._gaps()

    def diagonal(self) -> Floats:
        """Diagonal of G at the rank's points, estimated, shape (local,), [m/N] (collective).

        B diag(A)^-1 B^T, times the ratio of the true one to it at some points, as its median for
        normal and for tangential directions. The joints' iteration is right with any; with this it
        is quick.
        """
        comm = self._operator.comm.tompi4py()
        estimate = diagonal_compliance(self._operator, self._effective.constrained.getDiagonal())
        size = self._operator.getSize()[0]
        points = np.unique(np.linspace(0, size // 3 - 1, limits.SAMPLES).astype(np.int64))
        numbers = unknowns_of(points)
        start, stop = self._operator.getOwnershipRange()
        gaps = self.gaps(numbers)
        here = np.flatnonzero((numbers >= start) & (numbers < stop))
        known = np.zeros((2, len(numbers)))
        known[:, here] = gaps[numbers[here] - start, here], estimate[numbers[here] - start]
        found, estimated = summed(comm, known)
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.where(estimated > 0.0, found / estimated, np.nan).reshape(-1, 3)
        factors = [_median(ratio[:, :1]), *2 * [_median(ratio[:, 1:])]]
        return estimate * np.tile(factors, len(estimate) // 3)

    def _load(self, forces: Floats) -> None:
        """Nodal forces of joint forces."""
        self._points.setArray(forces)
        self._operator.multTranspose(self._points, self._nodal)

    def _gaps(self) -> Floats:
        self._operator.mult(self._moved, self._points)
        return self._points.getArray(readonly=True).copy()

    def destroy(self) -> None:
        """Free the vectors."""
        for vector in (self._points, self._nodal, self._moved):
            vector.destroy()


def _median(ratio: Floats) -> float:
    """Median of the numbers among some values, 1 if there is none."""
    known = ratio[np.isfinite(ratio) & (ratio > 0.0)]
    return float(np.median(known)) if len(known) else 1.0


def ranges(firsts: NDArray[Any], counts: NDArray[Any]) -> NDArray[Any]:
    """Numbers from each first on, as many as its count says, one range after the other."""
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    found: NDArray[Any] = np.repeat(firsts, counts) + within
    return found
