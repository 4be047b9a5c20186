# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint points ordered facet by facet for files, distributed over the ranks."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Dealt, Ints
from dolfinx_joints.common.mpi import RowsAt, across, dealt, equal_blocks
from dolfinx_joints.joints.operator import JointOperator

Rows = NDArray[Any]


class JointRows:
    """Reorders values of joint points by joint and facet, in equal blocks of facets, one per rank.

    Attributes:
        names: Names of the joints.
        joint: Joint number of each row of this rank, ascending, shape (n,).
    """

    def __init__(self, operator: JointOperator) -> None:
        """Exchange the order of the points once (collective)."""
        self._comm, self.names = operator.comm, operator.names
        layout, pairs = operator.layout, operator.jointed.pairs
        number, share = (
            dealt(self._comm, pairs.count, layout.facet, values)
            for values in (layout.number, layout.share)
        )
        self._rows = RowsAt(self._comm, len(layout.areas), number.ravel())
        self.joint: Ints = self._rows(layout.joint)
        facets = np.bincount(pairs.joint, minlength=len(self.names))
        ends = np.concatenate([[0], np.cumsum(self._comm.allreduce(facets))])
        blocks = equal_blocks(pairs.count, self._comm.size)
        rank, points = self._comm.rank, len(layout.rule)
        within = np.clip(blocks, ends[:-1, None], ends[1:, None]) - ends[:-1, None]
        self._within = points * within  # First row of each rank in each joint.
        ends_here = np.cumsum(self._within[:, rank + 1] - self._within[:, rank])
        self._slices = [slice(*ends) for ends in pairwise([0, *ends_here])]
        facet = np.arange(blocks[rank], blocks[rank + 1]).repeat(points) - ends[self.joint]
        self._constant_rows = {
            "points": self(layout.points),
            "frames": self(layout.frames),
            "areas": self(layout.areas) * share.ravel(),
            "facet": facet,
            "tied": self(operator.tied.astype(np.int8)),
        }

    def __call__(self, values: Rows) -> Rows:
        """Return rows of this rank from values of its joint points, shape (n, ...) (collective)."""
        return self._rows(values)

    def by_joint(self, rows: Rows) -> dict[str, Rows]:
        """Return rows of this rank by joint."""
        return {name: rows[of] for name, of in zip(self.names, self._slices, strict=True)}

    def across(self, rows: Rows) -> dict[str, Rows | Dealt]:
        """Return rows of all ranks by joint."""
        parts = zip(self.by_joint(rows).items(), self._within, strict=True)
        return {name: across(self._comm, local, blocks) for (name, local), blocks in parts}

    def constant_arrays(self, *, local: bool = False) -> dict[str, dict[str, Any]]:
        """Return points, frames, areas, facets and tied flags by joint.

        With ``local`` only the rows of this rank.
        """
        split = self.by_joint if local else self.across
        parts = {key: split(rows) for key, rows in self._constant_rows.items()}
        return {name: {key: part[name] for key, part in parts.items()} for name in self.names}
