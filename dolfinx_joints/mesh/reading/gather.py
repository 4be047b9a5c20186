# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Collect a distributed DOLFINx mesh on rank 0, in an order that no partition changes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import dolfinx.mesh
import numpy as np
from dolfinx.cpp.mesh import cell_num_entities
from dolfinx.mesh import MeshTags
from numpy.typing import NDArray

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.mpi import raised_together
from dolfinx_joints.common.parameters import check_kind_of, shown
from dolfinx_joints.mesh import dolfinx_versions
from dolfinx_joints.mesh.cells import CellShape, Floats, Ints, RawMesh


def gather_mesh(
    mesh: dolfinx.mesh.Mesh,
    facet_tags: dolfinx.mesh.MeshTags | None,
    groups: Mapping[str, Any],
    cell_tags: dolfinx.mesh.MeshTags | None,
    cell_groups: Mapping[str, Any],
) -> RawMesh:
    """Gather cells, nodes and groups (collective); the result is whole on rank 0 only.

    A group is a tag or, without tags, the local entities of each rank.
    """
    comm, tdim = mesh.comm, mesh.topology.dim
    shape = _shape(mesh)
    facets = _group_entities(mesh, tdim - 1, groups, facet_tags)
    cells = _group_entities(mesh, tdim, cell_groups, cell_tags)
    owned = mesh.topology.index_map(tdim).size_local
    with raised_together(comm):
        original = _order_of_cells(mesh)
    nodes = np.asarray(mesh.geometry.input_global_indices, dtype=np.int64)
    dofmap = dolfinx_versions.geometry_nodes(mesh)
    table = _stack(comm, np.column_stack([original[:owned], nodes[dofmap[:owned]]]))
    x = mesh.geometry.x[:, : mesh.geometry.dim]
    points = _stack(comm, np.column_stack([nodes.astype(np.float64), x]))
    slots = {name: _stack(comm, _slots(mesh, each, original)) for name, each in facets.items()}
    members = {name: _stack(comm, original[each][:, None]) for name, each in cells.items()}
    return _assemble(shape, table, points, slots, members)


def _group_entities(
    mesh: dolfinx.mesh.Mesh,
    dim: int,
    groups: Mapping[str, Any],
    tags: dolfinx.mesh.MeshTags | None,
) -> dict[str, NDArray[np.int32]]:
    """Local facets or cells of each group, by its tag or as given (collective)."""
    comm, kind = mesh.comm, "cell" if dim == mesh.topology.dim else "facet"
    mesh.topology.create_entities(dim)
    index_map = mesh.topology.index_map(dim)
    count = index_map.size_local + index_map.num_ghosts
    with raised_together(comm):
        if tags is None:
            found = {name: _entities(kind, name, each, count) for name, each in groups.items()}
        else:
            _check_tags(tags, dim, f"{kind}_tags", count)
            found = {name: tags.indices[tags.values == tag] for name, tag in groups.items()}
    sizes = comm.allreduce(np.array([len(each) for each in found.values()]))
    for name in (name for name, size in zip(found, sizes, strict=True) if not size):
        if tags is None:
            raise MeshError(f"The {kind} group {name!r} is empty on all ranks.")
        known = sorted(set().union(*comm.allgather(np.unique(tags.values).tolist())))
        there = shown(known, lambda values: ", ".join(map(str, values))) or "none"
        raise MeshError(
            f"No {kind} carries the tag {groups[name]} of the group {name!r}; the tags of {kind}s "
            f"are: {there}."
        )
    return found


def _entities(kind: str, name: str, given: Any, count: int) -> NDArray[np.int32]:
    """Check what is given as local facets or cells."""
    whole = isinstance(given, np.ndarray) and given.ndim == 1 and given.dtype.kind in "iu"
    wanted = f"an array of local {kind}s, or {kind}_tags be given and this a tag"
    check_kind_of(f"The {kind} group {name!r}", given, whole, wanted)
    if given.min(initial=0) < 0 or given.max(initial=-1) >= count:
        raise MeshError(
            f"The {kind} group {name!r} holds numbers from {given.min()} to {given.max()}; the "
            f"{kind}s of this rank are numbered from 0 to {count - 1}."
        )
    return np.asarray(given, dtype=np.int32)


