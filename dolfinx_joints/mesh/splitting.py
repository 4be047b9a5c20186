# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Duplication of the nodes of a conforming mesh across its joints: arrays in, arrays out.

A node is split if the cells around the node are not connected through facets without a joint. This
rule also covers T and X crossings, and joints that end inside the body: nodes on the joint's front
(its edge inside the body) are not split.

Vertices are split first. A node inside an edge or facet is split exactly if the vertices of this
edge or facet are split, so the split mesh is conforming.
"""

from __future__ import annotations

from dataclasses import dataclass

import basix
import numpy as np
from scipy.spatial import KDTree

from dolfinx_joints.common.arrays import Flags
from dolfinx_joints.common.errors import MeshError, warn
from dolfinx_joints.mesh.blocks import connected
from dolfinx_joints.mesh.cells import CellShape, Floats, Ints, find_facets, middle
from dolfinx_joints.mesh.orientation import orient_pairs


@dataclass(frozen=True, kw_only=True)
class SplitMesh:
    """Cells with duplicated nodes, and facet pairs of the joints.

    Attributes:
        cells: Node numbers of the cells after splitting, shape (num_cells, nodes per cell).
        parent: Node of the conforming mesh that each node copies, shape (num_nodes,).
        joint: Joint number of each pair, shape (num_pairs,); pairs are sorted by joint.
        minus: Cell and local facet on the - side, shape (num_pairs, 2).
        plus: Cell and local facet on the + side, shape (num_pairs, 2).
        match: Position in the + facet of the partner of each vertex of the - facet, shape
            (num_pairs, vertices per facet).
        bonded: Number of facets per joint with all vertices on the joint's front. These facets
            cannot open and are not part of the joint.
    """

    cells: Ints
    parent: Ints
    joint: Ints
    minus: Ints
    plus: Ints
    match: Ints
    bonded: Ints


def _interior_pairs(shape: CellShape, cells: Ints) -> tuple[Ints, Ints]:
    """Return the vertices and the two (cell, local facet) slots of each interior facet."""
    local = shape.facet_vertices
    vertices = np.sort(cells[:, local], axis=2).reshape(-1, local.shape[1])
    order = np.lexsort(vertices.T[::-1])
    same = np.all(vertices[order[1:]] == vertices[order[:-1]], axis=1)
    one, two = order[:-1][same], order[1:][same]
    return vertices[one], np.stack([one, two], axis=1)


def _split_vertices(shape: CellShape, cells: Ints, joint_vertices: Ints, num_nodes: int) -> Ints:
    """Return the vertices of the cells after splitting, (num_cells, vertices per cell)."""
    local = shape.facet_vertices
    num_vertices = int(local.max()) + 1
    corner = cells[:, :num_vertices].copy()
    on_joint = np.zeros(num_nodes, dtype=bool)
    on_joint[joint_vertices.ravel()] = True
    near = np.flatnonzero(on_joint[corner].any(axis=1))
    vertices, slots = _interior_pairs(shape, corner[near])
    is_joint = _rows_in(vertices, np.sort(joint_vertices, axis=1))
    slots = slots[~is_joint]
    cell, facet = slots // len(local), slots % len(local)
    size = len(near) * num_vertices
    graph_rows, graph_cols = [], []
    for a in range(local.shape[1]):
        vertex_one = local[facet[:, 0], a]
        node = corner[near[cell[:, 0]], vertex_one]
        candidates = local[facet[:, 1]]
        position = np.argmax(corner[near[cell[:, 1]][:, None], candidates] == node[:, None], axis=1)
        vertex_two = candidates[np.arange(len(candidates)), position]
        graph_rows.append(cell[:, 0] * num_vertices + vertex_one)
        graph_cols.append(cell[:, 1] * num_vertices + vertex_two)
    rows, cols = np.concatenate(graph_rows), np.concatenate(graph_cols)
    label = connected(rows, cols, size)
    node = corner[near].ravel()
    slots = np.flatnonzero(on_joint[node])
    node[slots] = _number_groups(np.stack([node[slots], label[slots]], axis=1), num_nodes)
    corner[near] = node.reshape(len(near), -1)
    return corner


def _number_groups(table: Ints, next_number: int) -> Ints:
    """Return a number for each row (node, key...), equal for equal rows, shape (num_rows,).

    The first group of equal rows of a node keeps the node number; other groups have new numbers.
    """
    groups, first, inverse = np.unique(table, axis=0, return_index=True, return_inverse=True)
    order = np.lexsort((first, groups[:, 0]))
    leads = np.ones(len(order), dtype=bool)
    leads[1:] = groups[order[1:], 0] != groups[order[:-1], 0]
    number = np.empty(len(order), dtype=np.int64)
    number[order[leads]] = groups[order[leads], 0]
    number[order[~leads]] = next_number + np.arange(np.count_nonzero(~leads))
    return number[inverse.ravel()]


def _rows_in(rows: Ints, table: Ints) -> Flags:
    _, inverse = np.unique(np.vstack([table, rows]), axis=0, return_inverse=True)
    return np.isin(inverse.ravel()[len(table) :], inverse.ravel()[: len(table)])


def _split_inner_nodes(shape: CellShape, cells: Ints, corner: Ints) -> Ints:
    """Return the cells after splitting nodes inside edges and facets by their split vertices."""
    element = shape.element()
    topology = basix.topology(shape.type)
    new = cells.copy()
    new[:, : corner.shape[1]] = corner
    for dim in range(1, shape.dim):
        dofs = element.entity_dofs[dim]
        if not any(dofs):
            continue
        inner = np.array([d[0] for d in dofs], dtype=np.int64)
        vertices = np.array(topology[dim], dtype=np.int64)
        node = cells[:, inner].ravel()
        keys = np.sort(corner[:, vertices], axis=2).reshape(len(node), -1)
        number = _number_groups(np.column_stack([node, keys]), int(new.max()) + 1)
        new[:, inner] = number.reshape(len(cells), -1)
    return new


def split_cells(
    shape: CellShape, cells: Ints, x: Floats, joints: list[tuple[str, Ints]]
) -> SplitMesh:
    """Duplicate the nodes across the joints, and pair the facets of the two sides.

    ``joints`` are pairs of a name and facet vertices, shape (n, vertices per facet).
    """
    names = [name for name, _ in joints]
    facets = np.vstack([vertices for _, vertices in joints])
    number = np.concatenate([np.full(len(v), i) for i, (_, v) in enumerate(joints)])
    owner, count = find_facets(shape, cells, facets)
    _check_sides(names, facets, number, count, x)
    corner = _split_vertices(shape, cells, facets, len(x))
    new = _split_inner_nodes(shape, cells, corner) if shape.degree > 1 else corner
    one, two = owner[:, 0], owner[:, 1]
    local = shape.facet_vertices
    apart = np.any(
        np.sort(new[one[:, :1], local[one[:, 1]]], axis=1)
        != np.sort(new[two[:, :1], local[two[:, 1]]], axis=1),
        axis=1,
    )
    bonded = np.bincount(number[~apart], minlength=len(names))
    for i, name in enumerate(names):
        if not np.any(apart & (number == i)):
            raise MeshError(
                f"Joint {name!r} cannot open: all vertices of its {bonded[i]} facets lie on its "
                "edge inside the body; refine the mesh."
            )
        if bonded[i]:
            warn(
                f"Joint {name!r}: {bonded[i]} facets cannot open because all their vertices lie on "
                "the joint's edge inside the body; refine the mesh there."
            )
    one, two, number = one[apart], two[apart], number[apart]
    swap = orient_pairs(shape, cells, x, number, one, two)
    minus = np.where(swap[:, None], two, one)
    plus = np.where(swap[:, None], one, two)
    minus_nodes = cells[minus[:, :1], local[minus[:, 1]]]
    plus_nodes = cells[plus[:, :1], local[plus[:, 1]]]
    match = np.argmax(plus_nodes[:, None, :] == minus_nodes[:, :, None], axis=2)
    parent = np.arange(max(int(new.max()) + 1, len(x)), dtype=np.int64)
    parent[new] = cells
    return SplitMesh(
        cells=new, parent=parent, joint=number, minus=minus, plus=plus, match=match, bonded=bonded
    )


def _check_sides(names: list[str], facets: Ints, number: Ints, count: Ints, x: Floats) -> None:
    """Check that each joint facet separates two cells and belongs to only one joint."""
    invalid = np.flatnonzero(count != 2)
    if len(invalid):
        outer = count == 1
        centres = x[facets[outer]].mean(axis=1).round(12)
        if len(np.unique(centres, axis=0)) < len(centres):
            raise MeshError(
                f"Joint {names[number[invalid[0]]]!r} contains both of its faces, which Gmsh's "
                "plugin Crack makes; write the mesh before running the plugin, or name the two "
                "faces NAME- and NAME+."
            )
        raise MeshError(
            f"Joint {names[number[invalid[0]]]!r}: {len(invalid)} of its facets do not have one "
            f"cell on each side (the first, centred at {middle(x[facets[invalid[0]]])}, has "
            f"{count[invalid[0]]}); a joint must lie inside the body, between two cells."
        )
    _, first, inverse = np.unique(
        np.sort(facets, axis=1), axis=0, return_index=True, return_inverse=True
    )
    twice = np.flatnonzero(first[inverse.ravel()] != np.arange(len(facets)))
    if len(twice):
        one, two = names[number[first[inverse.ravel()[twice[0]]]]], names[number[twice[0]]]
        where = "the joint" if one == two else f"the joints {one!r} and"
        raise MeshError(f"{len(twice)} facets of {where} {two!r} are given twice.")


def pair_coincident(
    shape: CellShape, cells: Ints, x: Floats, names: list[str], slots: dict[str, Ints]
) -> SplitMesh:
    """Pair the facets of joints that already have duplicated faces ``NAME-`` and ``NAME+``.

    ``slots`` are the facets (cell, local facet) of each group, shape (n, 2).
    """
    local = shape.facet_vertices
    none: Ints = np.empty((0, local.shape[1]), dtype=np.int64)
    minus, plus, match, joint = [none[:, :2]], [none[:, :2]], [none], [none[:, 0]]
    for i, name in enumerate(names):
        one, two = slots[f"{name}-"], slots[f"{name}+"]
        if len(one) != len(two):
            raise MeshError(
                f"Joint {name!r}: {len(one)} facets on its - face and {len(two)} on its + face; "
                "mesh both faces identically."
            )
        a = x[cells[one[:, :1], local[one[:, 1]]]]
        b = x[cells[two[:, :1], local[two[:, 1]]]]
        _, partner = KDTree(b.mean(axis=1)).query(a.mean(axis=1))
        distance = np.linalg.norm(a[:, :, None, :] - b[partner][:, None, :, :], axis=3)
        position = distance.argmin(axis=2)
        size = np.linalg.norm(a[:, 0] - a[:, 1], axis=1)
        paired = len(np.unique(partner)) == len(partner) and np.all(
            np.sort(position, axis=1) == np.arange(local.shape[1])
        )
        if not paired or np.any(distance.min(axis=2) > 0.25 * size[:, None]):
            raise MeshError(
                f"Joint {name!r}: the facets of its - and + faces do not match one to one."
            )
        minus.append(one)
        plus.append(two[partner])
        match.append(position)
        joint.append(np.full(len(one), i))
    return SplitMesh(
        cells=cells,
        parent=np.arange(len(x)),
        joint=np.concatenate(joint),
        minus=np.vstack(minus),
        plus=np.vstack(plus),
        match=np.vstack(match),
        bonded=np.zeros(len(names), dtype=np.int64),
    )
