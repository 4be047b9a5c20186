# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Grids of unit cells with joints, whose numbers of split vertices are counted by hand."""

from __future__ import annotations

import itertools
from collections import defaultdict
from typing import Any

import basix
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints import JointedMesh, mesh_from_arrays
from dolfinx_joints.mesh.cells import CellShape
from dolfinx_joints.mesh.splitting import SplitMesh, split_cells

Case = tuple[NDArray[np.int64], NDArray[np.float64], list[tuple[str, NDArray[np.int64]]], int]

SHAPES = [
    CellShape(name=name, degree=degree)
    for name in ("triangle", "quadrilateral", "tetrahedron", "hexahedron")
    for degree in (1, 2)
]


def name_of(value):
    return f"{value.name}{value.degree}" if isinstance(value, CellShape) else None


def grid_cells(simplex, dim):
    """Corners of the cells within the unit cube."""
    if not simplex:
        # Basix numbers the corners of quadrilaterals and hexahedra with x running fastest.
        return [[c[::-1] for c in itertools.product((0, 1), repeat=dim)]]
    chains = []
    for axes in itertools.permutations(range(dim)):
        corner = [0] * dim
        chain = [tuple(corner)]
        for axis in axes:
            corner[axis] = 1
            chain.append(tuple(corner))
        chains.append(chain)
    return chains


def grid(shape, divisions):
    """Cells and nodes of a grid with ``divisions`` unit cells along each axis."""
    dim = shape.dim
    divisions = divisions[:dim]
    corners = np.array(grid_cells(shape.name in ("triangle", "tetrahedron"), dim))
    origins = np.array(list(itertools.product(*(range(n) for n in divisions))))
    vertices = (origins[:, None, None, :] + corners[None]).reshape(-1, corners.shape[1], dim)
    # Place nodes of higher degree by the linear shape functions of the reference cell.
    linear = basix.create_element(
        basix.ElementFamily.P, shape.type, 1, basix.LagrangeVariant.gll_warped
    )
    functions = linear.tabulate(0, shape.element().points)[0, :, :, 0]
    nodes = np.round(np.einsum("qv,cvd->cqd", functions, vertices), 6)
    x, number = np.unique(nodes.reshape(-1, dim), axis=0, return_inverse=True)
    return number.reshape(nodes.shape[:2]).astype(np.int64), x


def facets_on(shape, cells, x, *surfaces):
    """Interior facets whose vertices all lie on one of the surfaces, vertices ascending."""
    count = defaultdict(int)
    for cell in cells:
        for local in shape.facet_vertices:
            count[tuple(sorted(int(v) for v in cell[local]))] += 1
    return np.array(
        [
            facet
            for facet, times in sorted(count.items())
            if times == 2
            and any(all(surface(*_padded(x[v])) for v in facet) for surface in surfaces)
        ],
        dtype=np.int64,
    )


def _padded(point):
    return (*point, 0.0) if len(point) == 2 else tuple(point)


def through(x, y, z):
    return x == 2


def to_front(x, y, z):
    return x == 2 and y <= 2


def across(x, y, z):
    return y == 2


def half_across(x, y, z):
    return y == 2 and x >= 2


PERIMETER = (
    lambda x, y, z: y == 1 and 1 <= x <= 3,
    lambda x, y, z: x == 1 and y >= 1,
    lambda x, y, z: x == 3 and y >= 1,
)

RING = (
    lambda x, y, z: x in (1, 3) and 1 <= y <= 3,
    lambda x, y, z: y in (1, 3) and 1 <= x <= 3,
)

CASES = {
    # 5 vertices of the line x = 2 become two each.
    "through": ({"a": (through,)}, 5),
    # y = 0 and 1; the vertex at y = 2 is the front and stays one.
    "front": ({"a": (to_front,)}, 2),
    # 4 of x = 2 become two, 2 of y = 2 become two, the crossing becomes three.
    "T": ({"a": (through,), "b": (half_across,)}, 4 + 2 + 2),
    # 8 become two, the crossing becomes four.
    "X": ({"a": (through,), "b": (across,)}, 8 + 3),
    # A U of 9 vertices, and a joint with 3 more that meets its middle from above.
    "perimetral": (
        {"perimetral": PERIMETER, "a": (lambda x, y, z: x == 2 and y >= 1,)},
        8 + 2 + 3,
    ),
    # The 8 vertices of a closed square.
    "ring": ({"a": RING}, 8),
}


def case(name: str, shape: CellShape) -> Case:
    """Cells, nodes, joints by name, and the number of vertices that splitting adds."""
    joints, per_layer = CASES[name]
    cells, x = grid(shape, (4, 4, 2))
    named = [(n, facets_on(shape, cells, x, *surfaces)) for n, surfaces in joints.items()]
    layers = 3 if shape.dim == 3 else 1
    return cells, x, named, per_layer * layers


def already_split(shape: CellShape, distance: float = 0.0) -> tuple[SplitMesh, NDArray[np.float64]]:
    """Return the case "through" with duplicated nodes, its + side moved by ``distance``."""
    cells, x, joints, _ = case("through", shape)
    split = split_cells(shape, cells, x, joints)
    x = x[split.parent].copy()
    corners = len(basix.topology(shape.type)[0])
    beyond = np.unique(split.cells[x[split.cells[:, :corners]].mean(axis=1)[:, 0] > 2])
    x[beyond] += distance
    return split, x


def distorted(comm: Any, shape: CellShape, scene: str) -> JointedMesh:
    """Return a case with moved nodes and with cells and nodes in another order (collective).

    ``gap`` is the case "through" with duplicated nodes and a distance between the faces.
    """
    if scene == "gap":
        split, x = already_split(shape)
        cells, apart = split.cells, already_split(shape, distance=0.05)[1] - x
        local = shape.facet_vertices
        sides = {"a-": split.minus, "a+": split.plus}
        groups = {name: cells[side[:, :1], local[side[:, 1]]] for name, side in sides.items()}
        joints = ["a"]
    else:
        cells, x, named, _ = case(scene, shape)
        apart, groups, joints = 0.0, dict(named), [name for name, _ in named]
    rng = np.random.default_rng(3)
    new_node, new_cell = rng.permutation(len(x)), rng.permutation(len(cells))
    moved = np.empty_like(x)
    moved[new_node] = x + 0.1 * np.sin(x @ rng.normal(size=(shape.dim, shape.dim))) + apart
    return mesh_from_arrays(
        comm,
        cell=shape.name,
        x=moved,
        cells=new_node[cells][new_cell],
        facet_groups={name: new_node[facets] for name, facets in groups.items()},
        joints=joints,
    )
