# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Assembled matrices in the form that a run keeps: blocks of a node, no zeros, no ghosts."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.mpi import lasting


def blocked(matrix: PETSc.Mat) -> PETSc.Mat:
    """The matrix in blocks of a node: its products, which time steps wait for, are faster.

    Whole, even if symmetric: PETSc's product with half a matrix reads beyond it where the last rows
    are empty, as those of dashpots on a boundary, and would hide that K is not symmetric after all.
    """
    return matrix.convert("baij")


def kept(assembled: PETSc.Mat, components: int) -> PETSc.Mat:
    """Move a matrix to a communicator that outlives the mesh, which frees its own (collective).

    A node has so many ``components``.
    """
    assembled.assemble()
    comm = lasting(assembled.comm.tompi4py())
    matrix = from_rows(assembled.getSizes(), assembled.getValuesCSR(), comm, components)
    assembled.destroy()
    return matrix


def from_rows(sizes: Any, csr: tuple[Any, Any, Any], comm: Any, block: int = 1) -> PETSc.Mat:
    """Return a matrix from each rank's rows: starts, columns and values (collective)."""
    starts, columns, values = csr
    csr = starts.astype(PETSc.IntType), columns.astype(PETSc.IntType), values
    matrix = PETSc.Mat().createAIJ(sizes, bsize=block, csr=csr, comm=comm)
    matrix.assemble()
    return matrix


def rigid_modes(matrix: PETSc.Mat, nodes: NDArray[np.float64]) -> PETSc.NullSpace:
    """Translations and rotations, which multigrid takes to its coarse levels (collective).

    ``nodes`` are coordinates of the rank's nodes, its own first, shape (n, 3), [m].
    """
    places, gdim = matrix.createVecRight(), matrix.getBlockSize()
    places.setArray(nodes[: places.getLocalSize() // gdim, :gdim].ravel())
    return PETSc.NullSpace().createRigidBody(places)


def without_zeros(matrix: PETSc.Mat) -> PETSc.Mat:
    """The matrix without zeros off its diagonal: two thirds of M, which couples no components."""
    starts, columns, values = matrix.getValuesCSR()
    rows = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    kept = (values != 0.0) | (columns == rows + matrix.getOwnershipRange()[0])
    counts = np.bincount(rows[kept], minlength=len(starts) - 1)
    csr = np.append(0, np.cumsum(counts)), columns[kept], values[kept]
    thin = from_rows(matrix.getSizes(), csr, matrix.comm, matrix.getBlockSize())
    matrix.destroy()
    return thin


def without_ghosts(vector: PETSc.Vec, matrix: PETSc.Mat) -> PETSc.Vec:
    """The owned part of a ghosted vector in the layout of a matrix."""
    plain = matrix.createVecRight()
    plain.setArray(vector.getArray(readonly=True)[: plain.getLocalSize()])
    return plain
