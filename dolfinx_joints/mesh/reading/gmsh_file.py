# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reader of Gmsh ``.msh`` files into arrays, on one process; a call imports Gmsh."""

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

# Cell name and degree by Gmsh element type, for types that are Lagrange cells of DOLFINx.
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
    except OSError as error:  # Gmsh from PyPI needs desktop libraries
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
            gmsh.clear()  # after a failed read Gmsh stays locked, even in a new session
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
            "unpartition, or without -part). Reading distributes the mesh to the ranks."
        )
    groups = {d: _groups(model, d, names) for d in (dim, dim - 1)} if dim in (2, 3) else {}
    if not groups or not groups[dim]:
        raise MeshError(
            f"{source!r} has no named physical group of cells; name the volumes (surfaces in 2-D). "
            "If they have names, Mesh.SaveAll has dropped the groups in format 2.2: set "
            "Mesh.SaveAll to 0, or write format 4.1."
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
    _warn_of_unnamed_cells(model, dim, numbered, source)
    tags, coordinates, _ = model.mesh.getNodes()
    nodes = np.vstack(blocks).astype(np.int64)
    place = np.full(int(tags.max()) + 1, -1)  # position by node tag; tags have no gaps
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
        raise MeshError(f"{source!r} is a surface mesh but not in a plane z = constant.")
    cells = nodes[:, gmsh_permutation(shape.name, nodes.shape[1])]
    for d, tag in model.getPhysicalGroups(dim - 1):
        if not names.get((d, tag)):
            _warn_of_unnamed_facets(model, dim, tag, (shape, cells, used), source)
    x = x[:, :dim].copy()
    check_curves(shape, x, cells, repr(source))
    return RawMesh(shape=shape, cells=cells, x=x, cell_groups=cell_groups, facet_groups=facets)


def _groups(model: Any, dim: int, names: Names) -> dict[str, list[int]]:
    """Return the entities of each named physical group of one dimension."""
    groups: dict[str, list[int]] = {}
    for d, tag in model.getPhysicalGroups(dim):
        if name := names.get((d, tag)):
            groups.setdefault(name, []).extend(map(int, model.getEntitiesForPhysicalGroup(d, tag)))
    return {name: list(dict.fromkeys(entities)) for name, entities in groups.items()}


def _warn_of_unnamed_cells(model: Any, dim: int, named: Collection[int], source: str) -> None:
    """Warn of cells without a named group, which may be a forgotten part of the body."""
    others = [entity for _, entity in model.getEntities(dim) if entity not in named]
    count = sum(len(tags) for e in others for tags in model.mesh.getElements(dim, e)[1])
    if count:
        warn(
            f"{source!r}: {count} cells are in no named physical group and are not read; name "
            f"their {'volumes' if dim == 3 else 'surfaces'} if they are part of the body."
        )


def _warn_of_unnamed_facets(model: Any, dim: int, tag: int, body: Any, source: str) -> None:
    """Warn of facets of the body in an unnamed group, which may be a forgotten joint."""
    entities, (shape, cells, used) = model.getEntitiesForPhysicalGroup(dim - 1, tag), body
    try:
        count = find_facets(shape, cells, _facets(model, dim, entities, str(tag), used))[1]
    except MeshError:  # facets of a part of the model that is not read
        return
    warn(
        f"{source!r}: {np.count_nonzero(count)} facets in the unnamed physical group {tag} are "
        f"not read, {np.count_nonzero(count == 2)} of them inside the body; name the group if they "
        "are a joint or a boundary. If several groups have the same name, Gmsh writes the name for "
        "only one of them: put all entities into one group."
    )


def _cells(model: Any, dim: int, entity: int, source: str) -> tuple[int, Ints]:
    """Return the type and the nodes of the cells of one entity."""
    by_type = list(_elements(model, dim, entity))
    if not by_type:
        without = f"entity {entity} of dimension {dim} has no cells"
        raise MeshError(f"{source!r}: {without}; mesh it by gmsh.model.mesh.generate({dim}).")
    if len(by_type) != 1:
        raise MeshError(
            f"{source!r}: entity {entity} has {len(by_type)} kinds of cells; one kind is needed."
        )
    return by_type[0]


def _elements(model: Any, dim: int, entity: int) -> Iterator[tuple[int, Ints]]:
    """Yield the element types of an entity, and the nodes of the distinct elements.

    In format 2.2 an element has one copy for each of its physical groups.
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
    """Return the cell shape of a Gmsh type; raise MeshError unless there is exactly one."""
    if len(kinds) != 1 or not kinds <= set(_CELLS):
        raise MeshError(
            f"{source!r} has cells of Gmsh types {sorted(kinds)}; use one type only: tetrahedra (4 "
            "or 10 nodes), hexahedra (8 or 27), triangles (3 or 6) or quadrilaterals (4 or 9)."
        )
    name, degree = _CELLS[kinds.pop()]
    return CellShape(name=name, degree=degree)


def _facets(model: Any, dim: int, entities: list[int], name: str, used: Ints) -> Ints:
    """Return the vertices of the facets of one physical group, numbered like the cells."""
    rows = [
        facets[:, : _FACET_VERTICES[kind]].astype(np.int64)
        for entity in entities
        for kind, facets in _elements(model, dim - 1, entity)
    ]
    if not rows:
        raise MeshError(f"Group {name!r} has no facets; mesh it before writing the file.")
    vertices = np.vstack(rows)
    position = np.searchsorted(used, vertices)
    if np.any(used[np.minimum(position, len(used) - 1)] != vertices):
        raise MeshError(f"Group {name!r} has facets with nodes that belong to no cell.")
    return position.astype(np.int64)
