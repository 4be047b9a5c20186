# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Partition of a split mesh: as if its joints were glued, with the cell across a joint as a ghost.

So both cells of a facet pair are on the rank that owns the one on the - side, and integrals over
joints need no other rank.
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
    """Number of each node from ``start`` to ``stop`` where the joints are glued together."""
    sides = np.stack([pairs.minus_vertices, pairs.plus_vertices])
    nodes, place = np.unique(sides, return_inverse=True)
    one, other = place.reshape(2, -1)
    _, first, label = np.unique(
        connected(one, other, len(nodes)), return_index=True, return_inverse=True
    )
    number, here = np.arange(start, stop), (nodes >= start) & (nodes < stop)
    number[nodes[here] - start] = nodes[first[label[here]]]
    return number


def partitioner_across(pairs: JointPairs, number: Ints) -> Callable[..., Any]:
    """A partitioner for `dolfinx.mesh.create_mesh`, ``number`` being this rank's of `glued`."""
    by_facets = dolfinx_versions.cell_partitioner()

    def partition(comm: Any, parts: int, cell_types: Any, cells: list[Any]) -> Any:
        here = [np.ascontiguousarray(rows_at(comm, number, vertices)) for vertices in cells]
        owner = by_facets(comm, parts, cell_types, here).array
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
