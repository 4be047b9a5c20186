# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Split meshes as arrays, one block of rows per rank, and DOLFINx meshes made from the arrays."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import basix.ufl
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.mpi import (
    blocks_of,
    dealt,
    equal_blocks,
    on_root,
    rank_of,
    rows_at,
    sent_to,
)
from dolfinx_joints.common.parameters import check_kind_of, offers
from dolfinx_joints.mesh import dolfinx_versions
from dolfinx_joints.mesh.blocks import connected
from dolfinx_joints.mesh.cells import CellShape, Floats, Ints
from dolfinx_joints.mesh.distribution.killed_compilations import remove_killed_compilations
from dolfinx_joints.mesh.distribution.mesh_checks import check_cells, warn_of_touching_facets
from dolfinx_joints.mesh.joint_pairs import JointPairs
from dolfinx_joints.mesh.jointed_mesh import JointedMesh, mesh_tags


def glued(pairs: JointPairs, start: int, stop: int) -> Ints:
    """Return the node numbers of nodes ``start`` to ``stop`` after gluing the joints."""
    sides = np.stack([pairs.minus_vertices, pairs.plus_vertices])
    nodes, place = np.unique(sides, return_inverse=True)
    one, other = place.reshape(2, -1)
    _, first, label = np.unique(
        connected(one, other, len(nodes)), return_index=True, return_inverse=True
    )
    number, in_range = np.arange(start, stop), (nodes >= start) & (nodes < stop)
    number[nodes[in_range] - start] = nodes[first[label[in_range]]]
    return number


def partitioner_across(pairs: JointPairs, number: Ints) -> Callable[..., Any]:
    """Return a partitioner for `dolfinx.mesh.create_mesh`; `glued` returns ``number``.

    The mesh is divided as if the joints were glued. Both cells of a facet pair are on the rank that
    owns the - cell, so integrals over joints need no communication.
    """
    by_facets = dolfinx_versions.cell_partitioner()

    def partition(comm: Any, parts: int, cell_types: Any, cells: list[Any]) -> Any:
        glued_cells = [np.ascontiguousarray(rows_at(comm, number, vertices)) for vertices in cells]
        owner = by_facets(comm, parts, cell_types, glued_cells).array
        minus, plus = (rows_at(comm, owner, side[:, 0]) for side in (pairs.minus, pairs.plus))
        blocks = blocks_of(comm, len(owner))
        across = np.column_stack([pairs.plus[:, 0], minus])[minus != plus]
        ghosts = np.unique(sent_to(comm, rank_of(blocks, across[:, 0]), across), axis=0)
        ghosted = np.concatenate([np.arange(len(owner)), ghosts[:, 0] - blocks[comm.rank]])
        ranks = np.concatenate([owner, ghosts[:, 1]])
        order = np.argsort(ghosted, kind="stable")  # the owner comes first
        ends = np.cumsum(np.bincount(ghosted, minlength=len(owner)))
        return dolfinx_versions.adjacency_list(ranks[order], np.concatenate([[0], ends]))

    return partition


# Meshes kept alive on one rank. If a call that creates a mesh fails, the mesh would be freed while
# the exception propagates; mpi4py would then raise a SystemError that replaces the message.
_alive: list[tuple[weakref.ref[JointedMesh], Any]] = []


@dataclass(frozen=True, kw_only=True)
class PreparedMesh:
    """Blocks of rows of a split mesh on this rank; cells and nodes have global numbers.

    Attributes:
        shape: Reference cell and degree of the geometry.
        cells: Nodes of the cells, shape (cells, nodes of a cell).
        cell_values: Tags of the cells, 0 for none, shape (cells,).
        facet_values: Tags of the cells' facets, 0 for none, shape (cells, facets of a cell). A
            facet of two cells may be tagged in only one cell.
        x: Node coordinates, shape (nodes, gdim), [m].
        glued: Node numbers with joints glued together, from `glued`.
        pairs: This rank's block of the facet pairs.
        cell_groups: Tags that make up each named cell group.
        facet_groups: Tags that make up each named facet group and each side of a joint.
    """

    shape: CellShape
    cells: Ints
    cell_values: NDArray[np.int32]
    facet_values: NDArray[np.int32]
    x: Floats
    glued: Ints
    pairs: JointPairs
    cell_groups: dict[str, tuple[int, ...]]
    facet_groups: dict[str, tuple[int, ...]]

    def rows(self) -> dict[str, Any]:
        """Return the arrays that have one row per cell or node, by name."""
        return {name: getattr(self, name) for name in MESH_ROWS}

    def without_rows(self) -> PreparedMesh:
        """Return a copy without rows, with the data that are equal on all ranks."""
        nothing = {name: rows[:0] for name, rows in self.rows().items()}
        return replace(self, pairs=self.pairs.block(0, 0), **nothing)


MESH_ROWS = ("cells", "cell_values", "facet_values", "x", "glued")


def distribute(comm: Any, prepare: Callable[[], PreparedMesh]) -> JointedMesh:
    """Create the DOLFINx mesh from a mesh that rank 0 prepares (collective)."""
    check_comm(comm)
    whole: list[PreparedMesh] = []

    def work() -> PreparedMesh:
        whole.append(prepare())
        return whole[0].without_rows()

    common = on_root(comm, work)
    return create_jointed(comm, whole[0] if whole else common)


