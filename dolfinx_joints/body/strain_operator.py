# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Strain operator of given cells: strain = P u, force = P^T (w stress), tangent = P^T (w D) P.

The operator corresponds to the gap operator of joints; the material laws return the stress.
"""

from __future__ import annotations

from typing import Any

import basix
import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.body.elasticity import IN_PLANE, strain_vector
from dolfinx_joints.body.quadrature import law_degree
from dolfinx_joints.common.mpi import lasting, positions
from dolfinx_joints.mesh.cells import Floats, Ints
from dolfinx_joints.mesh.jointed_mesh import JointedMesh

# Number of strain components in 3-D.
SIZE = 6

_CHUNK = 512  # number of cells evaluated together


class StrainOperator:
    """Matrix P and the volume of each point: strain = P u, force = P^T (w stress).

    Strains are (xx, yy, zz, 2 yz, 2 xz, 2 xy); in 2-D out-of-plane strains are zero. Each rank has
    the points of its owned ``cells``. The columns of ``matrix`` are the dofs of V.

    Attributes:
        matrix: P, shape (6 num_points, num_dofs).
        volumes: Volume w of the local points, shape (n,), [m^3]; [m^2] in 2-D.
        cells: Cell of each local point, shape (n,).
    """

    def __init__(self, jointed: JointedMesh, V: Any, cells: Ints, matrix: PETSc.Mat) -> None:
        """Evaluate the gradients of the basis functions (collective)."""
        mesh = jointed.mesh
        owned = mesh.topology.index_map(mesh.topology.dim).size_local
        local = np.unique(cells[cells < owned]).astype(np.int32)
        rule = law_degree(jointed.shape, V.ufl_element().degree)
        points, weights = basix.make_quadrature(jointed.shape.type, rule)
        self.comm, self._mesh, self._per_cell = lasting(mesh.comm), mesh, len(weights)
        self.cells: Ints = np.repeat(local, len(weights)).astype(np.int64)
        scale = fem.Expression(abs(ufl.JacobianDeterminant(mesh)), points, comm=mesh.comm)
        self.volumes = np.asarray(scale.eval(mesh, local)).ravel() * np.tile(weights, len(local))
        self.matrix = self._assemble(V, local, points, matrix)
        self._work = self.matrix.createVecLeft()

    def _assemble(self, V: Any, cells: NDArray[Any], points: Floats, like: PETSc.Mat) -> PETSc.Mat:
        """Assemble P with the rows of this rank's points."""
        gdim = V.mesh.geometry.dim
        components = np.arange(SIZE) if gdim == 3 else np.array(IN_PLANE)
        expression = strain_vector(ufl.TrialFunction(V))
        evaluate = fem.Expression(expression, points, comm=V.mesh.comm)
        dofmap = V.dofmap
        entries = dofmap.list.shape[1] * gdim
        matrix = PETSc.Mat().createAIJ(
            ((SIZE * len(self.volumes), None), like.getSizes()[1]),
            nnz=(entries, entries),
            comm=self.comm,
        )
        first = matrix.getOwnershipRange()[0]
        for start in range(0, len(cells), _CHUNK):
            chunk = cells[start : start + _CHUNK]
            values = np.asarray(evaluate.eval(V.mesh, chunk))
            values = values.reshape(len(chunk) * len(points) * len(components), entries)
            blocks = dofmap.index_map.local_to_global(dofmap.list[chunk].ravel())
            columns = (gdim * blocks[:, None] + np.arange(gdim)).reshape(len(chunk), entries)
            columns = np.repeat(columns, len(points) * len(components), axis=0)
            point = start * len(points) + np.arange(len(chunk) * len(points))
            rows = (first + SIZE * point[:, None] + components).ravel()
            matrix.setValuesIJV(
                np.arange(0, columns.size + 1, entries, dtype=PETSc.IntType),
                columns.ravel().astype(PETSc.IntType),
                values.ravel(),
                rowmap=rows.astype(PETSc.IntType),
            )
        matrix.assemble()
        return matrix

    def numbers(self) -> Ints:
        """Return numbers of the local points, in the order of the input mesh (collective)."""
        original = np.asarray(self._mesh.topology.original_cell_index, dtype=np.int64)
        within = np.arange(len(self.cells)) % self._per_cell
        number = self._per_cell * original[self.cells] + within
        count = self._mesh.topology.index_map(self._mesh.topology.dim).size_global
        return positions(self.comm, number, self._per_cell * count)

    @property
    def num_points(self) -> int:
        """Number of points on all ranks."""
        return int(self.matrix.getSize()[0] // SIZE)

    def strain(self, u: PETSc.Vec) -> Floats:
        """Return P u at the local points, shape (n, 6) (collective)."""
        self.matrix.mult(u, self._work)
        return self._work.getArray(readonly=True).reshape(-1, SIZE).copy()

    def force(self, stress: Floats, out: PETSc.Vec) -> PETSc.Vec:
        """Write the forces P^T (w stress) of stresses (n, 6) [Pa] to ``out`` [N] (collective)."""
        self._work.setArray((self.volumes[:, None] * stress).ravel())
        self.matrix.multTranspose(self._work, out)
        return out

    def integral(self, density: Floats) -> float:
        """Return the integral of a value per point (collective)."""
        return float(self.comm.allreduce(float(self.volumes @ density)))


class StrainTangent:
    """Assembler of P^T (w D) P for point tangents D; reuses the sparsity pattern.

    ``unconstrained`` is 1 for unconstrained and 0 for constrained dofs; rows and columns of the
    latter are zero. ``num_points`` is the number of points of this rank.
    """

    def __init__(self, operator: StrainOperator, unconstrained: PETSc.Vec) -> None:
        """Create the matrices (collective)."""
        self.comm, self._volumes = operator.comm, operator.volumes
        self.num_points = len(operator.volumes)
        self._operator = operator.matrix.copy()
        self._operator.diagonalScale(R=unconstrained)
        rows = operator.matrix.getSizes()[0]
        self._points = PETSc.Mat().createAIJ((rows, rows), nnz=(SIZE, 0), comm=operator.comm)
        start, stop = self._points.getOwnershipRange()
        self._starts = np.arange(0, SIZE * (stop - start) + 1, SIZE, dtype=PETSc.IntType)
        first = np.repeat(np.arange(start, stop, SIZE, dtype=PETSc.IntType), SIZE)
        self._columns = (first[:, None] + np.arange(SIZE, dtype=PETSc.IntType)).ravel()
        self._product: PETSc.Mat | None = None

    def assemble(self, tangent: Floats) -> PETSc.Mat:
        """Return the tangent [N/m] of point tangents (n, 6, 6), [Pa] (collective)."""
        values = (self._volumes[:, None, None] * tangent).ravel()
        self._points.setValuesCSR(self._starts, self._columns, values)
        self._points.assemble()
        self._product = self._points.PtAP(self._operator, result=self._product)
        return self._product
