# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Quadrature on the part of a facet group below a water level.

Facets are triangles, quadrilaterals divided into two triangles, or lines in 2-D. Each is cut into
horizontal slices at the depths of its corners and at the level. The integrands are polynomials of
the position, with or without the factor sqrt(depth). On a slice of a flat facet they are
polynomials of sqrt(depth), so Gauss points in sqrt(depth) integrate them exactly.

A warped or curved facet that the level cuts is divided into `DIVISIONS` parts along each edge,
because its height is not linear. On each part, the cut assumes a linear height.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import basix
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.mesh import dolfinx_versions
from dolfinx_joints.mesh.cells import Floats, Ints, facet_slots, lagrange
from dolfinx_joints.mesh.closest_points import longest_sides
from dolfinx_joints.mesh.jointed_mesh import JointedMesh

DIVISIONS = 8
_CHUNK = 128  # number of pieces of facets evaluated at a time
# A piece is horizontal if the depths of its corners differ by less than this fraction of the depth.
_FLAT = 1e-4
# Heights are linear if mid-edges deviate by less than this fraction of the facet's height.
_LINEAR = 1e-9


@dataclass(frozen=True, kw_only=True)
class WettedPoints:
    """Quadrature points on pieces of wetted facets.

    Attributes:
        nodes: Local nodes of the facet of each piece, shape (pieces, nodes).
        shapes: Shape functions of these nodes, shape (pieces, points, nodes).
        areas: Outward normals times weights, shape (pieces, points, gdim), [m^2], [m] in 2-D.
        positions: Coordinates, shape (pieces, points, gdim), [m].
        depths: Depths below the level, zero above it, shape (pieces, points), [m].
        sizes: Longest side of the facet of each piece, shape (pieces,), [m].
    """

    nodes: Ints
    shapes: Floats
    areas: Floats
    positions: Floats
    depths: Floats
    sizes: Floats


def wetted_facets(space: Any, jointed: JointedMesh, group: str, level: float) -> WettedFacets:
    """Return the part of a facet group below a level [m] (collective)."""
    return WettedFacets(space, jointed, jointed.boundary_facets(group), level)


