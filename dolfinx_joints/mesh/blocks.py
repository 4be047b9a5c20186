# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Blocks: the parts of a split mesh that hang together by their cells."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.mesh.cells import Ints
from dolfinx_joints.mesh.node_numbering import NodeNumbering


def block_of_nodes(nodes: NodeNumbering) -> Ints:
    """Number of the block of each local node, ghosts included (collective)."""
    mesh = nodes.space.mesh
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    cells = mesh.comm.gather(nodes.number[nodes.space.dofmap.list[:owned]], root=0)
    of_all: Ints = on_root(mesh.comm, lambda: connected_blocks(np.concatenate(cells)))
    return of_all[nodes.number]


def connected_blocks(cells: Ints) -> Ints:
    """Number of the connected block of each node, from the nodes of the cells."""
    first = np.broadcast_to(cells[:, :1], cells.shape).ravel()
    size = int(cells.max()) + 1
    graph = coo_array((np.ones(cells.size), (first, cells.ravel())), (size, size))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)
