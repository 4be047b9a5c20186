# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Transfer of values between joint points and Functions on a joint surface."""

from __future__ import annotations

import basix
import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from dolfinx_joints.common.mpi import lasting
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
