# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Table of the facet pairs that connect the two sides of the joints."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.mpi import sent_to
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.mesh.cells import Floats, Ints


@dataclass(frozen=True, kw_only=True)
class JointPairs:
    """Facet pairs of the joints. A `JointedMesh` has the pairs whose - cell this rank owns.

    Attributes:
        names: Joint names.
        count: Number of pairs on all ranks.
        axes: Global axis (0, 1, 2) of each joint whose projection is one of the tangents.
        number: Global number of each pair, ascending, shape (num_pairs,).
        joint: Joint number of each pair, ascending, shape (num_pairs,).
        minus: Input cell number and local facet on the - side, shape (num_pairs, 2).
        plus: Input cell number and local facet on the + side, shape (num_pairs, 2).
        match: Position in the + facet of the partner of each vertex of the - facet, shape
            (num_pairs, vertices per facet).
        minus_vertices: Node numbers of the vertices of the - facet, shape like ``match``.
        plus_vertices: Node numbers of the partner vertices; equal at a joint's end inside a body.
        nodes: Coordinates of the nodes of the - facet in the order of its Lagrange element, shape
            (num_pairs, nodes per facet, gdim), [m].
        sign: 1 if the normal by vertex order of the - facet points to the + side, otherwise -1.
        gaps_in_geometry: True if the two faces may be apart in the undeformed mesh.
        bonded: Number of facets of each joint that cannot open, shape (num_joints,).
    """

    names: tuple[str, ...]
    count: int
    axes: tuple[int, ...]
    number: Ints
    joint: Ints
    minus: Ints
    plus: Ints
    match: Ints
    minus_vertices: Ints
    plus_vertices: Ints
    nodes: Floats
    sign: Ints
    gaps_in_geometry: bool
    bonded: Ints

    def rows(self) -> dict[str, Any]:
        """Return the arrays that have one row per pair, by name."""
        return {name: getattr(self, name) for name in PAIR_ROWS}

    def block(self, start: int, stop: int) -> JointPairs:
        """Return the pairs from position ``start`` up to ``stop``."""
        return replace(self, **{name: values[start:stop] for name, values in self.rows().items()})

    def sent_to(self, comm: Any, rank: NDArray[Any]) -> JointPairs:
        """Send each pair to a rank, and return the received pairs (collective)."""
        return self._with({name: sent_to(comm, rank, row) for name, row in self.rows().items()})

    def gathered(self, comm: Any) -> JointPairs:
        """Return the pairs of all ranks (collective)."""
        rows = self.rows().items()
        return self._with({name: np.concatenate(comm.allgather(values)) for name, values in rows})

    def _with(self, rows: dict[str, Any]) -> JointPairs:
        """Return the pairs with the given rows, sorted by number."""
        order = np.argsort(rows["number"])
        return replace(self, **{name: values[order] for name, values in rows.items()})


PAIR_ROWS = tuple(
    field.name
    for field in fields(JointPairs)
    if field.name not in ("names", "count", "axes", "gaps_in_geometry", "bonded")
)


def no_such_joint(name: Any, names: Collection[str]) -> str:
    """Return the error message for an unknown joint name."""
    return f"There is no joint {shown(name)}; the joints are: {', '.join(names) or 'none'}."
