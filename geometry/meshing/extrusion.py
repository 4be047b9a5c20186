# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plane meshes with named groups, and their extrusion to hexahedra or tetrahedra (NumPy only).

A model is a plane mesh of quadrilaterals or triangles in two coordinates (p, q), extruded along a
third coordinate r. The triple (p, q, r) is right-handed. Each model maps it to (x, y, z).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.geometry.meshing.arguments import check_fine

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.floating[Any]]
IntArray = NDArray[np.signedinteger[Any]]


@dataclass(frozen=True)
class PlaneMesh:
    """Plane mesh of one cell type, with named cells and named edges.

    Args:
        points: node coordinates (p, q), shape (num_points, 2).
        cells: nodes of the cells, counter-clockwise; per volume group an array of shape
            (num_cells, 4) for quadrilaterals or (num_cells, 3) for triangles.
        edges: nodes of the edges that become named surfaces; per surface group an array of
            shape (num_edges, 2).
    """

    points: FloatArray
    cells: dict[str, IntArray]
    edges: dict[str, IntArray]


@dataclass(frozen=True)
class SolidMesh:
    """Mesh of hexahedra or tetrahedra of order 1, with named volumes and surfaces.

    Args:
        points: node coordinates (p, q, r), shape (num_points, 3).
        cells: per volume group, shape (num_cells, 8) or (num_cells, 4), Gmsh's node order.
        facets: per surface group, shape (num_facets, 4) or (num_facets, 3).
    """

    points: FloatArray
    cells: dict[str, IntArray]
    facets: dict[str, IntArray]


def grid(p: FloatArray, q: FloatArray, cell: str) -> tuple[FloatArray, IntArray]:
    """Mesh the rectangle spanned by two increasing sequences of coordinates.

    Args:
        p: coordinates of the grid lines in the first direction, shape (n_p + 1,).
        q: coordinates of the grid lines in the second direction, shape (n_q + 1,).
        cell: "hex" for quadrilaterals, "tet" for triangles (diagonals alternate).

    Returns:
        Points, shape (num_points, 2), and cells, shape (num_cells, 4 or 3); p varies fastest.

    Raises:
        ValueError: if there would be too many cells.
    """
    check_fine((p.size - 1) * (q.size - 1))
    points = np.stack(np.meshgrid(p, q), axis=-1).reshape(-1, 2)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(p.size - 1), np.arange(q.size - 1)))
    first = j * p.size + i
    quads = np.stack([first, first + 1, first + p.size + 1, first + p.size], axis=1)
    if cell == "hex":
        return points, quads
    quads = np.where(((i + j) % 2 == 0)[:, None], quads, np.roll(quads, -1, axis=1))
    return points, quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def edges_between(cells: IntArray, selected: BoolArray) -> IntArray:
    """Return the distinct edges of the cells whose two ends are selected nodes.

    Args:
        cells: nodes of the cells, shape (num_cells, 3 or 4).
        selected: True at the selected nodes, shape (num_points,).

    Returns:
        Nodes of the edges, shape (num_edges, 2).
    """
    pairs = np.stack([cells, np.roll(cells, -1, axis=1)], axis=-1).reshape(-1, 2)
    inside = selected[pairs].all(axis=1)
    return np.unique(np.sort(pairs[inside], axis=1), axis=0)


def boundary_edges(cells: IntArray) -> IntArray:
    """Return the edges that belong to one cell only, shape (num_edges, 2)."""
    pairs = np.stack([cells, np.roll(cells, -1, axis=1)], axis=-1).reshape(-1, 2)
    edges, count = np.unique(np.sort(pairs, axis=1), axis=0, return_counts=True)
    return edges[count == 1]


