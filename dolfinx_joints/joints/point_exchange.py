# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values of joint points as those of Functions on a joint surface, and back."""

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
    """Carries values between joint points, dealt to the ranks in blocks, and points of facets."""

    def __init__(self, surface: JointSurface, layout: JointPoints, count: int) -> None:
        number = surface.number
        order = _order_of_integration(layout.rule, surface.turned)
        self._point = np.take_along_axis(layout.number[number], order, axis=1).ravel()
        self._share = np.take_along_axis(layout.share[number], order, axis=1).reshape(-1, 1)
        self._comm, self._count = surface.mesh.comm, count
        self._parts: dict[int, tuple[PETSc.Vec, PETSc.Vec, PETSc.Scatter]] = {}

    def give(self, function: fem.Function, values: Floats) -> None:
        """Set a Function at the rule's points by values of joint points, (n, k) (collective)."""
        array = function.x.array.reshape(-1, values.shape[1])
        array[function.function_space.dofmap.list.ravel()] = self.to_facets(values)

    def to_facets(self, values: Floats) -> Floats:
        """Values of joint points, shape (n, k), at the points of facets in turn (collective)."""
        points, facets, scatter = self._exchange(values.shape[1])
        points.setArray(values.ravel())
        scatter.scatter(points, facets)
        return facets.getArray().reshape(-1, values.shape[1]).copy()

    def to_points(self, values: Floats) -> Floats:
        """Means by area of what the facets around joint points have, shape (n, k) (collective)."""
        points, facets, scatter = self._exchange(values.shape[1])
        facets.setArray((self._share * values).ravel())
        points.set(0.0)
        scatter.scatter(facets, points, addv=True, mode=PETSc.ScatterMode.REVERSE)
        return points.getArray().reshape(-1, values.shape[1]).copy()

    def _exchange(self, size: int) -> tuple[PETSc.Vec, PETSc.Vec, PETSc.Scatter]:
        if size not in self._parts:
            points = PETSc.Vec().createMPI((size * self._count, None), comm=lasting(self._comm))
            facets = PETSc.Vec().createSeq(size * len(self._point), comm=PETSc.COMM_SELF)
            here = PETSc.IS().createBlock(
                size, self._point.astype(PETSc.IntType), comm=PETSc.COMM_SELF
            )
            self._parts[size] = (points, facets, PETSc.Scatter().create(points, here, facets, None))
        return self._parts[size]


def _order_of_integration(rule: Floats, turned: Ints) -> Ints:
    """Which point of the rule each point of an integral is, shape (facets, q).

    Args:
        rule: Points on the reference facet, which the permutations of a facet leave a set.
        turned: Vertices of the facets as integrals see them, shape (facets, vertices per facet).
    """
    corners = basix.cell.geometry(facet_cell_type(turned.shape[1]))
    weights = vertex_functions(turned.shape[1], rule)
    kinds, of_facet = np.unique(turned, axis=0, return_inverse=True)
    apart = np.linalg.norm((weights @ corners[kinds])[:, :, None] - rule, axis=3)
    if np.any(apart.min(axis=2, initial=np.inf) > 1e-9):
        raise ValueError("This quadrature rule depends on the order of a facet's vertices.")
    return apart.argmin(axis=2)[of_facet.ravel()]
