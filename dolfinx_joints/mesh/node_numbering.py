# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Node numbers that do not depend on the partition, and nodal vectors in this order."""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx.fem import FunctionSpace
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Dealt, Floats, Ints
from dolfinx_joints.common.mpi import (
    RowsAt,
    across,
    dealt,
    equal_blocks,
    gathered,
    positions,
    rows_at,
    sent_to,
)


class NodeNumbering:
    """Node numbers in the order of the input mesh, equal on any number of ranks.

    Each rank receives an equal block of nodes in this order, regardless of ownership.

    Attributes:
        space: Vector space of the nodes.
        count: Number of nodes on all ranks.
        blocks: First node of each rank's block, then the number of nodes, shape (ranks + 1,).
        positions: Coordinates of the nodes in this rank's block, shape (n, 3), [m].
        number: Number of each local node, including ghosts.
    """

    def __init__(self, V: FunctionSpace) -> None:
        """Create the numbering, and prepare the exchange of rows (collective)."""
        self.space = V
        self._comm, self._gdim = V.mesh.comm, V.mesh.geometry.dim
        index_map = V.dofmap.index_map
        owned, self.count = index_map.size_local, index_map.size_global
        local = np.arange(owned + index_map.num_ghosts, dtype=np.int32)
        place = index_map.local_to_global(local).astype(np.int64)
        cells = V.mesh.topology.index_map(V.mesh.topology.dim).size_global
        slots = cells * V.dofmap.list.shape[1]
        own_number = positions(self._comm, _lowest_slots(V, place)[:owned], slots)
        self.number = rows_at(self._comm, own_number, place)
        self.blocks = equal_blocks(self.count, self._comm.size)
        order = dealt(self._comm, self.count, own_number, place[:owned])
        self._rows = RowsAt(self._comm, owned, order)
        self.positions: Floats = self._rows(V.tabulate_dof_coordinates()[:owned])

    @property
    def first(self) -> int:
        """First node of this rank's block."""
        return int(self.blocks[self._comm.rank])

    def dealt(self, u: PETSc.Vec) -> Floats:
        """Return the nodal vectors of this rank's block, shape (n, 3) (collective)."""
        rows = self._rows(u.getArray(readonly=True).reshape(-1, self._gdim))
        values = np.zeros((len(rows), 3))
        values[:, : self._gdim] = rows
        return values

    def across(self, rows: NDArray[Any]) -> NDArray[Any] | Dealt:
        """Return the rows of the blocks of all ranks as one array."""
        return across(self._comm, rows, self.blocks)

    def own(self, rows: NDArray[Any]) -> NDArray[Any]:
        """Return the rows of this rank's owned nodes from the rows of all blocks (collective)."""
        return rows_at(self._comm, rows, self.number[: self.space.dofmap.index_map.size_local])

    def gather(self, u: PETSc.Vec) -> Floats:
        """Return all nodal vectors, (num_nodes, 3), on rank 0, empty elsewhere (collective)."""
        vectors = gathered(self._comm, self.dealt(u))
        return np.zeros((0, 3)) if vectors is None else vectors


def _lowest_slots(V: FunctionSpace, place: Ints) -> Ints:
    """Return a number per local node that does not depend on the partition (collective).

    The number is the smallest slot (input cell, position in the cell) of the node on all ranks.
    """
    mesh, dofmap = V.mesh, V.dofmap
    cells = np.asarray(mesh.topology.original_cell_index, dtype=np.int64)
    table = dofmap.list[: len(cells)]
    slots = cells[:, None] * table.shape[1] + np.arange(table.shape[1])
    lowest = np.full(len(place), np.iinfo(np.int64).max)
    np.minimum.at(lowest, table.ravel(), slots.ravel())
    if mesh.comm.size == 1:
        return lowest
    owned = dofmap.index_map.size_local
    owner = dofmap.index_map.owners
    ghosts = np.column_stack([place[owned:], lowest[owned:]])
    rows = sent_to(mesh.comm, np.asarray(owner, dtype=np.int64), ghosts)
    np.minimum.at(lowest, rows[:, 0] - dofmap.index_map.local_range[0], rows[:, 1])
    return lowest
