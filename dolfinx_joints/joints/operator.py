# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint operator without friction: gap = B u, force = B^T (w t), tangent = B^T (w D) B.

This module defines the sign convention: the jump is u+ - u- and the normal n points from the - to
the + side. Thus gap_n > 0 is open and t_n < 0 is compression. `orientation.orient_pairs` chooses
the sides and `joint_pairs` the tangential axes.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, Protocol

import basix
import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.sparse import coo_array

from dolfinx_joints.common.arrays import Flags, Floats, Ints
from dolfinx_joints.common.mpi import gathered, lasting, rows_at
from dolfinx_joints.joints.points import JointPoints, joint_points
from dolfinx_joints.mesh.facet_quadrature import vertex_functions
from dolfinx_joints.mesh.jointed_mesh import JointedMesh, local_cells

# Smaller entries of B are rounding error (the others are of order one) and are dropped. Products
# with B are then several times faster for nodal rules and joints parallel to the axes.
ROUNDING = 1e-14


class TangentMatrix(Protocol):
    """Assembler of tangent matrices; ``joints`` is B with zero columns at constrained dofs."""

    comm: Any
    joints: PETSc.Mat | None

    def assemble(self, tangent: Floats, *, coupled: bool = True) -> PETSc.Mat:
        """Return the matrix, [N/m]; if not ``coupled``, a symmetric approximation (collective)."""


