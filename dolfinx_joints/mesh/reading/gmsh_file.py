# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gmsh ``.msh`` files as plain arrays (one process; Gmsh is imported where it is used)."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.common.errors import MeshError, warn
from dolfinx_joints.common.parameters import check_file
from dolfinx_joints.mesh.cells import CellShape, RawMesh, check_curves, find_facets
from dolfinx_joints.mesh.dolfinx_versions import gmsh_permutation
from dolfinx_joints.mesh.reading.gmsh_syntax import check_msh

# Gmsh element type: cell name, degree (only types whose complete Lagrange basis DOLFINx has).
_CELLS = {
    2: ("triangle", 1),
    9: ("triangle", 2),
    3: ("quadrilateral", 1),
    10: ("quadrilateral", 2),
    4: ("tetrahedron", 1),
    11: ("tetrahedron", 2),
    5: ("hexahedron", 1),
    12: ("hexahedron", 2),
}
_FACET_VERTICES = {1: 2, 8: 2, 2: 3, 9: 3, 3: 4, 10: 4}

Names = dict[tuple[int, int], str]


def load_msh(path: Path) -> RawMesh:
    """Read a ``.msh`` file with named physical groups."""
    try:
        import gmsh
    except OSError as error:  # that of PyPI needs libraries of a desktop
        raise MeshError(
            f"Gmsh cannot be loaded: {error}; install that library, or your system's Gmsh."
        ) from None

    check_file(path, f"Mesh file {str(path)!r} does not exist.", MeshError)
    names = check_msh(path)
    started = not gmsh.isInitialized()
    if started:
        gmsh.initialize(interruptible=False)
    terminal, current = gmsh.option.getNumber("General.Terminal"), gmsh.model.getCurrent()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add(f"dolfinx_joints reads {path}")
        try:
            gmsh.merge(str(path))
        except Exception as exc:
            raise MeshError(f"Gmsh cannot read {str(path)!r}: {exc}.") from None
        return _read_model(gmsh.model, str(path), names)
    finally:
        if started:
            gmsh.clear()  # a reading that failed leaves Gmsh locked, beyond the end of the session
            gmsh.finalize()
        else:
            if gmsh.model.getCurrent() != current:
                gmsh.model.remove()
            gmsh.model.setCurrent(current)
            gmsh.option.setNumber("General.Terminal", terminal)


def _read_model(model: Any, source: str, names: Names) -> RawMesh:
    model.mesh.renumberNodes()
    dim = model.getDimension()
    if parts := model.getNumberOfPartitions():
        raise MeshError(
            f"{source!r} is partitioned into {parts} parts; write it whole (gmsh.model.mesh."
            "unpartition, or without -part). The mesh is distributed when it is read."
        )
    groups = {d: _groups(model, d, names) for d in (dim, dim - 1)} if dim in (2, 3) else {}
    if not groups or not groups[dim]:
        raise MeshError(
            f"{source!r} has no named physical group of cells; name the volumes (surfaces in 2-D). "
            "If they are named, the file was written with Mesh.SaveAll, which drops the groups in "
            "format 2.2: set Mesh.SaveAll to 0, or write format 4.1."
        )
    kinds, blocks, cell_groups, start = set(), [], {}, 0
    numbered: dict[int, Ints] = {}
    for name, entities in groups[dim].items():
        members = []
        for entity in entities:
            if entity not in numbered:
                kind, nodes = _cells(model, dim, entity, source)
                kinds.add(kind)
                blocks.append(nodes)
                numbered[entity] = np.arange(start, start + len(nodes))
                start += len(nodes)
            members.append(numbered[entity])
        cell_groups[name] = np.concatenate(members)
    shape = cell_shape(kinds, source)
    _warn_of_others(model, dim, numbered, source)
    tags, coordinates, _ = model.mesh.getNodes()
    nodes = np.vstack(blocks).astype(np.int64)
    place = np.full(int(tags.max()) + 1, -1)  # of each node; their numbers have no gaps
    place[nodes] = 0
    used = np.flatnonzero(place == 0)
    place[used] = np.arange(len(used))
    nodes, in_cells = place[nodes], place[tags] >= 0
    x: Floats = np.empty((len(used), 3))
    x[place[tags[in_cells]]] = coordinates.reshape(-1, 3)[in_cells]
    facets = {
        name: _facets(model, dim, entities, name, used)
        for name, entities in groups[dim - 1].items()
    }
    if dim == 2 and np.ptp(x[:, 2]) > 1e-9 * np.ptp(x, axis=0).max():
        raise MeshError(f"{source!r} is a surface that does not lie in a plane z = constant.")
    cells = nodes[:, gmsh_permutation(shape.name, nodes.shape[1])]
    for d, tag in model.getPhysicalGroups(dim - 1):
        if not names.get((d, tag)):
            _warn_of_unnamed(model, dim, tag, (shape, cells, used), source)
    x = x[:, :dim].copy()
    check_curves(shape, x, cells, repr(source))
    return RawMesh(shape=shape, cells=cells, x=x, cell_groups=cell_groups, facet_groups=facets)


