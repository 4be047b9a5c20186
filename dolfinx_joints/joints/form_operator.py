# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Functions on the joints and the operator by interior-facet integrals, the reference for B.

With q a test function at the quadrature points of the joints, and w their areas,

    jump      g = (1/w) int_joints q . [u] dS
    force     f(v) = int_joints t . [v] dS                  (3, paper 2)
    tangent   a(u, v) = int_joints D [u] . [v] dS           (11, paper 6)

are assembled by DOLFINx. Traction t and tangent D come from the return mapping at the points and
are Functions on the joints. This operator and B are the same sum over points. B stores the
coefficients of g and is therefore several times faster.
"""

from __future__ import annotations

import basix
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc

from dolfinx_joints.common.mpi import lasting
from dolfinx_joints.joints.operator import GapOperator, JointOperator
from dolfinx_joints.joints.points import JointPoints
from dolfinx_joints.mesh.cells import Floats, Ints
from dolfinx_joints.mesh.facet_quadrature import facet_cell_type, vertex_functions
from dolfinx_joints.mesh.joint_surface import JointSurface


class PointExchange:
    """Transfer between joint points, distributed in equal blocks, and facet quadrature points."""

    def __init__(self, surface: JointSurface, layout: JointPoints, count: int) -> None:
        number = surface.number
        order = _order_of_integration(layout.rule, surface.vertex_order)
        self._point = np.take_along_axis(layout.number[number], order, axis=1).ravel()
        self._share = np.take_along_axis(layout.share[number], order, axis=1).reshape(-1, 1)
        self._comm, self._count = surface.mesh.comm, count
        self._parts: dict[int, tuple[PETSc.Vec, PETSc.Vec, PETSc.Scatter]] = {}

    def set_function(self, function: fem.Function, values: Floats) -> None:
        """Set a quadrature Function from values at joint points, shape (n, k) (collective)."""
        array = function.x.array.reshape(-1, values.shape[1])
        array[function.function_space.dofmap.list.ravel()] = self.to_facets(values)

    def to_facets(self, values: Floats) -> Floats:
        """Return values of joint points, shape (n, k), at the facet points (collective)."""
        points, facets, scatter = self._exchange(values.shape[1])
        points.setArray(values.ravel())
        scatter.scatter(points, facets)
        return facets.getArray().reshape(-1, values.shape[1]).copy()

    def to_points(self, values: Floats) -> Floats:
        """Return area-weighted means over the facets around joint points, (n, k) (collective)."""
        points, facets, scatter = self._exchange(values.shape[1])
        facets.setArray((self._share * values).ravel())
        points.set(0.0)
        scatter.scatter(facets, points, addv=True, mode=PETSc.ScatterMode.REVERSE)
        return points.getArray().reshape(-1, values.shape[1]).copy()

    def _exchange(self, size: int) -> tuple[PETSc.Vec, PETSc.Vec, PETSc.Scatter]:
        if size not in self._parts:
            points = PETSc.Vec().createMPI((size * self._count, None), comm=lasting(self._comm))
            facets = PETSc.Vec().createSeq(size * len(self._point), comm=PETSc.COMM_SELF)
            rows = PETSc.IS().createBlock(
                size, self._point.astype(PETSc.IntType), comm=PETSc.COMM_SELF
            )
            self._parts[size] = (points, facets, PETSc.Scatter().create(points, rows, facets, None))
        return self._parts[size]


def _order_of_integration(rule: Floats, vertex_order: Ints) -> Ints:
    """Return the rule point of each quadrature point of an integral, shape (facets, q).

    Args:
        rule: Points on the reference facet; each vertex order must give the same set of points.
        vertex_order: `IntegratedPairs.vertex_order`, shape (facets, vertices per facet).
    """
    corners = basix.cell.geometry(facet_cell_type(vertex_order.shape[1]))
    weights = vertex_functions(vertex_order.shape[1], rule)
    kinds, of_facet = np.unique(vertex_order, axis=0, return_inverse=True)
    distance = np.linalg.norm((weights @ corners[kinds])[:, :, None] - rule, axis=3)
    if np.any(distance.min(axis=2, initial=np.inf) > 1e-9):
        raise ValueError("The quadrature rule depends on a facet's vertex order; use another rule.")
    return distance.argmin(axis=2)[of_facet.ravel()]


class FormOperator(GapOperator):
    """Joint operator whose jump, force and tangent are assembled from forms.

    Args:
        operator: Joint operator that provides points, areas and frames.
    """

    def __init__(self, operator: JointOperator) -> None:
        """Compile the forms (collective)."""
        super().__init__(operator.matrix, operator.areas, operator.joint, operator.names)
        self.initial_gap, self.points, self.sizes = (
            operator.initial_gap,
            operator.points,
            operator.sizes,
        )
        V, jointed, layout = operator.space, operator.jointed, operator.layout
        self._dim = V.mesh.geometry.dim
        self._axes = operator.frames[:, :, : self._dim]
        surface = jointed.surface()
        self._exchange = PointExchange(surface, layout, len(operator.areas))
        rule = operator.quadrature, V.ufl_element().degree
        vectors = surface.quadrature_space(*rule, (self._dim,))
        tensors = surface.quadrature_space(*rule, (self._dim, self._dim))
        self._dofs = vectors.dofmap.list.ravel()
        self._u, self._traction = fem.Function(V), fem.Function(vectors)
        self._tangent = fem.Function(tensors)
        u, v, q = ufl.TrialFunction(V), ufl.TestFunction(V), ufl.TestFunction(vectors)
        dS = jointed.dS(quadrature=rule[0], degree=rule[1])
        t, D = self._traction("-"), self._tangent("-")
        one = fem.Constant(V.mesh, np.ones(self._dim))
        self._jump_form, areas, self._force_form, self.tangent_form = (
            fem.form(form, entity_maps=surface.entity_maps)
            for form in (
                ufl.inner(ufl.jump(self._u), q("-")) * dS,
                ufl.inner(one, q("-")) * dS,
                ufl.inner(t, ufl.jump(v)) * dS,
                ufl.inner(D * ufl.jump(u), ufl.jump(v)) * dS,
            )
        )
        self._force = self._u.x.petsc_vec.duplicate()
        self._areas = self._assemble_by_facet(areas)

    def jump(self, u: PETSc.Vec) -> Floats:
        """Return the displacement jump at the local points, shape (n, 3), [m] (collective)."""
        u.copy(self._u.x.petsc_vec)
        self._u.x.scatter_forward()
        jump = self._exchange.to_points(self._assemble_by_facet(self._jump_form) / self._areas)
        return np.einsum("nki,ni->nk", self._axes, jump)

    def force(self, traction: Floats, out: PETSc.Vec) -> PETSc.Vec:
        """Compute the nodal forces (3), [N] (collective)."""
        self._exchange.set_function(self._traction, np.einsum("nki,nk->ni", self._axes, traction))
        with self._force.localForm() as local:
            local.set(0.0)
        fem_petsc.assemble_vector(self._force, self._force_form)
        self._force.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        self._force.copy(out)
        return out

    def tangent_matrix(self, free: PETSc.Vec) -> FormTangent:
        """Return the tangent assembler (11); see `GapOperator.tangent_matrix` (collective)."""
        return FormTangent(self, free)

    def assemble_tangent(self, tangent: Floats, out: PETSc.Mat) -> None:
        """Assemble the tangent (11) [N/m] of point tangents (n, 3, 3), [Pa/m] (collective)."""
        axes = self._axes
        rotated = np.einsum("nki,nkl,nlj->nij", axes, tangent, axes)
        self._exchange.set_function(self._tangent, rotated.reshape(len(rotated), -1))
        out.zeroEntries()
        fem_petsc.assemble_matrix(out, self.tangent_form)
        out.assemble()

    def _assemble_by_facet(self, form: fem.Form) -> Floats:
        """Assemble a linear form of a quadrature space; return vectors by facet, (m, dim)."""
        values = fem.assemble_vector(form).array.reshape(-1, self._dim)
        return values[self._dofs]


class FormTangent:
    """Assembler of joint tangents by a form; reuses the sparsity pattern.

    Rows and columns of constrained dofs (``free`` is 0) are zero.
    """

    def __init__(self, operator: FormOperator, free: PETSc.Vec) -> None:
        """Create the matrix (collective)."""
        self.comm, self.joints = operator.comm, None
        self._operator, self._free = operator, free
        self._matrix = fem_petsc.create_matrix(operator.tangent_form)

    def assemble(self, tangent: Floats, *, coupled: bool = True) -> PETSc.Mat:
        """Return the tangent [N/m] of point tangents (n, 3, 3), [Pa/m] (collective).

        ``coupled`` has no effect.
        """
        self._operator.assemble_tangent(tangent, self._matrix)
        self._matrix.diagonalScale(self._free, self._free)
        return self._matrix
