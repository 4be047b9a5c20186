# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Duplicate the nodes of a conforming mesh across its joints: arrays in, arrays out.

Nodes are split where the cells around them are no longer connected through facets that carry no
joint. That is right for joints that end inside the body (the nodes of the front stay single) and
for T and X crossings. Vertices decide: a node inside an edge or a facet is split exactly where the
vertices of that edge or facet are, so that the split cells are again a conforming mesh.
"""

from __future__ import annotations

from dataclasses import dataclass

import basix
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components
from scipy.spatial import cKDTree

from dolfinx_joints.errors import MeshError

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class CellShape:
    """Reference cell and its Lagrange node layout (basix numbering).

    Attributes:
        name: ``triangle``, ``quadrilateral``, ``tetrahedron`` or ``hexahedron``.
        degree: Polynomial degree of the geometry, 1 or 2.
    """

    name: str
    degree: int

    @property
    def type(self) -> basix.CellType:
        """The basix cell type."""
        return getattr(basix.CellType, self.name)

    @property
    def dim(self) -> int:
        """Topological dimension."""
        return len(basix.topology(self.type)) - 1

    @property
    def facet_vertices(self) -> Ints:
        """Local vertices of each local facet, shape (facets, vertices per facet)."""
        return np.array(basix.topology(self.type)[self.dim - 1], dtype=np.int64)

    @property
    def facet_cycle(self) -> Ints:
        """Positions of a facet's vertices in cyclic order."""
        count = self.facet_vertices.shape[1]
        return np.array([0, 1, 3, 2] if count == 4 else range(count), dtype=np.int64)

    def element(self) -> basix.finite_element.FiniteElement:
        """The scalar Lagrange element whose dofs are the geometry nodes."""
        return basix.create_element(
            basix.ElementFamily.P, self.type, self.degree, basix.LagrangeVariant.gll_warped
        )

    @property
    def facet_nodes(self) -> Ints:
        """Local nodes of each local facet in the order of the facet's own Lagrange element.

        Shape (facets, nodes per facet).
        """
        element = self.element()
        topology = basix.topology(self.type)
        rows = []
        for facet, vertices in enumerate(topology[self.dim - 1]):
            row = list(vertices)
            if self.degree == 2:
                row += _inner_facet_nodes(element, topology, vertices, self.dim, facet)
            rows.append(row)
        return np.array(rows, dtype=np.int64)


def _inner_facet_nodes(
    element: basix.finite_element.FiniteElement,
    topology: list[list[list[int]]],
    vertices: list[int],
    dim: int,
    facet: int,
) -> list[int]:
    """Edge and interior nodes of one facet in the facet's own basix order (degree 2)."""
    if dim == 2:
        return list(element.entity_dofs[1][facet])
    facet_type = basix.CellType.triangle if len(vertices) == 3 else basix.CellType.quadrilateral
    edges = {frozenset(edge): number for number, edge in enumerate(topology[1])}
    nodes: list[int] = []
    for a, b in basix.topology(facet_type)[1]:
        nodes += element.entity_dofs[1][edges[frozenset((vertices[a], vertices[b]))]]
    return nodes + list(element.entity_dofs[2][facet])


@dataclass(frozen=True, kw_only=True)
class SplitMesh:
    """Cells on duplicated nodes and the facet pairs of each joint.

    Attributes:
        cells: Node numbers of the cells after splitting, shape (num_cells, nodes per cell).
        parent: Node of the conforming mesh that each node comes from, shape (num_nodes,).
        joint: Joint number of each pair, shape (num_pairs,); pairs are sorted by joint.
        minus: Cell and local facet on the - side, shape (num_pairs, 2).
        plus: Cell and local facet on the + side, shape (num_pairs, 2).
        match: For vertex j of the - facet, the position of its partner among the vertices of the
            + facet, shape (num_pairs, vertices per facet).
        bonded: Number of joint facets per joint whose vertices all lie on the joint's front: they
            cannot open and carry no joint.
    """

    cells: Ints
    parent: Ints
    joint: Ints
    minus: Ints
    plus: Ints
    match: Ints
    bonded: Ints


