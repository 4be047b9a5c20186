# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes with several kinds of elements and named sets, converted into a `RawMesh`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import dolfinx.mesh
import numpy as np
from dolfinx.cpp.io import perm_vtk
from scipy.spatial import KDTree

from dolfinx_joints.common.arrays import Flags
from dolfinx_joints.common.errors import MeshError, warn
from dolfinx_joints.mesh.blocks import same_places
from dolfinx_joints.mesh.cells import (
    CellShape,
    Floats,
    Ints,
    RawMesh,
    check_curves,
    find_facets,
    middle,
)
from dolfinx_joints.mesh.preparation import joint_names

_DIMENSION = {"line": 1, "triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}
_DIMENSION |= {"pyramid": 3, "wedge": 3}
# Numbers of nodes of the cells that are read; the first one has degree 1.
_SIZES: dict[str, tuple[int, ...]] = {"triangle": (3, 6), "quadrilateral": (4, 8, 9)}
_SIZES |= {"tetrahedron": (4, 10), "hexahedron": (8, 20, 27)}
# Corners and edge nodes of the faces of a hexahedron, in VTK's order of the face nodes.
_FACES = [[0, 3, 7, 4, 11, 19, 15, 16], [1, 2, 6, 5, 9, 18, 13, 17], [0, 1, 5, 4, 8, 17, 12, 16]]
_FACES += [[3, 2, 6, 7, 10, 18, 14, 19], [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]]
_LAYERS = {  # kind and opposite vertices of the elements of a joint, by the number of vertices
    4: ("quadrilateral", [[0, 1], [3, 2]]),
    6: ("wedge", [[0, 1, 2], [3, 4, 5]]),
    8: ("hexahedron", [[0, 1, 2, 3], [4, 5, 6, 7]]),
}
COINCIDENT = 1e-6  # nodes coincide if distance / edge length is below this limit


class FileMesh:
    """Content of a file; numbers of nodes and elements start at 0.

    Attributes:
        x: Node coordinates in the unit of the file, shape (nodes, 2 or 3).
        kind: ``line``, ``triangle``, ``quadrilateral``, ``tetrahedron``, ``pyramid``, ``wedge``,
            ``hexahedron``, ``cohesive``, or the file's name of another kind, shape (elements,).
        nodes: Nodes of each element in the order of VTK, filled with -1 to the longest element.
        element: Function that returns the numbers of elements from their labels in the file.
        node_sets: Node numbers of each set.
        element_sets: Element numbers of each set.
        facets: Vertices of the facets of each surface, in several arrays.
    """

    def __init__(
        self,
        x: Floats,
        blocks: Sequence[tuple[str, Any]],
        node_labels: Any,
        node_sets: Mapping[str, Any],
        element_sets: Mapping[str, Any],
    ) -> None:
        """Take the labels of a file; blocks have the kind, and the label and nodes of elements."""
        labels = [row[0] for _, rows in blocks for row in rows]
        node, self.element = _numbers("node", node_labels), _numbers("element", labels)
        if not np.isfinite(x).all():
            raise MeshError("the file has coordinates that are not finite numbers.")
        self.x, width = x, max([8, *(rows.shape[1] - 1 for _, rows in blocks)])
        self.kind = np.repeat([kind for kind, _ in blocks], [len(rows) for _, rows in blocks])
        self.nodes: Ints = np.full((len(self.kind), width), -1)
        end = 0
        for _, rows in blocks:
            start, end = end, end + len(rows)
            self.nodes[start:end, : rows.shape[1] - 1] = node(rows[:, 1:])
        self.node_sets = {name: node(members) for name, members in node_sets.items()}
        self.element_sets = {name: self.element(own) for name, own in element_sets.items()}
        self.facets: dict[str, list[Ints]] = {}

    def add_sides(
        self, name: str, labels: Any, side: Any, sides: Mapping[str, Mapping[Any, str]]
    ) -> None:
        """Add a side of elements to the facets of a surface.

        ``sides`` has the vertices, from 1, of the sides of each kind by their labels in the file.
        """
        elements = self.element(labels)
        for kind in np.unique(self.kind[elements]):
            if kind not in sides:
                warn(f"The surface {name!r} has sides of {kind} elements, which are not read.")
                continue
            if side not in sides[kind]:
                allowed = ", ".join(map(str, sides[kind]))
                raise MeshError(
                    f"the surface {name!r} has the unknown side {side!r} of {kind} cells; the "
                    f"sides are: {allowed}."
                )
            local = [int(vertex) - 1 for vertex in sides[kind][side]]
            own = self.nodes[elements[self.kind[elements] == kind]]
            self.facets[name].append(own[:, local])


def _numbers(entity: str, given: Any) -> Callable[[Any], Ints]:
    """Return a function of labels, an array of any shape, that returns their positions.

    Raises:
        MeshError: A label occurs twice, or (in the function) is not in the file.
    """
    labels = np.asarray(given, dtype=np.int64)
    order = np.argsort(labels, kind="stable")
    ordered = np.append(labels[order], np.iinfo(np.int64).max)
    if len(twice := ordered[1:][ordered[1:] == ordered[:-1]]):
        raise MeshError(f"{entity} {twice[0]} is defined twice.")

    def positions(given: Any) -> Ints:
        wanted = np.asarray(given, dtype=np.int64)
        place = np.searchsorted(ordered, wanted)
        if len(lost := wanted[ordered[place] != wanted]):
            raise MeshError(f"{entity} {lost[0]} is used, but the file does not define it.")
        return order[place]

    return positions


def named_mesh(file: FileMesh, joints: list[str] | None) -> tuple[RawMesh, list[str] | None]:
    """Return the mesh with its groups, and the names of the joints for `prepare`.

    Coincident faces of a joint are merged, because `prepare` splits them again.
    """
    dims = np.array([_DIMENSION.get(str(kind), 0) for kind in file.kind], dtype=np.int64)
    dim = dims.max(initial=0)
    if others := Counter(file.kind[(dims == 0) & (file.kind != "cohesive")].tolist()):
        counts = ", ".join(f"{count} {kind}" for kind, count in others.items())
        warn(f"Elements that are not read: {counts}.")
    is_layer, layers = _add_layers(file, dims == dim)
    is_cell = (dims == dim) & ~is_layer
    shape, cells, x = _cells(file, is_cell)
    number, corners = np.cumsum(is_cell) - 1, shape.facet_vertices.shape[1]
    groups: dict[str, Ints] = {}
    for name, members in file.element_sets.items():
        if len(own := np.unique(number[members[is_cell[members]]])):
            groups[name] = own
        if len(own := members[dims[members] == dim - 1]):
            file.facets.setdefault(name, []).append(file.nodes[own, :corners])
    listed = joints if isinstance(joints, list | tuple) else ()
    unread, used = _add_node_sets(file, cells, shape, groups, listed), np.unique(cells)
    for name, parts in file.facets.items():
        if any(part.shape[1] != corners or not np.isin(part, used).all() for part in parts):
            raise MeshError(f"the group {name!r} has facets that are not faces of the cells.")
    facets = {name: np.concatenate(parts) for name, parts in file.facets.items() if parts}
    unread |= {*file.facets, *file.element_sets} - {*facets, *groups, *layers}
    if unread:
        names = ", ".join(sorted(unread))
        warn(f"Sets without cells or facets of the body, which are not read: {names}.")
    x = x[:, : shape.dim]
    raw = RawMesh(shape=shape, cells=cells, x=x, cell_groups=groups, facet_groups=facets)
    named = joint_names(raw, joints)[0]
    if joints is None:
        named = list(dict.fromkeys([*named, *layers]))
    for name in layers:
        if name not in named and f"{name}-" in facets:
            raise MeshError(f"the elements of {name!r} have a thickness; list {name!r} in joints=.")
    raw = _merged(raw, [*layers, *named])
    check_curves(shape, raw.x, raw.cells, "The mesh")
    return raw, named if layers and joints is None else joints


def _cells(file: FileMesh, is_cell: Flags) -> tuple[CellShape, Ints, Floats]:
    """Return the shape and the nodes of the cells in the order of DOLFINx, and the coordinates.

    Quadrilaterals with 8 and hexahedra with 20 nodes get nodes in their faces and centres. The
    geometry stays the same: serendipity functions are a part of the quadratic Lagrange functions.
    """
    nodes, x = file.nodes[is_cell], file.x
    sizes = map(int, (nodes >= 0).sum(axis=1))
    counts = Counter(zip(map(str, file.kind[is_cell]), sizes, strict=True))
    (kind, size), *others = list(counts) or [("", 0)]
    if others or size not in _SIZES.get(kind, ()):
        present = ", ".join(f"{n} {kind} ({size} nodes)" for (kind, size), n in counts.items())
        allowed = "; ".join(f"{kind}: {', '.join(map(str, n))}" for kind, n in _SIZES.items())
        raise MeshError(
            f"the cells are: {present or 'none'}. Cells of one kind are needed, with one of these "
            f"numbers of nodes: {allowed}. Mesh the whole body with tetrahedra if it needs wedges."
        )
    nodes, dim = nodes[:, :size], _DIMENSION[kind]
    if x.shape[1] > dim and np.ptp(x[nodes, 2]) > 1e-9 * np.ptp(x[nodes], axis=(0, 1)).max():
        raise MeshError("the mesh is a surface, but not in a plane z = constant.")
    ordered = np.sort(nodes, axis=1)
    if len(collapsed := np.flatnonzero((ordered[:, 1:] == ordered[:, :-1]).any(axis=1))):
        raise MeshError(
            f"{len(collapsed)} cells have a node twice, the first around "
            f"{middle(x[nodes[collapsed[0]]])}; collapsed cells are not read."
        )
    in_face = np.repeat([-0.25, 0.5], 4)  # serendipity functions of corners and edges
    if (kind, size) == ("quadrilateral", 8):
        added = len(x) + np.arange(len(nodes))
        x, nodes = np.vstack([x, in_face @ x[nodes]]), np.column_stack([nodes, added])
    elif (kind, size) == ("hexahedron", 20):
        faces = nodes[:, _FACES].reshape(-1, 8)
        key = np.sort(faces[:, :4], axis=1)
        _, first, of = np.unique(key, axis=0, return_index=True, return_inverse=True)
        centres = np.repeat([-0.25, 0.25], [8, 12]) @ x[nodes]
        added = len(x) + np.column_stack([of.reshape(-1, 6), len(first) + np.arange(len(nodes))])
        x, nodes = np.vstack([x, in_face @ x[faces[first]], centres]), np.hstack([nodes, added])
    shape = CellShape(name=kind, degree=1 if size == _SIZES[kind][0] else 2)
    order = perm_vtk(getattr(dolfinx.mesh.CellType, kind), nodes.shape[1])
    return shape, nodes[:, order], x


def _add_layers(file: FileMesh, is_cell: Flags) -> tuple[Flags, list[str]]:
    """Add the two faces of cohesive elements, and of cells without thickness, to the facets.

    Returns:
        True for each of these elements, shape (elements,), and the names of their sets.
    """
    sizes, cohesive = (file.nodes >= 0).sum(axis=1), file.kind == "cohesive"
    layer, thick = np.zeros_like(sizes), np.zeros_like(cohesive)  # number of vertices; is it thick?
    for size, (kind, halves) in _LAYERS.items():
        own = np.flatnonzero(cohesive & (sizes == size) | is_cell & (file.kind == kind))
        a, b = (file.x[file.nodes[own][:, half]] for half in halves)
        limit = COINCIDENT * np.linalg.norm(a[:, 1] - a[:, 0], axis=1)
        thick[own] = np.linalg.norm(a - b, axis=2).max(axis=1) > limit
        layer[own[cohesive[own] | ~thick[own]]] = size
    names, unnamed = [], layer > 0
    for name, members in file.element_sets.items():
        if len(members) and layer[members].all():
            ends = ("-", "+") if thick[members].any() else ("", "")
            for size in np.unique(layer[members]):
                own = members[layer[members] == size]
                for end, half in zip(ends, _LAYERS[size][1], strict=True):
                    file.facets.setdefault(name + end, []).append(file.nodes[own][:, half])
            names.append(name)
            unnamed[members] = False
    if unnamed.any():
        raise MeshError(
            f"{unnamed.sum()} cohesive elements or cells without thickness are in no set of their "
            "own; put those of each joint into an element set."
        )
    return layer > 0, names


def _add_node_sets(
    file: FileMesh, cells: Ints, shape: CellShape, groups: Mapping[str, Ints], joints: Sequence[str]
) -> set[str]:
    """Add the facets with all vertices in a node set, unless an element set has its nodes.

    Returns:
        Names of node sets without facets, as points, and of sets of whole cells.
    """
    local = shape.facet_vertices
    corners = cells[:, : int(local.max()) + 1]
    faces, unread = corners[:, local].reshape(-1, local.shape[1]), set()
    for name, members in file.node_sets.items():
        in_set = np.zeros(max(cells.max(), members.max(initial=0)) + 1, dtype=bool)
        in_set[members] = True
        inside, whole = faces[in_set[faces].all(axis=1)], corners[in_set[corners].all(axis=1)]
        of_elements = [corners[groups[name]]] if name in groups else []
        if any(
            parts and all(in_set[nodes].all() for nodes in parts)
            for parts in (of_elements, file.facets.get(name))
        ):
            continue
        if name in file.facets:
            raise MeshError(f"{name!r} is a node set and a set of other facets; rename one.")
        if name in joints or name.lower().startswith("joint"):
            if not len(inside):
                raise MeshError(f"no facet has all its vertices in the node set {name!r}.")
            if len(whole):
                raise MeshError(
                    f"the node set {name!r} has all vertices of some cells, so that the facets of "
                    "this joint are not clear; define it by a surface or by elements."
                )
        if np.isin(inside, whole).all():
            unread.add(name)
        else:
            file.facets[name] = [np.unique(np.sort(inside, axis=1), axis=0)]
    return unread


def _merged(raw: RawMesh, joints: list[str]) -> RawMesh:
    """Merge nodes that coincide on joints, and drop nodes without cells."""
    shape, cells, x = raw.shape, raw.cells, raw.x
    new, local = np.arange(len(x)), shape.facet_vertices
    rows = [own for name, own in raw.facet_groups.items() if name in joints]
    owner, count = find_facets(shape, cells, np.vstack([local[:0], *rows]))
    if len(outer := owner[count == 1, 0]):
        nodes = cells[outer[:, :1], shape.facet_nodes[outer[:, 1]]]
        edge = np.linalg.norm(x[nodes[:, 0]] - x[nodes[:, 1]], axis=1).min()
        limit, used = COINCIDENT * edge, np.unique(cells)
        distance, _ = KDTree(x[np.unique(nodes)]).query(x[used], distance_upper_bound=limit)
        near = used[np.isfinite(distance)]
        _, first, of = np.unique(
            same_places(x[near], limit), return_index=True, return_inverse=True
        )
        new[near] = near[first[of]]
        cells = new[cells]
    used, inverse = np.unique(cells, return_inverse=True)
    facet_groups = {
        name: np.unique(np.sort(np.searchsorted(used, new[rows]), axis=1), axis=0)
        for name, rows in raw.facet_groups.items()
    }
    return replace(raw, cells=inverse.reshape(cells.shape), x=x[used], facet_groups=facet_groups)
