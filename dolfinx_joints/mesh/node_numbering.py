# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numbers of nodes that no partition changes, and nodal vectors gathered in their order."""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx.fem import FunctionSpace
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.mesh.cells import Floats


class NodeNumbering:
    """Numbers of the nodes in the order of the input mesh, the same on any number of ranks.

    Attributes:
        space: Vector space of the nodes.
        positions: Node coordinates on rank 0, shape (num_nodes, 3), [m].
        number: Position of each local node (ghosts included) in that order.
    """

    def __init__(self, V: FunctionSpace) -> None:
        """Exchange the order once (collective)."""
        self.space = V
        self._comm, self._gdim = V.mesh.comm, V.mesh.geometry.dim
        owned = V.dofmap.index_map.size_local
        x = V.tabulate_dof_coordinates()
        keys = _node_keys(V)
        parts = self._comm.allgather(keys[:owned])
        every = np.concatenate(parts)
        order = np.argsort(every, kind="stable")
        self._order = order
        sorted_keys = every[order]
        self.number = np.searchsorted(sorted_keys, keys)
        positions = self._comm.gather(x[:owned], root=0)
        self.positions = np.zeros((0, 3)) if positions is None else np.concatenate(positions)[order]

    def gather(self, u: PETSc.Vec) -> Floats:
        """Nodal vectors (num_nodes, 3) on rank 0, empty elsewhere (collective)."""
        parts = self._comm.gather(u.getArray(readonly=True).reshape(-1, self._gdim), root=0)
        if parts is None:
            return np.zeros((0, 3))
        values = np.zeros((len(self._order), 3))
        values[:, : self._gdim] = np.concatenate(parts)[self._order]
        return values


def _node_keys(V: FunctionSpace) -> NDArray[np.int64]:
    """A number for each local node that no partition changes.

    The smallest (input cell, position in the cell) slot that holds the node.
    """
    mesh, dofmap = V.mesh, V.dofmap
    cells = np.asarray(mesh.topology.original_cell_index, dtype=np.int64)
    table = dofmap.list[: len(cells)]
    slots = cells[:, None] * table.shape[1] + np.arange(table.shape[1])
    index_map = dofmap.index_map
    keys = np.full(index_map.size_local + index_map.num_ghosts, np.iinfo(np.int64).max)
    np.minimum.at(keys, table.ravel(), slots.ravel())
    return _least_over_ranks(mesh.comm, index_map, keys)


def _least_over_ranks(comm: Any, index_map: Any, keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """Smallest key that any rank holds for each node."""
    numbers = index_map.local_to_global(np.arange(len(keys), dtype=np.int32))
    least = np.full(index_map.size_global, np.iinfo(np.int64).max)
    for part_numbers, part_keys in comm.allgather((numbers, keys)):
        np.minimum.at(least, part_numbers, part_keys)
    return least[numbers]