class GapOperator:
    """Matrix B and the area of each point: gap = B u, force = B^T (w t).

    Solvers need only B, the areas and the laws. `JointOperator` builds B from a mesh; any matrix
    with three rows (n, s1, s2) per point can be used.

    Args:
        matrix: B, shape (3 num_points, num_dofs); all rows of a point are on one rank.
        areas: Areas w of the local points, shape (n,), [m^2].
        joint: Joint number of each local point, shape (n,).
        names: Joint names.

    Attributes:
        comm: Communicator of the matrix.
        initial_gap: Gap before any displacement, shape (n, 3), [m].
        points: Coordinates of the local points, shape (n, 3), [m]; None without a mesh.
        sizes: Element size at each local point, shape (n,), [m]: the shortest edge of the facets
            that share the point; None without a mesh.
    """

    points: Floats | None = None
    sizes: Floats | None = None

    def __init__(
        self, matrix: PETSc.Mat, areas: Floats, joint: Ints, names: tuple[str, ...]
    ) -> None:
        """Store the arguments and create a work vector (collective)."""
        self.matrix, self.areas, self.joint, self.names = matrix, areas, joint, names
        self.comm = matrix.comm.tompi4py()
        self.initial_gap: Floats = np.zeros((len(areas), 3))
        self._work = matrix.createVecLeft()

    @property
    def num_points(self) -> int:
        """Number of points on all ranks."""
        return int(self.matrix.getSize()[0] // 3)

    @cached_property
    def tied(self) -> Flags:
        """True for local points that can neither open nor slide (zero rows of B), shape (n,).

        At the end of a joint inside a body both sides share their nodes.
        """
        starts, _, values = self.matrix.getValuesCSR()
        moves = np.zeros(len(starts) - 1, dtype=bool)
        moves[np.repeat(np.arange(len(moves)), np.diff(starts))[values != 0.0]] = True
        return ~(moves[0::3] | moves[1::3] | moves[2::3])

    def jump(self, u: PETSc.Vec) -> Floats:
        """Return B u at the local points, shape (n, 3), [m] (collective)."""
        self.matrix.mult(u, self._work)
        return self._work.getArray(readonly=True).reshape(-1, 3).copy()

    def force(self, traction: Floats, out: PETSc.Vec) -> PETSc.Vec:
        """Compute the nodal forces B^T (w t), [N] (collective).

        Args:
            traction: Tractions of the local points, shape (n, 3), [Pa].
            out: Vector that receives the forces.
        """
        self._work.setArray((self.areas[:, None] * traction).ravel())
        self.matrix.multTranspose(self._work, out)
        return out

    def tangent_matrix(self, free: PETSc.Vec) -> TangentMatrix:
        """Return the assembler of B^T (w D) B; ``free`` is 0 at constrained dofs (collective)."""
        return JointTangent(self, free)

    def constrained(self, free: PETSc.Vec) -> PETSc.Mat:
        """Return B with zero columns at constrained dofs, where ``free`` is 0, else 1."""
        matrix = self.matrix.copy()
        matrix.diagonalScale(R=free)
        return matrix

    def gather(self, values: NDArray[Any]) -> NDArray[Any] | None:
        """Return the values of all points in global order on rank 0, else None (collective)."""
        return gathered(self.comm, values)


class JointOperator(GapOperator):
    """Gap operator of the joints of a mesh.

    gap = B u, B = R N (2), force = B^T (w t) (3), tangent = B^T (w D) B (11). The rows of R are the
    axes n, s1, s2; N are the shape functions of both sides. All ranks have equally many points,
    whose order does not depend on the number of ranks or on the mesh partition.

    Args:
        jointed: Mesh with its facet pairs.
        V: Vector Lagrange space of degree 1 or 2 on ``jointed.mesh``.
        quadrature: ``auto``, ``nodal``, ``gauss`` or a degree, see `facet_rule`.

    Attributes:
        space: The space V.
        layout: Joint points and facets of this rank.
        frames: Rows n, s1, s2 of each local point, shape (n, 3, 3).

    Raises:
        ValueError: The quadrature rule does not exist on these facets.
    """

    def __init__(self, jointed: JointedMesh, V: Any, *, quadrature: str | int = "auto") -> None:
        """Build B (collective)."""
        comm = jointed.mesh.comm
        self.points: Floats
        self.frames: Floats
        self.jointed, self.space, self.quadrature = jointed, V, quadrature
        pairs = jointed.pairs
        self.layout = joint_points(comm, pairs, jointed.shape, V.ufl_element().degree, quadrature)
        self.points, self.frames = self.layout.points, self.layout.frames
        self.sizes = self.layout.sizes
        matrix = _assemble_operator(jointed, V, self.layout)
        super().__init__(matrix, self.layout.areas, self.layout.joint, pairs.names)
        if jointed.pairs.gaps_in_geometry:
            self.initial_gap = self.jump(_coordinates(V))
            # Set the gap of touching faces to zero: positive rounding error would be an opening.
            touching = np.abs(self.initial_gap[:, 0]) < 1e-9 * np.sqrt(self.areas)
            self.initial_gap[touching, 0] = 0.0


class JointTangent:
    """Assembler of B^T (w D) B for point tangents D; reuses the sparsity pattern.

    Rows and columns of constrained dofs (``free`` is 0) are zero.
    """

    def __init__(self, operator: GapOperator, free: PETSc.Vec) -> None:
        """Create the matrices (collective)."""
        self.comm = operator.comm
        self._areas = operator.areas
        self.joints = operator.constrained(free)
        rows = operator.matrix.getSizes()[0]
        self._points = PETSc.Mat().createAIJ((rows, rows), nnz=(3, 0), comm=operator.comm)
        start, stop = self._points.getOwnershipRange()
        self._starts = np.arange(0, 3 * (stop - start) + 1, 3, dtype=PETSc.IntType)
        first = np.repeat(np.arange(start, stop, 3, dtype=PETSc.IntType), 3)
        self._columns = (first[:, None] + np.arange(3, dtype=PETSc.IntType)).ravel()
        self._products: dict[bool, PETSc.Mat] = {}

    def assemble(self, tangent: Floats, *, coupled: bool = True) -> PETSc.Mat:
        """Return the tangent [N/m] of point tangents (n, 3, 3), [Pa/m] (collective).

        If not ``coupled``, the tangent is symmetrised without normal-shear coupling.
        """
        if not coupled:
            tangent = 0.5 * (tangent + tangent.transpose(0, 2, 1))
            tangent[:, 0, 1:] = tangent[:, 1:, 0] = 0.0
        values = (self._areas[:, None, None] * tangent).ravel()
        self._points.setValuesCSR(self._starts, self._columns, values)
        self._points.assemble()
        product = self._points.PtAP(self.joints, result=self._products.get(coupled))
        self._products[coupled] = product
        return product

    def coarse(self, interpolation: PETSc.Mat) -> Callable[[], PETSc.Mat]:
        """Return a function that computes P^T B^T (w D) B P for the last tangent (collective).

        The product B P is computed first; otherwise each rank would store a copy of P.
        """
        operator = self.joints.matMult(interpolation)
        product: PETSc.Mat | None = None

        def make() -> PETSc.Mat:
            nonlocal product
            product = self._points.PtAP(operator, result=product)
            return product

        return make


def _assemble_operator(jointed: JointedMesh, V: Any, layout: JointPoints) -> PETSc.Mat:
    """Assemble B from the basis functions of the cells on both sides.

    A rank adds the facets whose - cell it owns; PETSc sends the entries to the owner of the row.
    Facets that share a point contribute in proportion to their areas.
    """
    mesh, facet_dim = jointed.mesh, jointed.shape.dim - 1
    index_map, bs = V.dofmap.index_map, V.dofmap.index_map_bs
    columns = (index_map.size_local * bs, index_map.size_global * bs)
    entries = 2 * bs * len(V.element.basix_element.entity_closure_dofs[facet_dim][0])
    matrix = PETSc.Mat().createAIJ(
        ((3 * len(layout.areas), None), columns), nnz=(entries, entries), comm=lasting(mesh.comm)
    )
    matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
    row, column, value = _side_entries(jointed, V, layout)
    own_rows, row = np.unique(row, return_inverse=True)
    sides = coo_array((value, (row, column)), shape=(len(own_rows), columns[1])).tocsr()
    sides.data[np.abs(sides.data) < ROUNDING] = 0.0
    sides.eliminate_zeros()
    matrix.setValuesIJV(
        sides.indptr.astype(PETSc.IntType),
        sides.indices.astype(PETSc.IntType),
        sides.data,
        addv=PETSc.InsertMode.ADD_VALUES,
        rowmap=own_rows.astype(PETSc.IntType),
    )
    matrix.assemble()
    return matrix


def diagonal_compliance(operator: PETSc.Mat, diagonal: PETSc.Vec) -> Floats:
    """Return diag(B diag(A)^-1 B^T), an estimate of the compliance, (local rows,), [m/N]."""
    squares, inverse = operator.copy(), diagonal.copy()
    starts, columns, values = squares.getValuesCSR()
    squares.setValuesCSR(starts, columns, values**2)
    squares.assemble()
    inverse.reciprocal()
    rows = squares.createVecLeft()
    squares.mult(inverse, rows)
    compliance: Floats = rows.getArray().copy()
    for work in (squares, inverse, rows):
        work.destroy()
    return compliance


def _side_entries(jointed: JointedMesh, V: Any, layout: JointPoints) -> tuple[Ints, Ints, Floats]:
    """Return rows, columns and values that the facets of this rank add to B (collective).

    Sides with the same reference facet and orientation share a table of basis functions and are
    processed together.
    """
    pairs, shape, mesh = jointed.pairs, jointed.shape, jointed.mesh
    element, bs = V.element.basix_element, V.dofmap.index_map_bs
    on_facet = np.array(element.entity_closure_dofs[shape.dim - 1], dtype=np.int64)
    corners = basix.cell.geometry(shape.type)
    slots = np.concatenate([pairs.minus, pairs.plus])
    same = np.broadcast_to(np.arange(pairs.match.shape[1]), pairs.match.shape)
    match = np.concatenate([same, pairs.match])
    local = local_cells(mesh, slots[:, 0])
    frames = rows_at(mesh.comm, layout.frames, layout.number.ravel())
    frames = frames.reshape(*layout.number.shape, 3, 3)
    kinds, kind = np.unique(np.column_stack([slots[:, 1], match]), axis=0, return_inverse=True)
    dofs = V.dofmap.list
    parts: list[tuple[Ints, Ints, Floats]] = []
    for number, (facet, *order) in enumerate(kinds):
        sides = np.flatnonzero(kind.ravel() == number)
        vertices = corners[shape.facet_vertices[facet]][order]
        basis = _side_table(element, layout.rule, vertices)[:, on_facet[facet]]
        q, a = np.nonzero(basis)
        pair, sign = sides % len(pairs.joint), np.where(sides < len(pairs.joint), -1.0, 1.0)
        points = layout.number[pair][:, q]
        nodes = dofs[local[sides]][:, on_facet[facet][a]]
        blocks = V.dofmap.index_map.local_to_global(nodes.ravel()).reshape(nodes.shape)
        share = sign[:, None] * layout.share[pair][:, q] * basis[q, a]
        value = frames[pair][:, q, :, :bs] * share[:, :, None, None]
        row = 3 * points[:, :, None, None] + np.arange(3)[:, None]
        column = bs * blocks[:, :, None, None] + np.arange(bs)
        row, column = np.broadcast_arrays(row, column)
        parts.append((row.ravel(), column.ravel(), value.ravel()))
    if not parts:
        none = np.empty(0, dtype=np.int64)
        return none, none, np.empty(0)
    rows, columns, values = zip(*parts, strict=True)
    return np.concatenate(rows), np.concatenate(columns), np.concatenate(values)


def _side_table(element: Any, rule: Floats, vertices: Floats) -> Floats:
    """Return the basis functions of a cell at the rule's points on a facet, shape (q, a).

    ``vertices`` are the facet vertices in the order of the - side, in reference coordinates.
    """
    position = vertex_functions(len(vertices), rule) @ vertices
    table: Floats = element.tabulate(0, position)[0, :, :, 0]
    table[np.abs(table) < ROUNDING] = 0.0  # at a node only one function is nonzero
    return table


def _coordinates(V: Any) -> PETSc.Vec:
    from dolfinx import fem

    x = fem.Function(V)
    gdim = V.mesh.geometry.dim
    x.interpolate(lambda points: points[:gdim])
    return x.x.petsc_vec
