# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gaps due to joint forces, G F with G = B A^-1 B^T (20): columns, products and diagonal of G.

All of G at once is a Schur complement computed by MUMPS (20a): the factorization eliminates the
dofs in dense fronts, which the ranks share and which contain the joint unknowns. Back-substitutions
would read the factor twice for each block of columns.
"""

from __future__ import annotations

import ctypes
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.mpi import of_ranks, on_root, summed
from dolfinx_joints.common.progress import LOGGER
from dolfinx_joints.joints.operator import diagonal_compliance
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.compliance.own_blocks import unknowns_of
from dolfinx_joints.solvers.diagnosis import reported_by_package
from dolfinx_joints.solvers.direct import DirectSolver, multiplied
from dolfinx_joints.solvers.effective_matrix import EffectiveMatrix
from dolfinx_joints.solvers.multigrid.bulk import IterativeSolver

# MUMPS' ICNTL(31): do not keep the factor. ICNTL(14): extra workspace in per cent of the estimate.
CONTROLS = {31: 1, 14: 60}

# MUMPS' CNTL(1), set to 0: a positive A needs no pivoting, and entries of B have other units.
THRESHOLD = 1


def schur_complement(matrix: PETSc.Mat, operator: PETSc.Mat) -> Floats:
    """Return the columns of G at the rank's points, shape (size, local), [m/N] (collective).

    Rank 0 temporarily stores all of G.

    Args:
        matrix: A, symmetric and positive.
        operator: B.

    Raises:
        JointsError: MUMPS failed, for example because memory was insufficient.
    """
    transposed = PETSc.Mat().createTranspose(operator)
    bordered = PETSc.Mat().createNest([[matrix, transposed], [operator, None]], comm=matrix.comm)
    bordered.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    pc, numbers = PETSc.PC().create(matrix.comm), _joint_unknowns(matrix, operator)
    pc.setOptionsPrefix("dolfinx_joints_compliance_")
    pc.setOperators(bordered)
    pc.setType("cholesky")
    pc.setFactorSolverType("mumps")
    pc.setFactorSetUpSolverType()
    factor, stage = pc.getFactorMatrix(), PETSc.Log.Stage("compliance of the joints")
    for number, value in CONTROLS.items():
        factor.setMumpsIcntl(number, value)
    factor.setMumpsCntl(THRESHOLD, 0.0)
    try:
        _call_petsc("MatFactorSetSchurIS", factor.handle, numbers.handle)
        stage.push()
        try:
            pc.setUp()
            pc.viewFromOptions("-pc_view")
        finally:
            stage.pop()
        if pc.getFailedReason():
            raise JointsError(f"the bordered matrix could not be factored{reported_by_package(pc)}")
        rows = _scattered_rows(factor, operator)
    finally:
        for owned in (factor, pc, bordered, transposed, numbers):
            owned.destroy()
    return np.subtract(0.0, rows.T, order="C")


def _joint_unknowns(matrix: PETSc.Mat, operator: PETSc.Mat) -> PETSc.IS:
    """Return the numbers of all joint unknowns on rank 0; they follow the dofs of each rank."""
    counts = np.diff(operator.getOwnershipRanges())
    numbers = np.arange(operator.getSize()[0]) + np.repeat(matrix.getOwnershipRanges()[1:], counts)
    local = numbers if matrix.comm.rank == 0 else numbers[:0]
    return PETSc.IS().createGeneral(local.astype(PETSc.IntType), comm=matrix.comm)


def _scattered_rows(factor: PETSc.Mat, operator: PETSc.Mat) -> Floats:
    """Return the rank's rows of the Schur complement -G, sent by rank 0 (collective)."""
    comm = operator.comm.tompi4py()
    local, size = operator.getLocalSize()[0], operator.getSize()[0]
    rows, counts = np.empty((local, size)), comm.gather(local * size, root=0)
    whole: list[Floats] = []
    on_root(comm, lambda: whole.append(_symmetric_matrix(factor, size)))  # fails on all ranks
    comm.Scatterv(None if counts is None else [whole[0], counts], rows, root=0)
    return rows


def _symmetric_matrix(factor: PETSc.Mat, size: int) -> Floats:
    """Return the full Schur complement; PETSc stores only the lower triangle, by columns."""
    dense, entries = ctypes.c_void_p(), ctypes.POINTER(ctypes.c_double)()
    _call_petsc("MatFactorGetSchurComplement", factor.handle, ctypes.byref(dense), None)
    _call_petsc("MatDenseGetArray", dense, ctypes.byref(entries))
    whole = np.ctypeslib.as_array(entries, (size, size))
    for first in range(0, size, limits.BLOCK_COLUMNS):
        stop = min(first + limits.BLOCK_COLUMNS, size)
        corner = whole[first:stop, first:stop]
        corner[:] = np.triu(corner) + np.triu(corner, 1).T
        whole[stop:, first:stop] = whole[first:stop, stop:].T
    return whole