class WettedFacets:
    """Exterior facets of this rank, cut at a level; iteration yields quadrature points.

    Attributes:
        lowest: Height of the lowest vertex of this rank's facets [m]; infinite without facets.
        nodes: Local nodes of the displacement on each facet, shape (facets, nodes).
    """

    def __init__(
        self, space: Any, jointed: JointedMesh, facets: NDArray[Any], level: float
    ) -> None:
        mesh, self._shape, self._level = jointed.mesh, jointed.shape, level
        self._gdim = mesh.geometry.dim
        self._geometry = jointed.shape.element()
        self._displacement = lagrange(jointed.shape.type, space.ufl_element().degree)
        fdim = mesh.topology.dim - 1
        cells, self._local = facet_slots(mesh, facets)
        closure = space.dofmap.dof_layout.entity_closure_dofs
        layout = np.array([closure(fdim, i) for i in range(len(self._shape.facet_vertices))])
        self._closure: Ints = layout[self._local]
        self.nodes: Ints = np.take_along_axis(
            space.dofmap.list[cells].astype(np.int64), self._closure, axis=1
        )
        nodes = dolfinx_versions.geometry_nodes(mesh)[cells]
        self._x: Floats = mesh.geometry.x[nodes][:, :, : self._gdim]
        vertices = self._shape.facet_vertices[self._local]
        self._sizes = longest_sides(np.take_along_axis(self._x, vertices[:, :, None], axis=1))
        self._facet, self._corners = self._pieces()

    def __iter__(self) -> Iterator[WettedPoints]:
        """Yield the quadrature points, for some pieces at a time."""
        for start in range(0, len(self._facet), _CHUNK):
            chunk = slice(start, start + _CHUNK)
            yield self._points(self._facet[chunk], self._corners[chunk])

    def _pieces(self) -> tuple[Ints, Floats]:
        """Return facet and reference corners of all pieces that reach below the level."""
        vertices = basix.geometry(self._shape.type)[self._shape.facet_vertices][self._local]
        simplices = [[0, 1, 2], [3, 1, 2]] if vertices.shape[1] == 4 else [[0, 1, 2][: self._gdim]]
        corners = np.concatenate([vertices[:, simplex] for simplex in simplices])
        facet = np.tile(np.arange(len(vertices)), len(simplices))
        depth = self._depth(facet, corners)
        self.lowest = self._level - float(depth.max(initial=-np.inf))
        count = corners.shape[1]
        pairs = [(i, j) for i in range(count) for j in range(i)]
        middles = np.stack([corners[:, i] + corners[:, j] for i, j in pairs], axis=1) / 2
        linear = np.stack([depth[:, i] + depth[:, j] for i, j in pairs], axis=1) / 2
        between = self._depth(facet, middles)
        all_depths = np.concatenate([depth, between], axis=1)
        top, bottom = all_depths.min(axis=1), all_depths.max(axis=1)
        is_curved = np.abs(between - linear).max(axis=1) > _LINEAR * (bottom - top)
        refined = is_curved & (top < 0.0) & (bottom > 0.0)
        wet = (bottom > 0.0) & ~refined
        parts = _subdivide(count)
        finer = np.einsum("skc,ncd->nskd", parts, corners[refined]).reshape(-1, *corners.shape[1:])
        finer_facet = np.repeat(facet[refined], len(parts))
        return np.concatenate([facet[wet], finer_facet]), np.concatenate([corners[wet], finer])

    def _depth(self, facet: Ints, points: Floats) -> Floats:
        """Return depths at points (n, p, dim) of the reference cells, negative above the level."""
        table = _tabulate(self._geometry, 0, points)[0]
        return self._level - np.einsum("npg,ng->np", table, self._x[facet][:, :, -1])

    def _points(self, facet: Ints, corners: Floats) -> WettedPoints:
        """Return the quadrature points of pieces, mapped to the mesh."""
        degree = self._displacement.degree + self._geometry.degree - 1
        degree *= 4 if len(self._shape.facet_vertices[0]) == 4 else 2
        barycentric, weights = slices(self._depth(facet, corners), degree)
        points = np.einsum("npc,ncd->npd", barycentric, corners)
        size = sizes(corners) / (1 if corners.shape[1] == 2 else 2)
        return self.at(facet, points, weights * size[:, None])

    def at(self, facet: Ints, points: Floats, weights: Floats) -> WettedPoints:
        """Map points of the reference cells to the mesh.

        Args:
            facet: Positions among this rank's facets, shape (n,).
            points: Shape (n, points, dim).
            weights: Lengths or areas on the reference facets, shape (n, points).
        """
        geometry = _tabulate(self._geometry, 1, points)
        x = self._x[facet]
        positions = np.einsum("npg,ngi->npi", geometry[0], x)
        jacobian = np.einsum("dnpg,ngi->npid", geometry[1:], x)
        # Nanson's formula: n dA = |det J| J^-T N dA0.
        outward = basix.cell.facet_outward_normals(self._shape.type)[self._local[facet]]
        outward = np.broadcast_to(outward[:, None, :, None], (*points.shape, 1))
        normals = np.linalg.solve(np.swapaxes(jacobian, 2, 3), outward)[..., 0]
        scale = np.abs(np.linalg.det(jacobian)) * weights
        shapes = _tabulate(self._displacement, 0, points)[0]
        return WettedPoints(
            nodes=self.nodes[facet],
            shapes=np.take_along_axis(shapes, self._closure[facet][:, None, :], axis=2),
            areas=normals * scale[:, :, None],
            positions=positions,
            depths=np.maximum(self._level - positions[:, :, -1], 0.0),
            sizes=self._sizes[facet],
        )

    @property
    def places(self) -> Floats:
        """Nodes of the displacement in the reference cells, shape (facets, nodes, dim)."""
        return self._displacement.points[self._closure]


def _tabulate(element: Any, order: int, points: Floats) -> Floats:
    """Return basis functions at points (n, p, dim), shape (derivatives, n, p, functions)."""
    n, p, dim = points.shape
    # Add a point, because Basix aborts the process if there are no points.
    flat = np.append(points.reshape(-1, dim), np.zeros((1, dim)), axis=0)
    table = element.tabulate(order, flat)[:, :-1, :, 0]
    return table.reshape(len(table), n, p, element.dim)