def split_quadrilaterals(points: FloatArray, quads: IntArray) -> IntArray:
    """Cut quadrilaterals into triangles along the diagonal that gives the better shape.

    The measure of a triangle's shape is its area divided by the sum of its squared sides.

    Args:
        points: node coordinates, shape (num_points, 2).
        quads: nodes of the quadrilaterals, shape (num_cells, 4).

    Returns:
        Nodes of the triangles, shape (2 num_cells, 3).
    """

    def shape(cells: IntArray) -> FloatArray:
        triangles = points[cells[:, [[0, 1, 2], [0, 2, 3]]]]  # (num_cells, 2, 3, 2)
        sides = np.roll(triangles, -1, axis=2) - triangles
        area = sides[..., 0, 0] * sides[..., 1, 1] - sides[..., 0, 1] * sides[..., 1, 0]
        return (area / (sides**2).sum(axis=(2, 3))).min(axis=1)

    turned = np.roll(quads, -1, axis=1)
    better = shape(turned) > shape(quads) + 1e-9
    cells = np.where(better[:, None], turned, quads)
    return cells[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def mirror(half: PlaneMesh, renamed: dict[str, str]) -> PlaneMesh:
    """Complete a half mesh (p >= 0) by its mirror image about p = 0.

    Nodes on the axis are shared and numbered first. The extrusion to tetrahedra depends on the
    node numbers, so both halves are then cut in the same way.

    Args:
        half: mesh of the half p >= 0; nodes on the axis have exactly p = 0.
        renamed: names of edge groups in the mirror image, by name in the half.

    Returns:
        The whole mesh; a group with the same name on both sides contains both halves.
    """
    on_axis = half.points[:, 0] == 0.0
    order = np.concatenate([np.flatnonzero(on_axis), np.flatnonzero(~on_axis)])
    number = np.argsort(order)
    points = half.points[order]
    shared = int(on_axis.sum())
    image = np.arange(len(points)) + np.where(np.arange(len(points)) < shared, 0, len(points))
    image[shared:] -= shared
    cells, edges = {}, {}
    for name, nodes in half.cells.items():
        cells[name] = np.concatenate([number[nodes], image[number[nodes]][:, ::-1]])
    for name, nodes in half.edges.items():
        edges[name] = number[nodes]
    for name, nodes in half.edges.items():
        copy = image[number[nodes]]
        copy = copy[(copy != number[nodes]).any(axis=1)]  # edges on the axis are their own image
        if len(copy):
            other = renamed.get(name, name)
            edges[other] = np.concatenate([edges.get(other, copy[:0]), copy])
    return PlaneMesh(np.concatenate([points, points[shared:] * [-1.0, 1.0]]), cells, edges)


def extrude(plane: PlaneMesh, levels: FloatArray, ends: Sequence[str]) -> SolidMesh:
    """Extrude quadrilaterals to hexahedra, or triangles to tetrahedra.

    Each prism over a triangle with nodes a < b < c is cut into the tetrahedra a0 b0 c0 c1,
    a0 b0 b1 c1 and a0 a1 b1 c1 (0 below, 1 above). A side face over the edge a < b is thus always
    cut along a0 b1, so that neighbours match.

    Args:
        plane: the plane mesh.
        levels: increasing values of the third coordinate, shape (num_layers + 1,).
        ends: names of the surface groups at the first and at the last level.

    Returns:
        The solid mesh; surface groups of the same name are merged.

    Raises:
        ValueError: if there would be too many cells.
    """
    size = len(plane.points)
    quads = next(iter(plane.cells.values())).shape[1] == 4
    prisms = sum(map(len, plane.cells.values())) * (levels.size - 1)
    check_fine(prisms if quads else 3 * prisms)
    points = np.column_stack(
        [np.tile(plane.points, (levels.size, 1)), np.repeat(levels, size)]  # level by level
    )
    shift = size * np.arange(levels.size - 1)[:, None, None]

    def in_layers(nodes: IntArray) -> IntArray:
        return (nodes[None] + shift).reshape(-1, nodes.shape[1])

    cells = {name: in_layers(_prisms(nodes, size)) for name, nodes in plane.cells.items()}
    facets = {name: in_layers(_sides(nodes, size, quads)) for name, nodes in plane.edges.items()}
    floor = np.concatenate(list(plane.cells.values()))
    for name, nodes in zip(ends, (floor[:, ::-1], floor + size * (levels.size - 1)), strict=True):
        facets[name] = np.concatenate([facets.get(name, nodes[:0]), nodes])
    return SolidMesh(points, cells, facets)


def _prisms(nodes: IntArray, up: int) -> IntArray:
    """Return the hexahedra or tetrahedra over one layer of plane cells."""
    if nodes.shape[1] == 4:
        return np.hstack([nodes, nodes + up])
    order = np.argsort(nodes, axis=1)
    odd = (order[:, 1] - order[:, 0]) % 3 != 1  # the sorting reversed the triangle
    a, b, c = np.take_along_axis(nodes, order, axis=1).T
    tets = np.stack([a, b, c, c + up, a, b, c + up, b + up, a, b + up, c + up, a + up], axis=1)
    tets = tets.reshape(-1, 3, 4)
    tets[odd] = tets[odd][:, :, [0, 2, 1, 3]]
    return tets.reshape(-1, 4)


def _sides(nodes: IntArray, up: int, quads: bool) -> IntArray:
    """Return the side faces over one layer of plane edges."""
    a, b = np.sort(nodes, axis=1).T
    if quads:
        return np.stack([a, b, b + up, a + up], axis=1)
    return np.stack([a, b, b + up, a, b + up, a + up], axis=1).reshape(-1, 3)
