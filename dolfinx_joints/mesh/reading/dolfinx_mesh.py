# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Splitting of a user's distributed DOLFINx mesh; only cells at joints are sent to rank 0.

Cells and nodes keep their input numbers (from ``create_mesh``), which do not depend on partitions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import dolfinx.mesh
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.mpi import (
    blocks_of,
    dealt,
    equal_blocks,
    on_root,
    raised_together,
    rank_of,
    sent_to,
    set_rows,
)
from dolfinx_joints.common.parameters import check_kind_of, shown
from dolfinx_joints.mesh import dolfinx_versions
from dolfinx_joints.mesh.cells import CellShape, Floats, Ints, RawMesh, check_curves, facet_slots
from dolfinx_joints.mesh.distribution.shares import PreparedMesh
from dolfinx_joints.mesh.joint_pairs import JointPairs
from dolfinx_joints.mesh.preparation import check_names, members, prepare, tag_sets


def split_share(
    mesh: dolfinx.mesh.Mesh,
    facet_tags: dolfinx.mesh.MeshTags | None,
    groups: Mapping[str, Any],
    joints: list[str],
    cell_tags: dolfinx.mesh.MeshTags | None,
    cell_groups: Mapping[str, Any],
) -> PreparedMesh:
    """Split a mesh at facet groups, and return this rank's equal share (collective).

    A group is given by its tag or, without tags, by the local entities of each rank.
    """
    comm, tdim, shape = mesh.comm, mesh.topology.dim, _shape(mesh)
    facets = _group_entities(mesh, tdim - 1, groups, facet_tags)
    cells_of_groups = _group_entities(mesh, tdim, cell_groups, cell_tags)
    check_names(facets)
    with raised_together(comm):
        original = _order_of_creation(mesh)
    cell_map, node_map = mesh.topology.index_map(tdim), mesh.geometry.index_map()
    owned, nodes = slice(cell_map.size_local), slice(node_map.size_local)
    number = np.asarray(mesh.geometry.input_global_indices, dtype=np.int64)
    local, x = dolfinx_versions.geometry_nodes(mesh), mesh.geometry.x[:, :tdim]
    cells = number[local]
    num_nodes = comm.allreduce(number.max(initial=-1), max) + 1
    with raised_together(comm):
        check_curves(shape, x, local, "The mesh")

    rows = _facet_rows(mesh, shape, cells, original, facets)
    sides = {name + end for name in joints for end in ("", "-", "+")}  # + and -: already duplicated
    of_joints = {k: name for k, name in enumerate(facets) if name in sides}
    at_joints = np.concatenate(comm.allgather(rows[np.isin(rows[:, 2], list(of_joints))]))
    corners = cells[owned, : int(shape.facet_vertices.max()) + 1]
    near = np.flatnonzero(np.isin(corners, at_joints[:, 3:]).any(axis=1))
    around = np.unique(dolfinx_versions.geometry_nodes(mesh)[near])
    cell, node, split = _split_near(
        comm,
        shape,
        np.column_stack([original[near], cells[near]]),
        (number[around], x[around]),
        {name: at_joints[at_joints[:, 2] == k, 3:] for k, name in of_joints.items()},
        joints,
        num_nodes,
    )
    table = dealt(comm, cell_map.size_global, original[owned], cells[owned])
    set_rows(comm, table, cell, split.cells)
    new = node >= num_nodes
    total_nodes = num_nodes + comm.allreduce(np.count_nonzero(new))
    x_of_all = np.concatenate([number[nodes], node[new]]), np.concatenate([x[nodes], split.x[new]])
    glued = np.arange(*equal_blocks(total_nodes, comm.size)[comm.rank :][:2])
    set_rows(comm, glued, node, split.glued)
    facet_values = np.zeros((len(table), len(shape.facet_vertices)), dtype=np.int32)
    cell_values = np.zeros(len(table), dtype=np.int32)
    of_cells = {name: original[ids, None] for name, ids in cells_of_groups.items()}
    tagged, tags, cell_groups = _tag_entities(comm, len(table), of_cells)
    cell_values[tagged[:, 0]] = tags
    return PreparedMesh(
        shape=shape,
        cells=table,
        cell_values=cell_values,
        facet_values=facet_values,
        x=dealt(comm, total_nodes, *x_of_all),
        glued=glued,
        pairs=split.pairs,
        cell_groups=cell_groups,
        facet_groups=_facet_values(comm, facet_values, rows, list(facets), split.pairs),
    )


def _order_of_creation(mesh: dolfinx.mesh.Mesh) -> Ints:
    """Return the input number of each local cell.

    Raises:
        MeshError: The mesh does not store these numbers.
    """
    try:
        return np.asarray(mesh.topology.original_cell_index, dtype=np.int64)
    except RuntimeError:
        raise MeshError(
            "The mesh does not store the original order of its cells, as after create_submesh; "
            "make it with create_mesh, or write it to a file for read_xdmf."
        ) from None


