# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Choice of the - side of a joint by the geometry, consistent along the whole joint."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from dolfinx_joints.common.arrays import Flags
from dolfinx_joints.mesh.cells import CellShape, Floats, Ints


def facet_normals(x: Floats) -> Floats:
    """Return the normals of plane facets, times area (length in 2-D), from cyclic vertices."""
    if x.shape[2] == 2:
        edge = x[:, 1] - x[:, 0]
        return np.stack([edge[:, 1], -edge[:, 0]], axis=1)
    if x.shape[1] == 3:
        return 0.5 * np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    return 0.5 * np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])


def orient_pairs(
    shape: CellShape, cells: Ints, x: Floats, joint: Ints, one: Ints, two: Ints
) -> Flags:
    """Return True for each joint facet whose - side is ``two``, False if it is ``one``, (n,).

    Normals point from the - side to the + side. Each connected part of a joint has one - side,
    chosen such that the largest component of the mean normal is positive. For equal components, the
    first of x, y, z is used. On a closed part, whose mean normal is zero, the normals point
    outward. The choice depends only on the geometry, not on the order of cells or the partition.

    Cells are not yet split; ``one`` and ``two`` are (cell, local facet), shape (n, 2).
    """
    cycle = cells[one[:, :1], shape.facet_vertices[one[:, 1]][:, shape.facet_cycle]]
    normal = facet_normals(x[cycle])
    corners = int(shape.facet_vertices.max()) + 1
    towards = x[cells[two[:, 0], :corners]].mean(axis=1) - x[cells[one[:, 0], :corners]].mean(
        axis=1
    )
    sign = np.where(np.einsum("ij,ij->i", normal, towards) < 0, -1, 1)
    graph = _agreement_graph(cycle, sign, joint)
    _, part = connected_components(graph, directed=False)
    flip = _relative_signs(graph, part)
    normals = (flip * sign)[:, None] * normal
    flip = flip * _part_signs(part, x[cycle].mean(axis=1), normals)
    return flip < 0


def _relative_signs(graph: csr_array, part: Ints) -> Ints:
    """Return the sign of each facet relative to the first facet of its part, shape (n,).

    The first facet is the root of the part's breadth-first tree. The sign of a facet is the product
    of the relations on its path to the root. Each pass doubles the length of the covered path.
    """
    count = graph.shape[0]
    first = np.unique(part, return_index=True)[1]
    entries = graph.tocoo()
    rows = np.concatenate([entries.row, np.full(len(first), count)])
    columns = np.concatenate([entries.col, first])
    forest = coo_array((np.ones(len(rows)), (rows, columns)), shape=(count + 1, count + 1))
    previous = breadth_first_order(forest.tocsr(), count)[1][:count].astype(np.int64)
    inner = previous < count
    keys = entries.row.astype(np.int64) * count + entries.col
    order = np.argsort(keys)
    wanted = np.flatnonzero(inner) * count + previous[inner]
    flip = np.ones(count, dtype=np.int64)
    flip[inner] = np.sign(entries.data[order[np.searchsorted(keys[order], wanted)]])
    previous[first] = first
    while np.any(previous != previous[previous]):
        flip, previous = flip * flip[previous], previous[previous]
    return flip


def _agreement_graph(cycle: Ints, sign: Ints, joint: Ints) -> csr_array:
    """Return the graph of facets that share an edge (2-D: vertex): 1 if sides agree, else -1."""
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


def _part_signs(part: Ints, centres: Floats, normals: Floats) -> Ints:
    """Return, for each facet, the sign that orients its part by the rules of `orient_pairs`."""
    parts = int(part.max(initial=-1)) + 1
    members = np.bincount(part, minlength=parts)[:, None]
    mean = _sums(part, normals, parts)
    area = _sums(part, np.linalg.norm(normals, axis=1)[:, None], parts)[:, 0]
    middle = _sums(part, centres, parts) / members
    flux = _sums(part, np.einsum("ij,ij->i", centres - middle[part], normals)[:, None], parts)
    size = np.abs(mean)
    largest = np.argmax(size >= size.max(axis=1, keepdims=True) * (1 - 1e-6), axis=1)
    towards = np.where(size.max(axis=1) > 1e-6 * area, mean[np.arange(parts), largest], flux[:, 0])
    return np.where(towards > 0, 1, -1)[part]


def _sums(part: Ints, values: Floats, parts: int) -> Floats:
    """Return the column sums of ``values`` over each part, shape (parts, columns)."""
    return np.column_stack([np.bincount(part, v, minlength=parts) for v in values.T])