def _call_petsc(name: str, *arguments: Any) -> None:
    """Call a function of PETSc's library that petsc4py does not provide."""
    function = getattr(ctypes.CDLL(PETSc.__file__), name)
    pointers = (ctypes.c_void_p(a) if isinstance(a, int) else a for a in arguments)
    if code := function(*pointers):
        raise PETSc.Error(code)


class UnitForces:
    """Compliance G of a bulk, by solves for unit forces or by one Schur complement.

    Args:
        effective: The bulk, A.
        operator: B with zero columns at constrained dofs, three rows per joint point.

    Attributes:
        local: Number of the rank's joint unknowns.
    """

    def __init__(self, effective: EffectiveMatrix, operator: PETSc.Mat) -> None:
        """Allocate work vectors (collective)."""
        self._effective, self._operator = effective, operator
        self.local = operator.getLocalSize()[0]
        self._points = operator.createVecLeft()
        self._nodal, self._moved = operator.createVecRight(), operator.createVecRight()

    @cached_property
    def _rows(self) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Rows of B of this rank: starts, columns and values."""
        starts, columns, values = self._operator.getValuesCSR()
        return starts, columns, values

    @cached_property
    def _columns(self) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Entries of the rank's columns of B, sorted by row: rows, local columns and values.

        The first use is collective.
        """
        transposed = self._operator.transpose(PETSc.Mat())
        starts, numbers, entries = transposed.getValuesCSR()
        transposed.destroy()
        order = np.argsort(numbers, kind="stable")
        lines = np.repeat(np.arange(len(starts) - 1), np.diff(starts))[order]
        return numbers[order], lines, entries[order]

    def gaps(self, numbers: Ints) -> Floats:
        """Return columns of G at the rank's points, shape (local, k), [m/N] (collective).

        Args:
            numbers: Numbers of the unknowns with unit forces, shape (k,).
        """
        columns = np.empty((self.local, len(numbers)))
        # Larger blocks of right-hand sides take as much memory as the body and save no time.
        for first in range(0, len(numbers), limits.BLOCK_COLUMNS):
            block = slice(first, first + limits.BLOCK_COLUMNS)
            columns[:, block] = self._block(numbers[block])
        return columns

    def at_once(self) -> Floats | None:
        """Return all columns of G at the rank's points, shape (size, local), [m/N] (collective).

        Return None, with a warning, if the Schur complement fails.
        """
        size, rank = self._operator.getSize()[0], self._operator.comm.rank
        samples = np.unique(np.linspace(0, size - 1, limits.SAMPLES).astype(np.int64))
        expected = self.gaps(samples)  # also detects a singular bulk
        if rank == 0:
            LOGGER.info("compliance of the joints: %d columns by one factorization", size)
        try:
            columns = schur_complement(self._effective.constrained, self._operator)
            for first in range(0, size, limits.BLOCK_COLUMNS):
                numbers = np.arange(first, min(first + limits.BLOCK_COLUMNS, size))
                columns[numbers] -= self._modal_gaps(numbers).T
            self._compare(columns[samples].T, expected)
        except (JointsError, PETSc.Error, MemoryError) as error:
            if rank == 0:
                LOGGER.warning("compliance of the joints is computed column by column: %s", error)
            return None
        return columns

    def _compare(self, columns: Floats, expected: Floats) -> None:
        """Raise an error if columns differ from the exact ones in ``expected`` (collective)."""
        sizes = np.array([np.abs(gap).max(initial=0.0) for gap in (columns - expected, expected)])
        error, largest = of_ranks(self._operator.comm.tompi4py(), sizes).max(axis=0)
        if not error <= limits.AT_ONCE_ERROR * largest:
            raise JointsError(f"the Schur complement has an error of {error:.1e}/{largest:.1e} m/N")

    def _block(self, numbers: Ints) -> Floats:
        """Return some columns of G, computed in one block solve."""
        solver = self._effective.solver
        if isinstance(solver, DirectSolver) and solver.package == "mumps":
            rows = self._rows_on_rank_0(numbers)
            displacements = solver.solve_sparse(rows)
            rows.destroy()
        else:
            displacements = solver.solve_block(self._right_hand_sides(numbers))
        return multiplied(self._operator, displacements) - self._modal_gaps(numbers)

    @cached_property
    def _modal(self) -> tuple[Floats, Floats] | None:
        """B Z and W of `EffectiveMatrix.modal_parts` (collective on first use)."""
        parts = self._effective.modal_parts()
        if parts is None:
            return None
        return np.ascontiguousarray(multiplied(self._operator, parts[0])), parts[1]

    def _modal_gaps(self, numbers: Ints) -> Floats:
        """Return the part of columns of G due to modes, to be subtracted (collective)."""
        if self._modal is None:
            return np.zeros((self.local, len(numbers)))
        gaps, small = self._modal
        first, stop = self._operator.getOwnershipRange()
        local = np.flatnonzero((numbers >= first) & (numbers < stop))
        modal = np.zeros((len(numbers), len(small)))
        modal[local] = gaps[numbers[local] - first]
        amounts = summed(self._operator.comm.tompi4py(), modal)
        modal_gaps: Floats = gaps @ (small @ amounts.T)
        return modal_gaps

    def _right_hand_sides(self, numbers: Ints) -> Floats:
        """Return the owned rows of B^T for some unknowns, shape (local dofs, k)."""
        rows, lines, entries = self._columns
        firsts = np.searchsorted(rows, numbers)
        counts = np.searchsorted(rows, numbers, side="right") - firsts
        entry = ranges(firsts, counts)
        block = np.zeros((self._operator.getLocalSize()[1], len(numbers)))
        block[lines[entry], np.repeat(np.arange(len(numbers)), counts)] = entries[entry]
        return block

    def _rows_on_rank_0(self, numbers: Ints) -> PETSc.Mat:
        """Return rows of B for some unknowns as a matrix on rank 0 (collective)."""
        starts, columns, values = self._rows
        first, stop = self._operator.getOwnershipRange()
        own_numbers = np.flatnonzero((numbers >= first) & (numbers < stop))
        local = numbers[own_numbers] - first
        counts = starts[local + 1] - starts[local]
        entry, comm = ranges(starts[local], counts), self._operator.comm
        triplets = (np.repeat(own_numbers, counts), columns[entry], values[entry])
        parts = comm.tompi4py().gather(triplets, root=0)
        count, dofs = 0 if parts is None else len(numbers), self._operator.getSize()[1]
        empty = tuple(part[:0] for part in triplets)
        at, columns, values = (
            np.concatenate(arrays) for arrays in zip(*(parts or [empty]), strict=True)
        )
        order = np.argsort(at, kind="stable")
        starts = np.append(0, np.cumsum(np.bincount(at, minlength=count)[:count]))
        return PETSc.Mat().createAIJ(
            ((count, len(numbers)), (dofs if count else 0, dofs)),
            csr=(starts.astype(PETSc.IntType), columns[order], values[order]),
            comm=comm,
        )

    def product(self, forces: Floats) -> Floats:
        """Return G F at the rank's points, for F at the rank's points (collective)."""
        self._load(forces)
        self._effective.solve(self._nodal, self._moved)
        return self._gaps()

    def rough_product(self, forces: Floats, tolerance: float) -> Floats:
        """Return G F to a tolerance, for a bulk solved by iteration (collective)."""
        assert isinstance(self._effective.solver, IterativeSolver)
        self._load(forces)
        self._effective.solve(self._nodal, self._moved, tolerance=tolerance)
        return self._gaps()

    def diagonal(self) -> Floats:
        """Return an estimate of the diagonal of G at the rank's points, [m/N] (collective).

        The estimate, shape (local,), is the diagonal of B diag(A)^-1 B^T times a factor for normal
        and a factor for tangential directions. Each factor is the median ratio of exact and
        estimated values at a few points. The iteration converges with any estimate, fast with this.
        """
        comm = self._operator.comm.tompi4py()
        estimate = diagonal_compliance(self._operator, self._effective.constrained.getDiagonal())
        size = self._operator.getSize()[0]
        points = np.unique(np.linspace(0, size // 3 - 1, limits.SAMPLES).astype(np.int64))
        numbers = unknowns_of(points)
        start, stop = self._operator.getOwnershipRange()
        gaps = self.gaps(numbers)
        local = np.flatnonzero((numbers >= start) & (numbers < stop))
        samples = np.zeros((2, len(numbers)))
        samples[:, local] = gaps[numbers[local] - start, local], estimate[numbers[local] - start]
        exact, estimated = summed(comm, samples)
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.where(estimated > 0.0, exact / estimated, np.nan).reshape(-1, 3)
        factors = [_median(ratio[:, :1]), *2 * [_median(ratio[:, 1:])]]
        return estimate * np.tile(factors, len(estimate) // 3)

    def _load(self, forces: Floats) -> None:
        """Compute the nodal forces of joint forces."""
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
    """Return the median of the finite positive values, or 1."""
    valid = ratio[np.isfinite(ratio) & (ratio > 0.0)]
    return float(np.median(valid)) if len(valid) else 1.0


def ranges(firsts: NDArray[Any], counts: NDArray[Any]) -> NDArray[Any]:
    """Return ranges of numbers, one after the other, by their first numbers and lengths."""
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    numbers: NDArray[Any] = np.repeat(firsts, counts) + within
    return numbers
