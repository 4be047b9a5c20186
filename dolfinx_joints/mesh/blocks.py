# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Blocks: the parts of a split mesh that are connected by cells."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from dolfinx_joints.common.mpi import blocks_of, rank_of, rows_at, sent_to
from dolfinx_joints.mesh.cells import Floats, Ints
from dolfinx_joints.mesh.joint_pairs import JointPairs
from dolfinx_joints.mesh.jointed_mesh import local_cells
from dolfinx_joints.mesh.node_numbering import NodeNumbering


def block_of_nodes(nodes: NodeNumbering) -> Ints:
    """Return the block of each local node, including ghosts (collective).

    Blocks are numbered in the order of their first nodes.
    """
    comm, index_map = nodes.space.mesh.comm, nodes.space.dofmap.index_map
    cells = nodes.space.dofmap.list
    local_part = connected(np.repeat(cells[:, 0], cells.shape[1]), cells.ravel(), len(nodes.number))
    count, owned = int(local_part.max(initial=-1)) + 1, index_map.size_local
    least_node = np.full(count, nodes.count, dtype=np.int64)
    np.minimum.at(least_node, local_part, nodes.number)
    # Parts of different ranks belong to one block if they share a node.
    blocks = blocks_of(comm, count)
    parts = local_part + blocks[comm.rank]
    ghosts = np.arange(owned, len(local_part), dtype=np.int32)
    ghost_parts = rows_at(comm, parts[:owned], index_map.local_to_global(ghosts).astype(np.int64))
    links = np.unique(np.column_stack([parts[owned:], ghost_parts]), axis=0)
    links, least_node = (np.concatenate(comm.allgather(values)) for values in (links, least_node))
    part = connected(links[:, 0], links[:, 1], len(least_node))
    first = np.full(len(least_node), nodes.count, dtype=np.int64)
    np.minimum.at(first, part, least_node)
    return np.unique(first[part], return_inverse=True)[1].ravel()[parts]


def blocks_of_pairs(nodes: NodeNumbering, pairs: JointPairs, block: Ints) -> Ints:
    """Return the blocks on the - and + side of this rank's facet pairs, (pairs, 2)."""
    cells = np.stack([pairs.minus[:, 0], pairs.plus[:, 0]], axis=1)
    local = local_cells(nodes.space.mesh, cells.ravel()).reshape(cells.shape)
    return np.asarray(block[nodes.space.dofmap.list[local, 0]])


def connected(one: Ints, other: Ints, size: int) -> Ints:
    """Return the connected part of each of ``size`` nodes, from the linked pairs of nodes."""
    graph = coo_array((np.ones(len(one)), (one, other)), shape=(size, size))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def same_places(points: Floats, distance: float) -> Ints:
    """Return labels (n,), equal for points closer to each other than ``distance`` [m]."""
    pairs = KDTree(points).query_pairs(distance, output_type="ndarray")
    return connected(pairs[:, 0], pairs[:, 1], len(points))


def first_at_places(comm: Any, points: Floats, distance: float) -> Ints:
    """Return, for each point, the global number of the first coincident point, (n,) (collective).

    Points, (n, 3), closer to each other than ``distance`` [m] coincide.
    """
    blocks = blocks_of(comm, len(points))
    number = blocks[comm.rank] + np.arange(len(points))
    # Assign parallel strips to the ranks. Points near a border belong to both strips.
    position = points @ np.sqrt([1.0, 2.0, 3.0])
    reach = 2.0 * np.sqrt(6.0) * distance
    strip = np.floor((position[:, None] + [-reach, reach]) / (1000.0 * reach)).astype(np.int64)
    both = np.append(np.arange(len(points)), np.flatnonzero(strip[:, 0] != strip[:, 1]))
    rank = np.append(strip[:, 0], strip[both[len(points) :], 1]) % comm.size
    numbers, places = (sent_to(comm, rank, values[both]) for values in (number, points))
    label = same_places(places, distance)
    lowest = np.full(int(label.max(initial=-1)) + 1, blocks[-1])
    np.minimum.at(lowest, label, numbers)
    first_numbers = np.column_stack([numbers, lowest[label]])
    rows = sent_to(comm, rank_of(blocks, numbers), first_numbers)
    first = number.copy()
    np.minimum.at(first, rows[:, 0] - blocks[comm.rank], rows[:, 1])
    return first