def find_facets(
    shape: CellShape, cells: Ints, facets: Ints
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find the cells at given facets.

    Args:
        shape: The reference cell.
        cells: Cell nodes, shape (num_cells, nodes per cell).
        facets: Vertices of the facets in any order, shape (n, vertices per facet).

    Returns:
        ``owner`` of shape (n, 2, 2): (cell, local facet) of the first and second cell, -1 where
        there is none; ``count`` of shape (n,): number of cells at each facet.
    """
    local = shape.facet_vertices
    all_facets = np.sort(cells[:, local], axis=2).reshape(-1, local.shape[1])
    wanted = np.sort(facets, axis=1)
    stacked = np.vstack([wanted, all_facets])
    _, inverse = np.unique(stacked, axis=0, return_inverse=True)
    inverse = inverse.ravel()
    key_of_wanted, key_of_all = inverse[: len(wanted)], inverse[len(wanted) :]
    order = np.argsort(key_of_all, kind="stable")
    sorted_keys = key_of_all[order]
    first = np.searchsorted(sorted_keys, key_of_wanted, side="left")
    count = np.searchsorted(sorted_keys, key_of_wanted, side="right") - first
    owner = np.full((len(wanted), 2, 2), -1, dtype=np.int64)
    for side in range(2):
        there = count > side
        slot = order[first[there] + side]
        owner[there, side, 0] = slot // len(local)
        owner[there, side, 1] = slot % len(local)
    return owner, count


def _interior_pairs(shape: CellShape, cells: Ints) -> tuple[Ints, Ints]:
    """All interior facets among ``cells``: their vertices and two (cell, local facet) slots."""
    local = shape.facet_vertices
    vertices = np.sort(cells[:, local], axis=2).reshape(-1, local.shape[1])
    order = np.lexsort(vertices.T[::-1])
    same = np.all(vertices[order[1:]] == vertices[order[:-1]], axis=1)
    one, two = order[:-1][same], order[1:][same]
    return vertices[one], np.stack([one, two], axis=1)


def _split_vertices(shape: CellShape, cells: Ints, joint_vertices: Ints, num_nodes: int) -> Ints:
    """New vertex numbers of the cells' vertices, shape (num_cells, vertices per cell)."""
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
    graph = coo_array((np.ones(len(rows), dtype=np.int8), (rows, cols)), shape=(size, size))
    _, label = connected_components(graph, directed=False)
    node = corner[near].ravel()
    return _renumber(corner, near, node, label, on_joint[node], num_nodes)


def _renumber(
    corner: Ints, near: Ints, node: Ints, label: Ints, active: NDArray[np.bool_], num_nodes: int
) -> Ints:
    """Give every connected group of slots but the first at each joint node a new number."""
    slots = np.flatnonzero(active)
    pairs = np.stack([node[slots], label[slots]], axis=1)
    groups, first, inverse = np.unique(pairs, axis=0, return_index=True, return_inverse=True)
    order = np.lexsort((first, groups[:, 0]))
    leads = np.ones(len(order), dtype=bool)
    leads[1:] = groups[order[1:], 0] != groups[order[:-1], 0]
    number = np.empty(len(order), dtype=np.int64)
    number[order[leads]] = groups[order[leads], 0]
    number[order[~leads]] = num_nodes + np.arange(np.count_nonzero(~leads))
    flat = node.copy()
    flat[slots] = number[inverse.ravel()]
    corner[near] = flat.reshape(len(near), -1)
    return corner


def _rows_in(rows: Ints, table: Ints) -> NDArray[np.bool_]:
    """Whether each row stands in ``table``."""
    if len(table) == 0:
        return np.zeros(len(rows), dtype=bool)
    _, inverse = np.unique(np.vstack([table, rows]), axis=0, return_inverse=True)
    return np.isin(inverse.ravel()[len(table) :], inverse.ravel()[: len(table)])


def _split_inner_nodes(shape: CellShape, cells: Ints, corner: Ints) -> tuple[Ints, Ints]:
    """Number the nodes inside edges and facets by their entity's new vertices.

    Returns the new cells, and for each node (by key order) its parent.
    """
    element = shape.element()
    topology = basix.topology(shape.type)
    new = cells.copy()
    new[:, : corner.shape[1]] = corner
    next_node = int(max(corner.max(), cells.max())) + 1
    parents: list[Ints] = []
    for dim in range(1, shape.dim):
        dofs = element.entity_dofs[dim]
        if not any(dofs):
            continue
        inner = np.array([d[0] for d in dofs], dtype=np.int64)
        vertices = np.array(topology[dim], dtype=np.int64)
        node = cells[:, inner].ravel()
        keys = np.sort(corner[:, vertices], axis=2).reshape(len(node), -1)
        table = np.column_stack([node, keys])
        groups, first, inverse = np.unique(table, axis=0, return_index=True, return_inverse=True)
        order = np.lexsort((first, groups[:, 0]))
        leads = np.ones(len(order), dtype=bool)
        leads[1:] = groups[order[1:], 0] != groups[order[:-1], 0]
        number = np.empty(len(order), dtype=np.int64)
        number[order[leads]] = groups[order[leads], 0]
        extra = order[~leads]
        number[extra] = next_node + np.arange(len(extra))
        next_node += len(extra)
        parents.append(groups[extra, 0])
        new[:, inner] = number[inverse.ravel()].reshape(len(cells), -1)
    return new, np.concatenate(parents) if parents else np.empty(0, dtype=np.int64)


def _parents(cells: Ints, new: Ints, num_nodes: int) -> Ints:
    """Parent of each node of the split mesh."""
    parent = np.arange(max(int(new.max()) + 1, num_nodes), dtype=np.int64)
    parent[new.ravel()] = cells.ravel()
    return parent


def split_cells(
    shape: CellShape, cells: Ints, x: Floats, joints: list[tuple[str, Ints]]
) -> SplitMesh:
    """Duplicate the nodes across the joints and pair the facets of the two sides.

    Args:
        shape: The reference cell.
        cells: Nodes of the conforming cells, shape (num_cells, nodes per cell).
        x: Node coordinates, shape (num_nodes, gdim), [m].
        joints: Name of each joint and the vertices of its facets, shape (n, vertices per facet).

    Raises:
        MeshError: A joint facet does not have one cell on each side, stands in two joints, or a
            joint has no facet that can open.
    """
    names = [name for name, _ in joints]
    facets = np.vstack([vertices for _, vertices in joints])
    number = np.concatenate([np.full(len(v), i) for i, (_, v) in enumerate(joints)])
    owner, count = find_facets(shape, cells, facets)
    _check_sides(names, facets, number, count, x)
    corner = _split_vertices(shape, cells, facets, len(x))
    new, _ = _split_inner_nodes(shape, cells, corner) if shape.degree > 1 else (corner, None)
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
                "front inside the body; use a finer mesh."
            )
    one, two, number = one[apart], two[apart], number[apart]
    swap = orient_pairs(shape, cells, x, number, one, two)
    minus = np.where(swap[:, None], two, one)
    plus = np.where(swap[:, None], one, two)
    minus_nodes = cells[minus[:, :1], local[minus[:, 1]]]
    plus_nodes = cells[plus[:, :1], local[plus[:, 1]]]
    match = np.argmax(plus_nodes[:, None, :] == minus_nodes[:, :, None], axis=2)
    return SplitMesh(
        cells=new,
        parent=_parents(cells, new, len(x)),
        joint=number,
        minus=minus,
        plus=plus,
        match=match,
        bonded=bonded,
    )


