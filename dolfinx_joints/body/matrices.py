# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Conversion of assembled matrices and vectors: blocks per node, no zeros, no ghosts."""

from __future__ import annotations

from typing import Any

import dolfinx
import numpy as np
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.mpi import lasting


def blocked(matrix: PETSc.Mat) -> PETSc.Mat:
    """Convert a matrix to blocks per node, which makes products in time steps faster.

    The whole matrix is stored even if it is symmetric. PETSc's symmetric format reads beyond its
    arrays if the last rows are empty, as for dashpots on a boundary. It would also hide an
    unsymmetric K.
    """
    return matrix.convert("baij")


def assembled_blocks(form: fem.Form, comm: Any) -> PETSc.Mat:
    """Assemble a form in blocks per node, on a communicator that outlives the mesh (collective)."""
    pattern = dolfinx.cpp.fem.create_sparsity_pattern(form._cpp_object)
    pattern.finalize()
    matrix = dolfinx.cpp.la.petsc.create_matrix(lasting(comm), pattern, "baij")
    fem_petsc.assemble_matrix(matrix, form)
    matrix.assemble()
    return matrix


def assembled_nonzeros(form: fem.Form, components: int) -> PETSc.Mat:
    """Assemble a form without zeros off the diagonal, two thirds of M (collective)."""
    matrix = fem_petsc.create_matrix(form)
    matrix.setOption(PETSc.Mat.Option.IGNORE_ZERO_ENTRIES, True)
    fem_petsc.assemble_matrix(matrix, form)
    return on_lasting_comm(matrix, components)


def on_lasting_comm(assembled: PETSc.Mat, components: int) -> PETSc.Mat:
    """Move a matrix to a communicator that exists longer than the mesh communicator (collective).

    ``components`` is the number of dofs per node.
    """
    assembled.assemble()
    comm = lasting(assembled.comm.tompi4py())
    matrix = from_rows(assembled.getSizes(), assembled.getValuesCSR(), comm, components)
    assembled.destroy()
    return matrix


def from_rows(sizes: Any, csr: tuple[Any, Any, Any], comm: Any, block: int = 1) -> PETSc.Mat:
    """Return a matrix from the CSR rows of each rank: starts, columns, values (collective)."""
    starts, columns, values = csr
    csr = starts.astype(PETSc.IntType), columns.astype(PETSc.IntType), values
    matrix = PETSc.Mat().createAIJ(sizes, bsize=block, csr=csr, comm=comm)
    matrix.assemble()
    return matrix


def rigid_modes(matrix: PETSc.Mat, nodes: NDArray[np.float64]) -> PETSc.NullSpace:
    """Return the rigid body modes, the near null space for multigrid (collective).

    ``nodes`` are the coordinates of the rank's nodes, owned ones first, shape (n, 3), [m].
    """
    places, gdim = matrix.createVecRight(), matrix.getBlockSize()
    places.setArray(nodes[: places.getLocalSize() // gdim, :gdim].ravel())
    return PETSc.NullSpace().createRigidBody(places)


def without_zeros(matrix: PETSc.Mat) -> PETSc.Mat:
    """Remove zeros off the diagonal, which added masses may contain."""
    starts, columns, values = matrix.getValuesCSR()
    rows = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    stays = (values != 0.0) | (columns == rows + matrix.getOwnershipRange()[0])
    counts = np.bincount(rows[stays], minlength=len(starts) - 1)
    csr = np.append(0, np.cumsum(counts)), columns[stays], values[stays]
    thin = from_rows(matrix.getSizes(), csr, matrix.comm, matrix.getBlockSize())
    matrix.destroy()
    return thin


def without_ghosts(vector: PETSc.Vec, matrix: PETSc.Mat) -> PETSc.Vec:
    """Return the owned part of a ghosted vector in the layout of a matrix."""
    plain = matrix.createVecRight()
    plain.setArray(vector.getArray(readonly=True)[: plain.getLocalSize()])
    return plain