def _groups(model: Any, dim: int, names: Names) -> dict[str, list[int]]:
    """Entities of each name among the physical groups of one dimension."""
    found: dict[str, list[int]] = {}
    for d, tag in model.getPhysicalGroups(dim):
        if name := names.get((d, tag)):
            found.setdefault(name, []).extend(map(int, model.getEntitiesForPhysicalGroup(d, tag)))
    return {name: list(dict.fromkeys(entities)) for name, entities in found.items()}


def _warn_of_others(model: Any, dim: int, named: Collection[int], source: str) -> None:
    """Warn of cells that no named group holds: a part of the body may have been forgotten."""
    others = [entity for _, entity in model.getEntities(dim) if entity not in named]
    count = sum(len(tags) for e in others for tags in model.mesh.getElements(dim, e)[1])
    if count:
        warn(
            f"{source!r}: {count} cells in no named physical group are left out; name their "
            f"{'volumes' if dim == 3 else 'surfaces'} if they are part of the body."
        )


def _warn_of_unnamed(model: Any, dim: int, tag: int, body: Any, source: str) -> None:
    """Warn of facets of the body in a group without a name: a joint may have been forgotten."""
    entities, (shape, cells, used) = model.getEntitiesForPhysicalGroup(dim - 1, tag), body
    try:
        count = find_facets(shape, cells, _facets(model, dim, entities, str(tag), used))[1]
    except MeshError:  # facets of a part of the model that is left out
        return
    warn(
        f"{source!r}: {np.count_nonzero(count)} facets in the physical group {tag} without a name "
        f"are left out, {np.count_nonzero(count == 2)} of them inside the body; name the group if "
        "they are a joint or a boundary. Of several groups of one name Gmsh writes the name of one "
        "only: put all into one group."
    )


def _cells(model: Any, dim: int, entity: int, source: str) -> tuple[int, Ints]:
    """Type and nodes of the cells of one entity."""
    found = list(_elements(model, dim, entity))
    if not found:
        without = f"entity {entity} of dimension {dim} holds no cells"
        raise MeshError(f"{source!r}: {without}; mesh it by gmsh.model.mesh.generate({dim}).")
    if len(found) != 1:
        raise MeshError(
            f"{source!r}: entity {entity} holds {len(found)} kinds of cells; one kind is needed."
        )
    return found[0]


def _elements(model: Any, dim: int, entity: int) -> Iterator[tuple[int, Ints]]:
    """Types of the elements of an entity, and their nodes, each element once.

    Format 2.2 has a copy of an element for each of its physical groups.
    """
    types, _, nodes = model.mesh.getElements(dim, entity)
    copied = len(model.getPhysicalGroupsForEntity(dim, entity)) > 1
    for kind, flat in zip(types, nodes, strict=True):
        rows = flat.reshape(-1, model.mesh.getElementProperties(kind)[3])
        if copied:
            _, first = np.unique(np.sort(rows, axis=1), axis=0, return_index=True)
            rows = rows[np.sort(first)]
        yield int(kind), rows


def cell_shape(kinds: set[int], source: str) -> CellShape:
    """Return the shape of cells of some Gmsh types; raise MeshError unless the types are one."""
    if len(kinds) != 1 or not kinds <= set(_CELLS):
        raise MeshError(
            f"{source!r} has cells of Gmsh types {sorted(kinds)}; one of tetrahedra (4 or 10 "
            "nodes), hexahedra (8 or 27), triangles (3 or 6) or quadrilaterals (4 or 9) is needed."
        )
    name, degree = _CELLS[kinds.pop()]
    return CellShape(name=name, degree=degree)


def _facets(model: Any, dim: int, entities: list[int], name: str, used: Ints) -> Ints:
    """Vertices of the facets of one physical group, numbered as the cells' nodes are."""
    rows = [
        facets[:, : _FACET_VERTICES[kind]].astype(np.int64)
        for entity in entities
        for kind, facets in _elements(model, dim - 1, entity)
    ]
    if not rows:
        raise MeshError(f"Group {name!r} holds no facets; mesh it before writing the file.")
    vertices = np.vstack(rows)
    position = np.searchsorted(used, vertices)
    if np.any(used[np.minimum(position, len(used) - 1)] != vertices):
        raise MeshError(f"Group {name!r} has facets with nodes that belong to no cell.")
    return position.astype(np.int64)
