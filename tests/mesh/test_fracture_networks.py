# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Random fracture networks: where nodes are duplicated, by a count that knows no mesh.

On a lattice, fractures are rectangles (segments in 2-D) of lattice faces that cross, meet and end
as they fall. Whether two lattice cells keep a node in common follows from the lattice alone:

        |   b   |           Around a vertex the 4 (in 3-D, 8) sectors are neighbours across the
    ----o=======o---        quarter-planes between them. A fractured one (=) separates them, and
        |   a   |           so does the outside; what is still connected shares one node.

A node of an order-2 mesh inside an edge or a face is shared where all vertices of that edge or
face are: vertices decide. On unstructured (Delaunay) meshes the same is counted cell by cell. Both
counts use union-find in plain Python and share nothing with the package but the order of the
nodes within a reference cell.
"""

import functools
import itertools
import random
import re

import numpy as np
import pytest

pytest.importorskip("basix")

import basix
from scipy.spatial import Delaunay

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.mesh.cells import CellShape
from dolfinx_joints.mesh.splitting import split_cells

LATTICE_SEEDS = {2: 80, 3: 45}
DELAUNAY_SEEDS = {2: 50, 3: 30}
SHAPES = [
    CellShape(name=name, degree=degree)
    for name in ("triangle", "quadrilateral", "tetrahedron", "hexahedron")
    for degree in (1, 2)
]


def every(shapes, seeds):
    """Each shape with each seed of its dimension, most of them slow."""
    return [
        pytest.param(
            *(shape, seed),
            id=f"{shape.name}{shape.degree}-{seed}",
            marks=[pytest.mark.slow] if seed >= 15 else [],
        )
        for shape in shapes
        for seed in range(seeds[shape.dim])
    ]


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


# The lattice: unit cells named by their lowest corner; the face (axis, corner) is the side of the
# cell ``corner`` towards lower coordinates, normal to ``axis``. Places are in half units, so that
# vertices are even and the middles of edges, faces and cells have odd coordinates.


def shifted(corner, axis, step):
    return (*corner[:axis], corner[axis] + step, *corner[axis + 1 :])


class Lattice:
    """A body of ``size`` cells with fractured faces, each with the number of its joint."""

    def __init__(self, size, fractures):
        self.size, self.dim = size, len(size)
        self.cells = list(itertools.product(*(range(n) for n in size)))
        self.joint = {
            (axis, corner): joint
            for (axis, corner), joint in fractures.items()
            if 0 < corner[axis] < size[axis]
            and all(0 <= corner[k] < size[k] for k in range(self.dim) if k != axis)
        }
        self.label = {
            vertex: self._sectors(vertex)
            for vertex in itertools.product(*(range(n + 1) for n in size))
        }

    def around(self, place):
        """Cells that hold a place."""
        choices = [
            [c for c in {(p - 1) // 2, p // 2} if 0 <= c < n]
            for p, n in zip(place, self.size, strict=True)
        ]
        return list(itertools.product(*choices))

    def _sectors(self, vertex):
        """Class of each cell around a vertex."""
        cells = self.around(tuple(2 * v for v in vertex))
        classes = UnionFind()
        for cell in cells:
            for axis in range(self.dim):
                other = shifted(cell, axis, 1)
                if other in cells and (axis, other) not in self.joint:
                    classes.join(cell, other)
        return {cell: classes.find(cell) for cell in cells}

    def copy(self, place, cell, simplex):
        """What tells the copy of a node that a cell has at a place from other copies there."""
        low, high = tuple(p // 2 for p in place), tuple((p + 1) // 2 for p in place)
        if simplex:  # the middle of a diagonal, which rises along all of its axes
            corners = sorted({low, high})
        else:
            corners = sorted(set(itertools.product(*zip(low, high, strict=True))))
        return tuple(self.label[corner][cell] for corner in corners)

    def facets(self, face, simplex):
        """Corners of the mesh facets on a face."""
        axis, low = face
        others = [k for k in range(self.dim) if k != axis]
        if not simplex or self.dim == 2:
            steps = itertools.product((0, 1), repeat=len(others))
            corners = [
                functools.reduce(lambda c, s: shifted(c, *s), zip(others, step, strict=True), low)
                for step in steps
            ]
            return [corners]
        high = functools.reduce(lambda c, k: shifted(c, k, 1), others, low)
        return [[low, shifted(low, k, 1), high] for k in others]

    def opens(self, face, corners):
        """Whether the two sides of a facet have a vertex of their own."""
        axis, upper = face
        lower = shifted(upper, axis, -1)
        return any(self.label[c][upper] != self.label[c][lower] for c in corners)

    def bodies(self):
        """Number of bodies that the fractures leave."""
        classes = UnionFind()
        for cell in self.cells:
            for axis in range(self.dim):
                other = shifted(cell, axis, 1)
                if other[axis] < self.size[axis] and (axis, other) not in self.joint:
                    classes.join(cell, other)
        return len({classes.find(cell) for cell in self.cells})


def rectangle(axis, low, high):
    """Faces normal to ``axis`` at ``low[axis]``, from ``low`` to ``high`` along the others."""
    spans = [[low[k]] if k == axis else range(low[k], high[k]) for k in range(len(low))]
    return [(axis, corner) for corner in itertools.product(*spans)]


def closed_box(low, high):
    """All faces of a box."""
    faces = []
    for axis in range(len(low)):
        faces += rectangle(axis, low, high)
        faces += rectangle(axis, shifted(low, axis, high[axis] - low[axis]), high)
    return faces


def random_box(rng, size):
    bounds = [sorted(rng.sample(range(n + 1), 2)) for n in size]
    return tuple(b[0] for b in bounds), tuple(b[1] for b in bounds)


def random_fractures(rng, size):
    """Rectangles, now and then a closed box, a plane normal to each axis, or ribs in a box."""
    dim = len(size)
    pieces = []
    for _ in range(rng.randint(1, 6)):
        low, high = random_box(rng, size)
        kind, axis = rng.random(), rng.randrange(dim)
        if kind < 0.7:
            pieces.append(rectangle(axis, low, high))
        elif kind < 0.8:
            pieces.append(closed_box(low, high))
        elif kind < 0.9:
            for k in range(dim):
                pieces.append(rectangle(k, shifted((0,) * dim, k, low[k]), size))
        else:
            pieces.append(closed_box(low, high))
            for k in range(low[axis] + 1, high[axis]):
                pieces.append(rectangle(axis, shifted(low, axis, k - low[axis]), high))
    joints = rng.randint(1, 3)
    fractures = {}
    for number, piece in enumerate(pieces):
        for face in piece:
            fractures.setdefault(face, number % joints)
    return fractures


@functools.cache
def lattice(dim, seed):
    """The network of a seed; what falls on the boundary alone is thrown again."""
    rng = random.Random(1000 * dim + seed)
    size = tuple(rng.randint(2, 6 if dim == 2 else 4) for _ in range(dim))
    while not (body := Lattice(size, random_fractures(rng, size))).joint:
        pass
    return body


# Meshes: cells by their vertices; the other nodes belong to an edge, a face or a cell, known by
# its vertices.


def lattice_corners(shape):
    """Corners of the mesh cells within a lattice cell, relative to its lowest corner."""
    dim = shape.dim
    if shape.name in ("quadrilateral", "hexahedron"):  # basix: x runs fastest
        return [[c[::-1] for c in itertools.product((0, 1), repeat=dim)]]
    chains = []
    for axes in itertools.permutations(range(dim)):  # Kuhn: along the axes, one after the other
        chain = [(0,) * dim]
        for axis in axes:
            chain.append(shifted(chain[-1], axis, 1))
        chains.append(chain)
    return chains


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
    """Cells share a node exactly where ``copy_of(cell, node)`` says so; gives copies by node."""
    found = {}
    for number, (old, new) in enumerate(zip(cells.tolist(), split.cells.tolist(), strict=True)):
        for before, after in zip(old, new, strict=True):
            expected = (before, copy_of(number, before))
            assert found.setdefault(expected, after) == after, f"node {before}, cell {number}"
    assert len(set(found.values())) == len(found) == len(split.parent)
    assert sorted(set(found.values())) == list(range(len(found)))
    return np.bincount(split.parent)


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
    count = {}
    for facet in np.sort(cells[:, shape.facet_vertices], axis=2).reshape(
        -1, shape.facet_vertices.shape[1]
    ):
        key = tuple(facet.tolist())
        count[key] = count.get(key, 0) + 1
    return sum(times == 1 for times in count.values())


def joined_bodies(cells):
    """Number of bodies of cells that share nodes."""
    classes = UnionFind()
    for row in cells.tolist():
        for node in row[1:]:
            classes.join(row[0], node)
    return len({classes.find(row[0]) for row in cells.tolist()})


def named(facets):
    """Facets by joint as `split_cells` takes them."""
    return [(f"joint_{joint}", np.array(facets[joint], dtype=np.int64)) for joint in sorted(facets)]


@pytest.mark.parametrize(("shape", "seed"), every(SHAPES, LATTICE_SEEDS))
def test_lattice_network(shape, seed):
    body = lattice(shape.dim, seed)
    simplex = shape.name in ("triangle", "tetrahedron")
    home, vertex_cells = [], []
    for cell in body.cells:
        for corners in lattice_corners(shape):
            home.append(cell)
            vertex_cells.append([tuple(np.add(cell, c).tolist()) for c in corners])
    cells, keys = with_inner_nodes(shape, vertex_cells)
    x = np.array([np.mean(key, axis=0) for key in keys])
    places = [tuple(int(c) for c in row) for row in 2 * x]
    assert len(set(places)) == len(places)
    node = {key[0]: number for number, key in enumerate(keys) if len(key) == 1}

    facets, opening, bonded = {}, {}, {}
    for face, joint in body.joint.items():
        for corners in body.facets(face, simplex):
            facet = tuple(sorted(node[c] for c in corners))
            facets.setdefault(joint, []).append(facet)
            kind = opening if body.opens(face, corners) else bonded
            kind.setdefault(joint, set()).add(facet)
    shut = sorted(set(facets) - set(opening))
    if shut:
        text = f"Joint 'joint_{shut[0]}' cannot open: all vertices of its {len(facets[shut[0]])} f"
        with pytest.raises(MeshError, match=re.escape(text)):
            split_cells(shape, cells, x, named(facets))
        return

    split = split_cells(shape, cells, x, named(facets))
    check_copies(split, cells, lambda number, old: body.copy(places[old], home[number], simplex))
    check_pairs(shape, split, cells, x, set().union(*opening.values()))
    assert split.bonded.tolist() == [len(bonded.get(joint, ())) for joint in sorted(facets)]
    assert joined_bodies(split.cells) == body.bodies()


@pytest.mark.parametrize("dim", [2, 3])
def test_lattice_networks_hold_every_kind_of_node(dim):
    # In 2-D a vertex has 1 (whole, or a front), 2, 3 (T) or 4 (X) copies, in 3-D up to 8 (three
    # planes; 7, those planes less a quarter, is rare), and joints end inside the body, too.
    copies, fronts, bodies = set(), 0, set()
    for seed in range(LATTICE_SEEDS[dim]):
        body = lattice(dim, seed)
        bodies.add(body.bodies())
        for vertex, sectors in body.label.items():
            count = len(set(sectors.values()))
            copies.add(count)
            touched = any(
                (axis, cell) in body.joint and shifted(cell, axis, -1) in sectors
                for cell in sectors
                for axis in range(dim)
            )
            inside = all(0 < v < n for v, n in zip(vertex, body.size, strict=True))
            fronts += touched and inside and count == 1
    assert copies >= set(range(1, 2**dim + 1)) - {7}
    assert fronts > 50
    assert {1, 2, 3, 4} <= bodies


@pytest.mark.parametrize(
    ("size", "faces", "copies"),
    [
        # One segment over two cells: its middle vertex doubles, its ends are the front.
        ((4, 4), rectangle(0, (2, 1), (2, 3)), {(2, 2): 2}),
        # T, L and X of segments around the vertex (2, 2), the arms' ends being fronts or outside.
        ((4, 4), rectangle(0, (2, 0), (2, 4)) + rectangle(1, (2, 2), (4, 2)),
         {(2, 0): 2, (2, 1): 2, (2, 2): 3, (2, 3): 2, (2, 4): 2, (3, 2): 2, (4, 2): 2}),
        ((4, 4), rectangle(0, (2, 2), (2, 4)) + rectangle(1, (2, 2), (4, 2)),
         {(2, 2): 2, (2, 3): 2, (2, 4): 2, (3, 2): 2, (4, 2): 2}),
        ((4, 4), rectangle(0, (2, 1), (2, 3)) + rectangle(1, (1, 2), (3, 2)), {(2, 2): 4}),
        # A closed square: its four corners and four middles.
        ((4, 4), closed_box((1, 1), (3, 3)),
         {(a, b): 2 for a in (1, 2, 3) for b in (1, 2, 3) if (a, b) != (2, 2)}),
        # Three planes through the middle of a cube: 8 there, 4 along their lines, 2 elsewhere.
        ((2, 2, 2), rectangle(0, (1, 0, 0), (1, 2, 2)) + rectangle(1, (0, 1, 0), (2, 1, 2))
         + rectangle(2, (0, 0, 1), (2, 2, 1)),
         {v: 2 ** v.count(1) for v in itertools.product(range(3), repeat=3) if 1 in v}),
    ],
    ids=["segment", "T", "L", "X", "closed", "three planes"],
)  # fmt: skip
def test_the_count_itself_by_hand(size, faces, copies):
    body = Lattice(size, dict.fromkeys(faces, 0))
    found = {v: len(set(sectors.values())) for v, sectors in body.label.items()}
    assert {v: n for v, n in found.items() if n > 1} == copies


def delaunay(dim, seed):
    """Points, cells, and facets on random planes with random other facets, some left out."""
    rng = np.random.default_rng((dim, seed))
    x = rng.random((rng.integers(20, 60 if dim == 2 else 40), dim))
    cells = [sorted(cell) for cell in Delaunay(x).simplices.tolist()]
    cells = [c for c in cells if abs(np.linalg.det(x[c[1:]] - x[c[0]])) > 1e-6]
    at_facet = {}
    for number, cell in enumerate(cells):
        for facet in itertools.combinations(cell, dim):
            at_facet.setdefault(facet, []).append(number)
    inside = {facet: pair for facet, pair in at_facet.items() if len(pair) == 2}
    middle = np.array([x[cell].mean(axis=0) for cell in cells])
    density, sparse = rng.uniform(0.5, 1.0), rng.choice([0.0, 0.1, 0.5])
    sides = [(middle - x.mean(axis=0)) @ rng.normal(size=dim) > 0 for _ in range(2)]
    joint = {}
    for facet, (one, two) in inside.items():
        crossed = [number for number, side in enumerate(sides) if side[one] != side[two]]
        if crossed and rng.random() < density:
            joint[facet] = crossed[0]
        elif rng.random() < sparse:
            joint[facet] = 2
    return x, cells, inside, joint


def sectors_of(cells, inside, joint):
    """Class of each (vertex, cell): cells around a vertex, joined through open facets at it."""
    classes = UnionFind()
    for facet, (one, two) in inside.items():
        if facet not in joint:
            for vertex in facet:
                classes.join((vertex, one), (vertex, two))
    return {(v, n): classes.find((v, n)) for n, cell in enumerate(cells) for v in cell}


@pytest.mark.parametrize(
    ("shape", "seed"),
    every([s for s in SHAPES if s.name in ("triangle", "tetrahedron")], DELAUNAY_SEEDS),
)
def test_unstructured_network(shape, seed):
    x, vertex_cells, inside, joint = delaunay(shape.dim, seed)
    label = sectors_of(vertex_cells, inside, joint)
    opening = {
        facet
        for facet in joint
        if any(label[v, inside[facet][0]] != label[v, inside[facet][1]] for v in facet)
    }
    # A joint that cannot open would be refused: here it is left to another that can.
    can_open = {joint[facet] for facet in opening}
    assert can_open
    home = {facet: j if j in can_open else min(can_open) for facet, j in joint.items()}

    cells, keys = with_inner_nodes(shape, vertex_cells)
    node = {key[0]: number for number, key in enumerate(keys) if len(key) == 1}
    places = np.array([x[list(key)].mean(axis=0) for key in keys])
    facets = {}
    for facet, j in home.items():
        facets.setdefault(j, []).append([node[v] for v in facet])
    split = split_cells(shape, cells, places, named(facets))
    check_copies(split, cells, lambda number, old: tuple(label[v, number] for v in keys[old]))
    expected = {tuple(sorted(node[v] for v in facet)) for facet in opening}
    check_pairs(shape, split, cells, places, expected)
    assert split.bonded.sum() == len(joint) - len(opening)
