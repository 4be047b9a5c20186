# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Partition of a split mesh as if the joints were glued, with cells across joints as ghosts.

Both cells of a facet pair are on the rank that owns the - cell. Integrals over joints therefore
need no communication.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from dolfinx_joints.common.mpi import blocks_of, rank_of, rows_at, sent_to
from dolfinx_joints.mesh import dolfinx_versions
from dolfinx_joints.mesh.blocks import connected
from dolfinx_joints.mesh.cells import Ints
from dolfinx_joints.mesh.joint_pairs import JointPairs


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
    """Return a partitioner for `dolfinx.mesh.create_mesh`; `glued` returns ``number``."""
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
