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

from dolfinx_joints.mesh import dolfinx_versions
from dolfinx_joints.mesh.blocks import connected
from dolfinx_joints.mesh.joint_pairs import JointPairs


def partitioner_across(pairs: JointPairs, num_nodes: int) -> Callable[..., Any]:
    """A partitioner for `dolfinx.mesh.create_mesh`, where rank 0 gives all cells.

    Args:
        pairs: The facet pairs.
        num_nodes: Number of nodes that this rank gives.
    """
    glued = (
        connected(pairs.minus_vertices.ravel(), pairs.plus_vertices.ravel(), num_nodes)
        if num_nodes
        else np.empty(0, dtype=np.int64)
    )
    minus, plus = pairs.minus[:, 0], pairs.plus[:, 0]
    by_facets = dolfinx_versions.cell_partitioner()

    def partition(comm: Any, parts: int, cell_types: Any, cells: list[Any]) -> Any:
        here = [np.ascontiguousarray(glued[vertices]) for vertices in cells]
        owner = by_facets(comm, parts, cell_types, here).array
        if not len(owner):
            return dolfinx_versions.adjacency_list(owner, np.zeros(1, dtype=np.int32))
        apart = owner[minus] != owner[plus]
        ghosts = np.unique(np.column_stack([plus[apart], owner[minus[apart]]]), axis=0)
        ghosted = np.concatenate([np.arange(len(owner)), ghosts[:, 0]])
        ranks = np.concatenate([owner, ghosts[:, 1]])
        order = np.argsort(ghosted, kind="stable")  # the owner comes first
        ends = np.cumsum(np.bincount(ghosted, minlength=len(owner)))
        return dolfinx_versions.adjacency_list(ranks[order], np.concatenate([[0], ends]))

    return partition