def _split_near(
    comm: Any,
    shape: CellShape,
    cells: Ints,
    points: tuple[Ints, Floats],
    facet_groups: dict[str, Ints],
    joints: list[str],
    num_nodes: int,
) -> tuple[Ints, Ints, PreparedMesh]:
    """Split the cells that touch a joint, on rank 0 (collective).

    ``cells`` has the number and the nodes of each cell of this rank, ``points`` the numbers and
    coordinates of these nodes. Numbers of new nodes begin at ``num_nodes``.

    Returns:
        Cell numbers, node numbers, and the split mesh in these numbers; empty except on rank 0.
    """
    parts = comm.gather((cells, *points), root=0)
    whole: list[tuple[Ints, Ints, PreparedMesh]] = []

    def work() -> tuple[Ints, Ints, PreparedMesh]:
        table, numbers, x = (np.concatenate(values) for values in zip(*parts, strict=True))
        table = table[np.argsort(table[:, 0])]
        used, first = np.unique(numbers, return_index=True)
        raw = RawMesh(
            shape=shape,
            cells=np.searchsorted(used, table[:, 1:]),
            x=x[first],
            cell_groups={},
            facet_groups={
                name: np.unique(np.searchsorted(used, vertices), axis=0)
                for name, vertices in facet_groups.items()
            },
        )
        made, cell = prepare(raw, joints), table[:, 0]
        node = np.append(used, num_nodes + np.arange(len(made.x) - len(used)))
        pairs = made.pairs
        pairs = replace(
            pairs,
            minus=np.column_stack([cell[pairs.minus[:, 0]], pairs.minus[:, 1]]),
            plus=np.column_stack([cell[pairs.plus[:, 0]], pairs.plus[:, 1]]),
            minus_vertices=node[pairs.minus_vertices],
            plus_vertices=node[pairs.plus_vertices],
        )
        made = replace(made, cells=node[made.cells], glued=node[made.glued], pairs=pairs)
        whole.append((cell, node, made))
        return cell[:0], node[:0], made.without_rows()

    others = on_root(comm, work)
    return whole[0] if whole else others


def _facet_rows(
    mesh: dolfinx.mesh.Mesh,
    shape: CellShape,
    cells: Ints,
    original: Ints,
    facets: Mapping[str, NDArray[np.int32]],
) -> Ints:
    """Return the cell, local facet, group and vertices of each facet of a group (collective).

    Each facet of a group is returned on only one rank, with the first of its cells.
    """
    corners = shape.facet_vertices.shape[1]
    parts = [np.empty((0, 3 + corners), dtype=np.int64)]
    for k, entities in enumerate(facets.values()):
        cell, facet = facet_slots(mesh, entities)
        vertices = np.sort(cells[cell[:, None], shape.facet_vertices[facet]], axis=1)
        parts.append(np.column_stack([original[cell], facet, np.full(len(cell), k), vertices]))
    rows = np.concatenate(parts)
    rows = sent_to(mesh.comm, rows[:, 3] % mesh.comm.size, rows)
    rows = rows[np.lexsort((rows[:, 1], rows[:, 0]))]
    _, first, of = np.unique(rows[:, 3:], axis=0, return_index=True, return_inverse=True)
    rows[:, :2] = rows[first[of.ravel()], :2]
    return np.unique(rows, axis=0)


def _facet_values(
    comm: Any, values: NDArray[np.int32], rows: Ints, groups: list[str], pairs: JointPairs
) -> dict[str, tuple[int, ...]]:
    """Tag the facets of this rank's block of cells, and return each group's tags (collective).

    ``values`` receives the tags. `_facet_rows` returns ``rows``. The pairs are on rank 0.
    """
    slots = {name: rows[rows[:, 2] == k, :2] for k, name in enumerate(groups)}
    # `rows` have only one face of a joint facet; add the other face if another group has it, too.
    number = np.array([values.shape[1], 1])  # (cell, facet) @ number is a unique facet number
    one, across = np.vstack([pairs.minus, pairs.plus]), np.vstack([pairs.plus, pairs.minus])
    of_joint = np.isin(rows[:, 2], [k for k, name in enumerate(groups) if name in pairs.names])
    doubled = np.isin(rows[:, :2] @ number, rows[of_joint, :2] @ number) & ~of_joint
    shared = np.concatenate(comm.allgather(rows[doubled, :3]))
    for k, name in enumerate(groups):
        doubled_here = np.isin(one @ number, shared[shared[:, 2] == k, :2] @ number)
        slots[name] = np.vstack([slots[name], across[doubled_here]])
    for i, name in enumerate(pairs.names):
        slots.pop(name, None)
        for end, side in (("-", pairs.minus), ("+", pairs.plus)):
            none = np.empty((0, 2), dtype=np.int64)
            slots[name + end] = np.vstack([slots.get(name + end, none), side[pairs.joint == i]])
    entities, tags, of_groups = _tag_entities(comm, len(values), slots)
    values[entities[:, 0], entities[:, 1]] = tags
    return of_groups