def check_comm(comm: Any) -> None:
    """Check that ``comm`` is an MPI communicator."""
    check_kind_of("comm", comm, offers(comm, "bcast"), "an MPI communicator such as MPI.COMM_WORLD")


def create_jointed(comm: Any, share: PreparedMesh) -> JointedMesh:
    """Create the DOLFINx mesh and its tags from the shares of all ranks (collective)."""
    remove_killed_compilations(comm)
    shape = share.shape
    x = rows_at(comm, share.x, share.cells.ravel())
    x = x.reshape(*share.cells.shape, share.x.shape[1])
    check_cells(comm, shape, share.cells, x)
    element = basix.ufl.element("Lagrange", shape.name, shape.degree, shape=(share.x.shape[1],))
    partitioner = partitioner_across(share.pairs, share.glued) if comm.size > 1 else None
    mesh = dolfinx_versions.create_mesh(comm, share.cells, share.x, element, partitioner)
    mesh.name = "jointed_mesh"
    original = np.asarray(mesh.topology.original_cell_index, dtype=np.int64)
    values = rows_at(comm, np.column_stack([share.cell_values, share.facet_values]), original)
    owned = original[: mesh.topology.index_map(shape.dim).size_local]
    count = mesh.topology.index_map(shape.dim).size_global
    owner = dealt(comm, count, owned, np.full(len(owned), comm.rank))
    facet_of_cell = facets_of_cells(mesh, shape)
    cell, facet = np.nonzero(values[:, 1:])
    facets, first = np.unique(facet_of_cell[cell, facet], return_index=True)
    jointed = JointedMesh(
        mesh=mesh,
        shape=shape,
        cell_tags=mesh_tags(mesh, shape.dim, np.arange(len(original)), values[:, 0]),
        cell_groups=share.cell_groups,
        pairs=share.pairs.sent_to(comm, rows_at(comm, owner, share.pairs.minus[:, 0])),
        _facet_tags=mesh_tags(mesh, shape.dim - 1, facets, values[cell, 1 + facet][first]),
        _facet_groups=share.facet_groups,
    )
    warn_of_touching_facets(jointed)
    if comm.size == 1:
        _keep_alive(jointed)
    return jointed


def _keep_alive(jointed: JointedMesh) -> None:
    """Keep the mesh alive until the next mesh is created, and release unused meshes."""
    _alive[:] = [(reference, mesh) for reference, mesh in _alive if reference() is not None]
    _alive.append((weakref.ref(jointed), jointed.mesh))


def facets_of_cells(mesh: Any, shape: CellShape) -> NDArray[np.int32]:
    """Return the local facets of each local cell, shape (cells, facets of a cell)."""
    topology, dim = mesh.topology, shape.dim
    topology.create_entities(dim - 1)
    topology.create_connectivity(dim, dim - 1)
    topology.create_connectivity(dim - 1, dim)
    facets = topology.connectivity(dim, dim - 1).array
    return np.asarray(facets).reshape(-1, len(shape.facet_vertices))


def share_of(jointed: JointedMesh) -> PreparedMesh:
    """Return this rank's equal block of a mesh, in the order of the input (collective).

    Unused node numbers have zero coordinates.
    """
    mesh, shape = jointed.mesh, jointed.shape
    cell_map = mesh.topology.index_map(shape.dim)
    owned = slice(cell_map.size_local)
    tags, facet_of_cell = jointed._facet_tags, facets_of_cells(mesh, shape)
    value_of_facet = np.zeros(int(facet_of_cell.max(initial=-1)) + 1, dtype=np.int64)
    value_of_facet[tags.indices] = tags.values
    number_of_node = np.asarray(mesh.geometry.input_global_indices, dtype=np.int64)
    cells = number_of_node[dolfinx_versions.geometry_nodes(mesh)[owned]]
    values = value_of_facet[facet_of_cell[owned]]
    table = np.column_stack([jointed.cell_tags.values[owned], cells, values])  # each cell has a tag
    original = np.asarray(mesh.topology.original_cell_index, dtype=np.int64)[owned]
    table = dealt(mesh.comm, cell_map.size_global, original, table)
    nodes = slice(mesh.geometry.index_map().size_local)
    num_nodes = mesh.comm.allreduce(number_of_node.max(initial=-1), max) + 1
    x = mesh.geometry.x[nodes, : mesh.geometry.dim]
    start, stop = equal_blocks(num_nodes, mesh.comm.size)[mesh.comm.rank :][:2]
    pairs = jointed.pairs
    return PreparedMesh(
        shape=shape,
        cells=table[:, 1 : 1 + cells.shape[1]],
        cell_values=table[:, 0].astype(np.int32),
        facet_values=table[:, 1 + cells.shape[1] :].astype(np.int32),
        x=dealt(mesh.comm, num_nodes, number_of_node[nodes], x),
        glued=glued(pairs.gathered(mesh.comm), start, stop),
        pairs=pairs.sent_to(
            mesh.comm, rank_of(equal_blocks(pairs.count, mesh.comm.size), pairs.number)
        ),
        cell_groups=dict(jointed.cell_groups),
        facet_groups=dict(jointed._facet_groups),
    )