def _check_tags(tags: Any, dim: int, name: str, count: int) -> None:
    """Check that tags are of these entities and of this mesh."""
    check_kind_of(name, tags, isinstance(tags, MeshTags), "DOLFINx mesh tags")
    if tags.dim != dim:
        raise MeshError(f"{name} holds tags of dimension {tags.dim}; {dim} is needed.")
    if tags.indices.max(initial=-1) >= count:
        raise MeshError(f"{name} belongs to another mesh: it names entities that are not here.")


def _shape(mesh: dolfinx.mesh.Mesh) -> CellShape:
    name, degree = mesh.topology.cell_name(), dolfinx_versions.geometry_degree(mesh)
    if mesh.geometry.dim != mesh.topology.dim:
        raise MeshError(
            f"A mesh of dimension {mesh.topology.dim} in {mesh.geometry.dim}-D space cannot be "
            "split; solids, or plane meshes in 2-D, can."
        )
    known = ("triangle", "quadrilateral", "tetrahedron", "hexahedron")
    if name not in known or degree not in (1, 2):
        raise MeshError(
            f"A mesh of {name}s of degree {degree} cannot be split; {', '.join(known)} of degree "
            "1 or 2 can."
        )
    return CellShape(name=name, degree=degree)


def _order_of_cells(mesh: dolfinx.mesh.Mesh) -> Ints:
    """Numbers that the cells of a rank had when the mesh was made."""
    try:
        return np.asarray(mesh.topology.original_cell_index, dtype=np.int64)
    except RuntimeError:
        raise MeshError(
            "The mesh does not know in which order its cells were made, as one from create_submesh "
            "does not; make it with create_mesh, or write it to a file for read_xdmf."
        ) from None


def _stack(comm: Any, rows: NDArray[Any]) -> NDArray[Any]:
    """All ranks' rows on every rank, so that checks agree; small next to the matrices."""
    return np.vstack(comm.allgather(rows))


def _slots(mesh: dolfinx.mesh.Mesh, entities: NDArray[np.int32], original: Ints) -> Ints:
    """Input cell and local facet of local facets, shape (n, 2)."""
    tdim = mesh.topology.dim
    mesh.topology.create_connectivity(tdim - 1, tdim)
    mesh.topology.create_connectivity(tdim, tdim - 1)
    to_cell = mesh.topology.connectivity(tdim - 1, tdim)
    to_facet = mesh.topology.connectivity(tdim, tdim - 1)
    cell = to_cell.array[to_cell.offsets[entities]]
    facets = cell_num_entities(mesh.topology.cell_type, tdim - 1)
    per_cell = to_facet.array.reshape(-1, facets)  # a rank may have no cells
    local = np.argmax(per_cell[cell] == entities[:, None], axis=1)
    return np.column_stack([original[cell], local]).astype(np.int64)


def _assemble(
    shape: CellShape,
    cells: Ints,
    points: Floats,
    slots: Mapping[str, Ints],
    members: Mapping[str, Ints],
) -> RawMesh:
    """Sort by input numbers and drop what several ranks reported."""
    _, first = np.unique(cells[:, 0], return_index=True)
    cells = cells[first]
    numbers, first = np.unique(points[:, 0].astype(np.int64), return_index=True)
    x = points[first, 1:]
    nodes = np.searchsorted(numbers, cells[:, 1:])

    def vertices(cell: Ints, facet: Ints) -> Ints:
        position = np.searchsorted(cells[:, 0], cell)
        found = nodes[position[:, None], shape.facet_vertices[facet]]
        return np.unique(np.sort(found, axis=1), axis=0)

    return RawMesh(
        shape=shape,
        cells=nodes,
        x=x,
        cell_groups={
            name: np.searchsorted(cells[:, 0], np.unique(each)) for name, each in members.items()
        },
        facet_groups={name: vertices(*each.T) for name, each in slots.items()},
    )