def slices(depth: Floats, degree: int) -> tuple[Floats, Floats]:
    """Return a quadrature on the wet part of lines or triangles, exact for linear depths.

    Args:
        depth: Depths of the corners, shape (n, 2) or (n, 3), [m].
        degree: Degree of the polynomial integrand, which may have the factor depth or sqrt(depth).

    Returns:
        Barycentric coordinates (n, points, corners) and weights (n, points); the sum of the weights
        is the wet share of the length or area.
    """
    count = depth.shape[1]
    horizontal = np.ptp(depth, axis=1) <= _FLAT * np.abs(depth).max(axis=1)
    order = np.argsort(depth, axis=1)
    level = np.take_along_axis(depth, order, axis=1)
    # If all corners have the same depth, any slices are valid; avoid division by zero.
    level[horizontal] = np.arange(count)
    rule = _line(level, degree) if count == 2 else _triangle(level, degree)
    barycentric = np.empty_like(rule[0])
    np.put_along_axis(barycentric, order[:, None, :].repeat(barycentric.shape[1], 1), rule[0], 2)
    return barycentric, rule[1]


def _roots(top: Floats, bottom: Floats, degree: int) -> tuple[Floats, Floats]:
    """Return depths and weights (n, points) of Gauss points in sqrt(depth) between two depths."""
    s, w = np.polynomial.legendre.leggauss(degree + 3)
    a, b = (np.sqrt(np.maximum(end, 0.0))[:, None] for end in (top, bottom))
    root = a + (b - a) * (1 + s) / 2
    return root**2, root * (b - a) * w


def _line(level: Floats, degree: int) -> tuple[Floats, Floats]:
    d, weights = _roots(level[:, 0], level[:, 1], degree)
    length = (level[:, 1] - level[:, 0])[:, None]
    share = (d - level[:, :1]) / length
    return np.stack([1 - share, share], axis=2), weights / length


def _triangle(level: Floats, degree: int) -> tuple[Floats, Floats]:
    """Return the rule on triangles, in slices above and below the middle corner.

    Slices extend from the edge between highest and lowest corner to the other two edges.
    """
    nodes, of_nodes = np.polynomial.legendre.leggauss(degree // 2 + 1)
    t, along = (1 + nodes) / 2, of_nodes / 2
    height = (level[:, 2] - level[:, 0])[:, None]
    points, weights = [], []
    for i in (0, 1):
        d, w = _roots(level[:, i], level[:, i + 1], degree)
        share = (d - level[:, :1]) / height
        span = (level[:, i + 1] - level[:, i])[:, None]
        part = np.zeros_like(d)
        np.divide(np.abs(d - level[:, 2 * i, None]), span, out=part, where=span > 0.0)
        np.minimum(part, 1.0, out=part)  # relative width of the slice, 1 at the middle corner
        longest = np.stack([1 - share, np.zeros_like(share), share], axis=2)
        other = np.zeros_like(longest)
        other[:, :, 1], other[:, :, 2 * i] = part, 1 - part
        both = longest[:, :, None, :] * (1 - t)[:, None] + other[:, :, None, :] * t[:, None]
        points.append(both.reshape(len(d), -1, 3))
        weights.append(((2 * w * part / height)[:, :, None] * along).reshape(len(d), -1))
    return np.concatenate(points, axis=1), np.concatenate(weights, axis=1)


def _subdivide(count: int) -> Floats:
    """Return barycentric corners of the parts of a line or triangle, (parts, count, count)."""
    n = DIVISIONS
    if count == 2:
        ends = [(i, i + 1) for i in range(n)]
        return np.array([[(n - i, i) for i in part] for part in ends]) / n
    up = [[(i, j), (i + 1, j), (i, j + 1)] for i in range(n) for j in range(n - i)]
    down = [[(i + 1, j + 1), (i + 1, j), (i, j + 1)] for i in range(n) for j in range(n - i - 1)]
    return np.array([[(n - i - j, i, j) for i, j in part] for part in up + down]) / n


def sizes(simplices: Floats) -> Floats:
    """Return the length of lines or twice the area of triangles (n, corners, dim), shape (n,)."""
    edges = simplices[:, 1:] - simplices[:, :1]
    return np.sqrt(np.linalg.det(np.einsum("nid,njd->nij", edges, edges)))