def _check_sides(names: list[str], facets: Ints, number: Ints, count: Ints, x: Floats) -> None:
    """Refuse joint facets that do not separate two cells or stand in two joints."""
    wrong = np.flatnonzero(count != 2)
    if len(wrong):
        where = ", ".join(f"{v:.4g}" for v in x[facets[wrong[0]]].mean(axis=0))
        raise MeshError(
            f"Joint {names[number[wrong[0]]]!r}: {len(wrong)} of its facets do not have one cell "
            f"on each side (the first, centred at ({where}), has {count[wrong[0]]}); a joint must "
            "lie inside the body, between two cells."
        )
    _, first, inverse = np.unique(
        np.sort(facets, axis=1), axis=0, return_index=True, return_inverse=True
    )
    twice = np.flatnonzero(first[inverse.ravel()] != np.arange(len(facets)))
    if len(twice):
        one, two = names[number[first[inverse.ravel()[twice[0]]]]], names[number[twice[0]]]
        raise MeshError(f"{len(twice)} facets stand twice in the joints {one!r} and {two!r}.")


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


def pair_coincident(
    shape: CellShape, cells: Ints, x: Floats, names: list[str], slots: dict[str, Ints]
) -> SplitMesh:
    """Pair the facets of joints whose faces are duplicated in the mesh already.

    Args:
        shape: The reference cell.
        cells: Cell nodes, shape (num_cells, nodes per cell).
        x: Node coordinates, shape (num_nodes, gdim), [m].
        names: Joint names; the faces of NAME are the groups ``NAME-`` and ``NAME+``.
        slots: (cell, local facet) of the facets of each group, shape (n, 2).

    Raises:
        MeshError: The faces of a joint have different numbers of facets or do not match.
    """
    local = shape.facet_vertices
    minus, plus, match, joint = [], [], [], []
    for i, name in enumerate(names):
        one, two = slots[f"{name}-"], slots[f"{name}+"]
        if len(one) != len(two):
            raise MeshError(
                f"Joint {name!r}: {len(one)} facets on its - face and {len(two)} on its + face; "
                "the faces must be meshed alike."
            )
        a = x[cells[one[:, :1], local[one[:, 1]]]]
        b = x[cells[two[:, :1], local[two[:, 1]]]]
        _, partner = cKDTree(b.mean(axis=1)).query(a.mean(axis=1))
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
