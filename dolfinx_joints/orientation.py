# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which side of a joint is the - side: by geometry alone, and the same all along the joint."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from dolfinx_joints.cells import CellShape, Floats, Ints


def facet_normals(x: Floats) -> Floats:
    """Area-weighted normals of plane facets given by their vertices in cyclic order.

    Args:
        x: Vertex coordinates, shape (n, vertices per facet, gdim), [m].

    Returns:
        Normals times area (length in 2-D), shape (n, gdim), [m^2] or [m].
    """
    if x.shape[2] == 2:
        edge = x[:, 1] - x[:, 0]
        return np.stack([edge[:, 1], -edge[:, 0]], axis=1)
    if x.shape[1] == 3:
        return 0.5 * np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    return 0.5 * np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])


def orient_pairs(
    shape: CellShape, cells: Ints, x: Floats, joint: Ints, one: Ints, two: Ints
) -> NDArray[np.bool_]:
    """Decide which side of each joint facet is the - side.

    Within a connected part of a joint all normals (from - to +) agree; the part as a whole is
    turned so that the largest component of its mean normal is positive (x before y before z where
    they are equal), or outward where the part is closed and has no mean normal. The choice depends
    on the geometry alone, not on the order of cells or on the partition.

    Args:
        shape: The reference cell.
        cells: Cell nodes before splitting, shape (num_cells, nodes per cell).
        x: Node coordinates, shape (num_nodes, gdim), [m].
        joint: Joint number of each facet, shape (n,).
        one: (cell, local facet) on one side, shape (n, 2).
        two: (cell, local facet) on the other side, shape (n, 2).

    Returns:
        True where ``two`` is the - side, shape (n,).
    """
    cycle = cells[one[:, :1], shape.facet_vertices[one[:, 1]][:, shape.facet_cycle]]
    normal = facet_normals(x[cycle])
    corners = int(shape.facet_vertices.max()) + 1
    towards = x[cells[two[:, 0], :corners]].mean(axis=1) - x[cells[one[:, 0], :corners]].mean(
        axis=1
    )
    sign = np.where(np.einsum("ij,ij->i", normal, towards) < 0, -1, 1)
    graph = _agreement(cycle, sign, joint)
    _, part = connected_components(graph, directed=False)
    flip = np.ones(len(joint), dtype=np.int64)
    for root in np.unique(part, return_index=True)[1]:
        order, previous = breadth_first_order(graph, root, directed=False)
        for facet in order[1:]:
            row = slice(*graph.indptr[previous[facet] : previous[facet] + 2])
            agrees = graph.data[row][graph.indices[row] == facet][0]
            flip[facet] = flip[previous[facet]] * np.sign(agrees)
        normals = (flip[order] * sign[order])[:, None] * normal[order]
        flip[order] *= _part_sign(x[cycle[order]].mean(axis=1), normals)
    return flip < 0


def _agreement(cycle: Ints, sign: Ints, joint: Ints) -> csr_array:
    """Graph of facets that share a ridge: 1 where their sides agree, -1 where they do not."""
    count, size = cycle.shape
    if size == 2:
        start, end = cycle[:, 0], cycle[:, 1]
        ridge = np.concatenate([start, end])[:, None]
        direction = np.concatenate([sign, -sign])
        facet = np.tile(np.arange(count), 2)
    else:
        a = cycle.ravel()
        b = np.roll(cycle, -1, axis=1).ravel()
        ridge = np.stack([np.minimum(a, b), np.maximum(a, b)], axis=1)
        facet = np.repeat(np.arange(count), size)
        direction = np.where(a < b, 1, -1) * sign[facet]
    keys = np.column_stack([joint[facet], ridge])
    _, inverse, multiplicity = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    inverse = inverse.ravel()
    order = np.argsort(inverse, kind="stable")
    order = order[multiplicity[inverse[order]] == 2]
    one, two = order[0::2], order[1::2]
    relation = np.where(direction[one] == direction[two], -1, 1)
    half = coo_array((relation, (facet[one], facet[two])), shape=(count, count)).tocsr()
    return half + half.T


def _part_sign(centres: Floats, normals: Floats) -> int:
    """Sign that turns a connected part of a joint to the side the convention asks for."""
    mean = normals.sum(axis=0)
    area = np.linalg.norm(normals, axis=1).sum()
    size = np.abs(mean)
    if size.max() > 1e-6 * area:
        largest = int(np.flatnonzero(size >= size.max() * (1 - 1e-6))[0])
        return 1 if mean[largest] > 0 else -1
    flux = np.einsum("ij,ij->", centres - centres.mean(axis=0), normals)
    return 1 if flux > 0 else -1