def _tag_entities(
    comm: Any, num_cells: int, slots: dict[str, Ints]
) -> tuple[Ints, NDArray[np.int32], dict[str, tuple[int, ...]]]:
    """Tag the cells or facets of groups in this rank's block of cells (collective).

    Slots are cells, or cells and local facets, on any rank. Return the result of `tag_sets`, with
    cells counted from the first cell of the block.
    """
    rows, group, names = members(slots)
    blocks = blocks_of(comm, num_cells)
    rows = sent_to(comm, rank_of(blocks, rows[:, 0]), np.column_stack([rows, group]))
    rows[:, 0] -= blocks[comm.rank]
    return tag_sets(rows[:, :-1], rows[:, -1], names, lambda m: np.concatenate(comm.allgather(m)))


def _group_entities(
    mesh: dolfinx.mesh.Mesh, dim: int, groups: Mapping[str, Any], tags: dolfinx.mesh.MeshTags | None
) -> dict[str, NDArray[np.int32]]:
    """Return the local facets or cells of each group, from tags or as given (collective)."""
    comm, kind = mesh.comm, "cell" if dim == mesh.topology.dim else "facet"
    mesh.topology.create_entities(dim)
    index_map = mesh.topology.index_map(dim)
    count = index_map.size_local + index_map.num_ghosts
    with raised_together(comm):
        if tags is None:
            local = {name: _entities(kind, name, given, count) for name, given in groups.items()}
        else:
            _check_tags(tags, dim, f"{kind}_tags", count)
            local = {name: tags.indices[tags.values == tag] for name, tag in groups.items()}
    sizes = comm.allreduce(np.array([len(ids) for ids in local.values()]))
    for name in (name for name, size in zip(local, sizes, strict=True) if not size):
        if tags is None:
            raise MeshError(f"The {kind} group {name!r} is empty on all ranks.")
        tag_values = sorted(set().union(*comm.allgather(np.unique(tags.values).tolist())))
        available = shown(tag_values, lambda values: ", ".join(map(str, values))) or "none"
        raise MeshError(
            f"No {kind} has the tag {groups[name]} of the group {name!r}; the tags of {kind}s "
            f"are: {available}."
        )
    return local


def _entities(kind: str, name: str, given: Any, count: int) -> NDArray[np.int32]:
    whole = isinstance(given, np.ndarray) and given.ndim == 1 and given.dtype.kind in "iu"
    wanted = f"an array of local {kind}s, or a tag if {kind}_tags is given"
    if isinstance(given, np.ndarray) and given.dtype == bool:
        wanted = f"numbers of local {kind}s; use np.flatnonzero(...) of a mask"
    check_kind_of(f"The {kind} group {name!r}", given, whole, wanted)
    if given.min(initial=0) < 0 or given.max(initial=-1) >= count:
        raise MeshError(
            f"The {kind} group {name!r} has numbers from {given.min()} to {given.max()}; the "
            f"{kind}s of this rank are numbered from 0 to {count - 1}."
        )
    return np.asarray(given, dtype=np.int32)


def _check_tags(tags: dolfinx.mesh.MeshTags, dim: int, name: str, count: int) -> None:
    if tags.dim != dim:
        raise MeshError(f"{name} has tags of dimension {tags.dim}; dimension {dim} is needed.")
    if tags.indices.max(initial=-1) >= count:
        raise MeshError(f"{name} belongs to another mesh: its entities are not in this mesh.")


def _shape(mesh: dolfinx.mesh.Mesh) -> CellShape:
    name, degree = mesh.topology.cell_name(), dolfinx_versions.geometry_degree(mesh)
    if mesh.geometry.dim != mesh.topology.dim:
        raise MeshError(
            f"A mesh of dimension {mesh.topology.dim} in {mesh.geometry.dim}-D space cannot be "
            "split; use a solid mesh in 3-D or a plane mesh in 2-D."
        )
    cell_names = ("triangle", "quadrilateral", "tetrahedron", "hexahedron")
    if name not in cell_names or degree not in (1, 2):
        raise MeshError(
            f"A mesh of {name}s of degree {degree} cannot be split; cells must be one of "
            f"{', '.join(cell_names)}, of degree 1 or 2."
        )
    return CellShape(name=name, degree=degree)
