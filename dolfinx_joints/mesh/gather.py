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
from dolfinx_joints.common.parameters import check_kind_of
from dolfinx_joints.mesh import dolfinx_versions
from dolfinx_joints.mesh.cells import CellShape, Floats, Ints, RawMesh


def gather_mesh(
    mesh: dolfinx.mesh.Mesh,
    facet_tags: dolfinx.mesh.MeshTags,
    groups: Mapping[str, int],
    cell_tags: dolfinx.mesh.MeshTags | None,
    cell_groups: Mapping[str, int],
) -> RawMesh:
    """Gather cells, nodes and tagged entities (collective); the result is whole on rank 0 only."""
    comm, tdim = mesh.comm, mesh.topology.dim
    shape = _shape(mesh)
    _check_tags(mesh, facet_tags, tdim - 1, "facet_tags")
    if cell_tags is not None:
        _check_tags(mesh, cell_tags, tdim, "cell_tags")
    owned = mesh.topology.index_map(tdim).size_local
    with raised_together(comm):
        original = _order_of_cells(mesh)
    nodes = np.asarray(mesh.geometry.input_global_indices, dtype=np.int64)
    dofmap = dolfinx_versions.geometry_nodes(mesh)
    cells = _stack(comm, np.column_stack([original[:owned], nodes[dofmap[:owned]]]))
    x = mesh.geometry.x[:, : mesh.geometry.dim]
    points = _stack(comm, np.column_stack([nodes.astype(np.float64), x]))
    facets = _stack(comm, _tagged_facets(mesh, facet_tags, original))
    tagged = np.empty((0, 2), dtype=np.int64)
    if cell_tags is not None:
        tagged = np.column_stack([original[cell_tags.indices], cell_tags.values])
    values = _stack(comm, tagged)
    with raised_together(comm):
        for kind, rows, given in ("facet", facets, groups), ("cell", values, cell_groups):
            for name, tag in given.items():
                if tag not in rows[:, -1]:
                    raise MeshError(f"No {kind} carries the tag {tag} of the group {name!r}.")
    return _assemble(shape, cells, points, facets, values, groups, cell_groups)


def _check_tags(mesh: dolfinx.mesh.Mesh, tags: dolfinx.mesh.MeshTags, dim: int, name: str) -> None:
    """Check that tags are of these entities and of this mesh (collective)."""
    with raised_together(mesh.comm):
        check_kind_of(name, tags, isinstance(tags, MeshTags), "DOLFINx mesh tags")
        if tags.dim != dim:
            raise MeshError(f"{name} holds tags of dimension {tags.dim}; {dim} is needed.")
        mesh.topology.create_entities(dim)
        index_map = mesh.topology.index_map(dim)
        if tags.indices.max(initial=-1) >= index_map.size_local + index_map.num_ghosts:
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
            "does not; make it with create_mesh, or write it to a file and read that."
        ) from None


def _stack(comm: Any, rows: NDArray[Any]) -> NDArray[Any]:
    """All ranks' rows on every rank, so that checks agree; small next to the matrices."""
    return np.vstack(comm.allgather(rows))


def _tagged_facets(mesh: dolfinx.mesh.Mesh, tags: dolfinx.mesh.MeshTags, original: Ints) -> Ints:
    """Input cell, local facet and tag of each tagged facet, shape (n, 3)."""
    tdim = mesh.topology.dim
    mesh.topology.create_connectivity(tdim - 1, tdim)
    mesh.topology.create_connectivity(tdim, tdim - 1)
    to_cell = mesh.topology.connectivity(tdim - 1, tdim)
    to_facet = mesh.topology.connectivity(tdim, tdim - 1)
    cell = to_cell.array[to_cell.offsets[tags.indices]]
    facets = cell_num_entities(mesh.topology.cell_type, tdim - 1)
    per_cell = to_facet.array.reshape(-1, facets)  # a rank may have no cells
    local = np.argmax(per_cell[cell] == tags.indices[:, None], axis=1)
    return np.column_stack([original[cell], local, tags.values]).astype(np.int64)


def _assemble(
    shape: CellShape,
    cells: Ints,
    points: Floats,
    facets: Ints,
    values: Ints,
    groups: Mapping[str, int],
    cell_groups: Mapping[str, int],
) -> RawMesh:
    """Sort by input numbers and drop what several ranks reported."""
    _, first = np.unique(cells[:, 0], return_index=True)
    cells = cells[first]
    numbers, first = np.unique(points[:, 0].astype(np.int64), return_index=True)
    x = points[first, 1:]
    nodes = np.searchsorted(numbers, cells[:, 1:])
    position = np.searchsorted(cells[:, 0], facets[:, 0])
    vertices = nodes[position[:, None], shape.facet_vertices[facets[:, 1]]]
    by_tag = {
        name: np.unique(np.sort(vertices[facets[:, 2] == tag], axis=1), axis=0)
        for name, tag in groups.items()
    }
    cell_sets = {
        name: np.searchsorted(cells[:, 0], np.unique(values[values[:, 1] == tag, 0]))
        for name, tag in cell_groups.items()
    }
    return RawMesh(shape=shape, cells=nodes, x=x, cell_groups=cell_sets, facet_groups=by_tag)
