# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Random fracture networks: where nodes are duplicated, by a count cell by cell.

On lattices and on unstructured (Delaunay) meshes, fractures are parts of planes and boxes that
cross, meet and end as they fall, and facets at random.

     |   b   |           Cells around a vertex are neighbours across their common facets. A
 ----o=======o---        fractured one (=) separates them, and so does the outside; what is still
     |   a   |           connected shares one node.

A node of an order-2 mesh inside an edge or a face is shared where all vertices of that edge or
face are: vertices decide. The count uses union-find in plain Python and shares nothing with the
package but the order of the nodes within a reference cell.
"""

from collections import Counter

import numpy as np
import pytest

pytest.importorskip("basix")

import basix
from grids import SHAPES, grid
from scipy.spatial import Delaunay

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.mesh.cells import CellShape
from dolfinx_joints.mesh.splitting import split_cells

SEEDS = {2: 80, 3: 60}


class UnionFind:
    """Classes of things that were joined."""

    def __init__(self):
        self.above = {}

    def find(self, thing):
        root = thing
        while (above := self.above.setdefault(root, root)) != root:
            root = above
        self.above[thing] = root
        return root

    def join(self, one, two):
        self.above[self.find(one)] = self.find(two)


def vertices_and_cells(rng, shape):
    """A lattice, or random points with simplices between them; vertices of its cells."""
    simplex = shape.name in ("triangle", "tetrahedron")
    if simplex and rng.random() < 0.5:
        x = rng.random((rng.integers(20, 60 if shape.dim == 2 else 40), shape.dim))
        cells = np.sort(Delaunay(x).simplices, axis=1)
        volume = np.linalg.det(x[cells[:, 1:]] - x[cells[:, :1]])
        return x, cells[np.abs(volume) > 1e-6], rng.normal(size=(shape.dim, shape.dim))
    cells, x = grid(shape, rng.integers(2, 7 if shape.dim == 2 else 5, size=shape.dim))
    return x, cells, np.eye(shape.dim)


def network(name, seed):
    """Vertices, cells, inner facets with their two cells, and the joint of each fractured one."""
    shape = CellShape(name=name, degree=1)
    rng = np.random.default_rng((shape.dim, seed))
    x, cells, normals = vertices_and_cells(rng, shape)
    at_facet = {}
    for number, facets in enumerate(np.sort(cells[:, shape.facet_vertices], axis=2).tolist()):
        for facet in facets:
            at_facet.setdefault(tuple(facet), []).append(number)
    inside = {facet: pair for facet, pair in at_facet.items() if len(pair) == 2}
    centres, middles = x[cells].mean(axis=1), {f: x[list(f)].mean(axis=0) for f in inside}

    def box(places):
        low, high = np.sort(x[rng.integers(len(x), size=2)], axis=0)
        return np.all((places > low - 1e-9) & (places < high + 1e-9), axis=-1)

    joint, sparse, pieces = {}, rng.choice([0.0, 0.0, 0.1, 0.5]), rng.integers(1, 7)
    while pieces > 0 or not joint:
        pieces -= 1
        planes = (centres - x[rng.integers(len(x))]) @ rng.permutation(normals).T > 0.0
        sides = box(centres)[:, None] if rng.random() < 0.3 else planes[:, : rng.choice([1, 1, 3])]
        part = box(np.array(list(middles.values()))) | (rng.random() < 0.5)
        for (facet, (one, two)), chosen in zip(inside.items(), part, strict=True):
            if chosen and np.any(sides[one] != sides[two]):
                joint.setdefault(facet, pieces % 3)
    joint |= {f: 3 for f in inside if f not in joint and rng.random() < sparse}
    return x, cells.tolist(), inside, joint


def sectors_of(cells, inside, joint):
    """Class of each (vertex, cell): cells around a vertex, joined through open facets at it."""
    classes = UnionFind()
    for facet, (one, two) in inside.items():
        if facet not in joint:
            for vertex in facet:
                classes.join((vertex, one), (vertex, two))
    return {(v, n): classes.find((v, n)) for n, cell in enumerate(cells) for v in cell}


def with_inner_nodes(shape, vertex_cells):
    """Nodes of the cells, each known by the sorted vertices of its entity."""
    topology, element = basix.topology(shape.type), shape.element()
    number, cells = {}, []
    for vertices in vertex_cells:
        nodes = [0] * element.dim
        for entities, dofs in zip(topology, element.entity_dofs, strict=True):
            for entity, inside in zip(entities, dofs, strict=True):
                for dof in inside:  # at most one
                    key = tuple(sorted(vertices[v] for v in entity))
                    nodes[dof] = number.setdefault(key, len(number))
        cells.append(nodes)
    return np.array(cells, dtype=np.int64), list(number)


def check_copies(split, cells, copy_of):
    """Cells share a node exactly where ``copy_of(cell, node)`` says so."""
    found = {}
    for number, (old, new) in enumerate(zip(cells.tolist(), split.cells.tolist(), strict=True)):
        for before, after in zip(old, new, strict=True):
            expected = (before, copy_of(number, before))
            assert found.setdefault(expected, after) == after, f"node {before}, cell {number}"
    assert len(set(found.values())) == len(found) == len(split.parent)
    assert sorted(set(found.values())) == list(range(len(found)))


def check_pairs(shape, split, cells, x, expected):
    """The pairs are the facets ``expected``, coincide, and are all that the surface has gained."""
    np.testing.assert_array_equal(x[split.parent][split.cells], x[cells])  # places and volume
    local = shape.facet_vertices
    minus = split.cells[split.minus[:, :1], local[split.minus[:, 1]]]
    plus = split.cells[split.plus[:, :1], local[split.plus[:, 1]]]
    plus = np.take_along_axis(plus, split.match, axis=1)
    np.testing.assert_array_equal(split.parent[minus], split.parent[plus])
    assert np.all(np.any(minus != plus, axis=1))
    assert {tuple(sorted(f)) for f in split.parent[minus].tolist()} == expected
    assert len(minus) == len(expected)
    gained = surface(shape, split.cells) - surface(shape, cells)
    assert gained == 2 * len(expected)


def surface(shape, cells):
    """Number of facets with one cell."""
    facets = np.sort(cells[:, shape.facet_vertices], axis=2).reshape(
        -1, len(shape.facet_vertices[0])
    )
    return np.count_nonzero(np.unique(facets, axis=0, return_counts=True)[1] == 1)


@pytest.mark.parametrize(
    ("shape", "seed"),
    [
        pytest.param(
            *(shape, seed),
            id=f"{shape.name}{shape.degree}-{seed}",
            marks=[pytest.mark.slow] if seed >= 15 else [],
        )
        for shape in SHAPES
        for seed in range(SEEDS[shape.dim])
    ],
)
def test_network(shape, seed):
    x, vertex_cells, inside, joint = network(shape.name, seed)
    label = sectors_of(vertex_cells, inside, joint)
    opening = {
        facet
        for facet in joint
        if any(label[v, inside[facet][0]] != label[v, inside[facet][1]] for v in facet)
    }
    cells, keys = with_inner_nodes(shape, vertex_cells)
    node = {key[0]: number for number, key in enumerate(keys) if len(key) == 1}
    places = np.array([x[list(key)].mean(axis=0) for key in keys])
    # A joint that cannot open is refused: here it is left to another that can.
    can_open = {joint[facet] for facet in opening}
    facets = {}
    for facet, j in joint.items():
        chosen = j if j in can_open else min(can_open, default=j)
        facets.setdefault(f"joint_{chosen}", []).append([node[v] for v in facet])
    given = [(name, np.array(facets[name], dtype=np.int64)) for name in sorted(facets)]
    if not can_open:
        with pytest.raises(MeshError, match="cannot open: all vertices of its"):
            split_cells(shape, cells, places, given)
        return
    split = split_cells(shape, cells, places, given)
    check_copies(split, cells, lambda number, old: tuple(label[v, number] for v in keys[old]))
    expected = {tuple(sorted(node[v] for v in facet)) for facet in opening}
    check_pairs(shape, split, cells, places, expected)
    assert split.bonded.sum() == len(joint) - len(opening)


@pytest.mark.parametrize(("name", "dim"), [("quadrilateral", 2), ("hexahedron", 3)])
def test_networks_hold_every_kind_of_node(name, dim):
    # In 2-D a vertex has 1 (whole, or a front), 2, 3 (T) or 4 (X) copies, in 3-D up to 8 (three
    # planes; 7, those planes less a quarter, is rare), and joints end inside the body, too.
    copies, fronts = set(), 0
    for seed in range(SEEDS[dim]):
        _, cells, inside, joint = network(name, seed)
        classes = Counter(v for v, _ in set(map(tuple, sectors_of(cells, inside, joint).values())))
        copies |= set(classes.values())
        fronts += sum(classes[v] == 1 for v in {v for facet in joint for v in facet})
    assert copies >= set(range(1, 2**dim + 1)) - {7}
    assert fronts > 50
