# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Blocks: the parts of a split mesh that hang together by their cells."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.mesh.cells import Floats, Ints
from dolfinx_joints.mesh.joint_pairs import JointPairs
from dolfinx_joints.mesh.jointed_mesh import local_cells
from dolfinx_joints.mesh.node_numbering import NodeNumbering


def block_of_nodes(nodes: NodeNumbering) -> Ints:
    """Number of the block of each local node, ghosts included (collective)."""
    mesh = nodes.space.mesh
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    cells = mesh.comm.gather(nodes.number[nodes.space.dofmap.list[:owned]], root=0)

    def blocks() -> Ints:
        every = np.concatenate(cells)
        return connected(np.repeat(every[:, 0], every.shape[1]), every.ravel(), every.max() + 1)

    return on_root(mesh.comm, blocks)[nodes.number]


def blocks_of_pairs(nodes: NodeNumbering, pairs: JointPairs, block: Ints) -> Ints:
    """Blocks on the - and + side of each facet pair of this rank, shape (pairs, 2).

    Args:
        nodes: Numbers the nodes.
        pairs: The facet pairs of a `JointedMesh`.
        block: Block of each local node, of `block_of_nodes`.
    """
    cells = np.stack([pairs.minus[:, 0], pairs.plus[:, 0]], axis=1)
    local = local_cells(nodes.space.mesh, cells.ravel()).reshape(cells.shape)
    return np.asarray(block[nodes.space.dofmap.list[local, 0]])


def connected(one: Ints, other: Ints, size: int) -> Ints:
    """Number of the connected part of each of ``size`` nodes, of which some pairs are linked."""
    graph = coo_array((np.ones(len(one)), (one, other)), shape=(size, size))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def same_places(points: Floats, distance: float) -> Ints:
    """Numbers of points, the same for those nearer to each other than a distance [m], (n,)."""
    pairs = KDTree(points).query_pairs(distance, output_type="ndarray")
    return connected(pairs[:, 0], pairs[:, 1], len(points))
