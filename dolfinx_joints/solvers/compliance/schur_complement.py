# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""G = B A^-1 B^T of all joint unknowns at once, as a Schur complement computed by MUMPS (20a).

The factorization eliminates the dofs in dense fronts, which the ranks share and which contain the
joint unknowns. Back-substitutions would read the factor twice for each block of columns.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.diagnosis import reported_by_package

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
