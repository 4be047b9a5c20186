# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facet pairs that connect the two sides of the joints: table, geometry, local frames (n, s1, s2).

Each local frame is right-handed and continuous along a joint: s2 is the steepest direction in the
joint and s1 is horizontal. On joints with nearly horizontal facets, s1 is the projection of x or y.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, fields, replace
from typing import Any

import basix
import numpy as np
import ufl
from numpy.typing import NDArray

from dolfinx_joints.common.mpi import sent_to
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.mesh.cells import CellShape, Floats, Ints, lagrange
from dolfinx_joints.mesh.facet_quadrature import facet_cell_type


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


def facet_geometry(
    pairs: JointPairs, shape: CellShape, places: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return the geometry of the - facets at reference points, shape (q, facet dimension).

    Returns:
        Coordinates (F, q, 3) [m], unit normals to the + side (F, q, 3), area factors (F, q).
    """
    gdim = pairs.nodes.shape[2]
    element = lagrange(facet_cell_type(shape.facet_vertices.shape[1]), shape.degree)
    table = element.tabulate(1, places)[:, :, :, 0]
    x = np.zeros((len(pairs.joint), len(places), 3))
    x[..., :gdim] = np.einsum("qa,fai->fqi", table[0], pairs.nodes)
    tangents = np.zeros((2, *x.shape))
    tangents[1, ..., 2] = 1.0  # a unit thickness in 2-D, replaced in 3-D
    for k in range(table.shape[0] - 1):
        tangents[k, ..., :gdim] = np.einsum("qa,fai->fqi", table[k + 1], pairs.nodes)
    normal = np.cross(tangents[0], tangents[1])
    size = np.linalg.norm(normal, axis=2)
    return x, normal * pairs.sign[:, None, None] / size[..., None], size


def fixed_axes(pairs: JointPairs, shape: CellShape) -> list[int]:
    """Return, for each joint, the global axis (0, 1, 2) whose projection is one of the tangents."""
    corners = basix.cell.geometry(facet_cell_type(shape.facet_vertices.shape[1]))
    normal = facet_geometry(pairs, shape, corners)[1]
    return [fixed_axis(normal[pairs.joint == i].reshape(-1, 3)) for i in range(len(pairs.names))]


def fixed_axis(normal: Floats) -> int:
    """Return the first of z, x, y that is nearly parallel to no unit normal, shape (n, 3)."""
    axes = (2, 0, 1)
    across = np.minimum(normal[:, axes] ** 2, 1.0)
    shortest = np.sqrt(1.0 - across).min(axis=0, initial=1.0)
    suitable = np.flatnonzero(shortest > 0.3)
    return axes[suitable[0] if len(suitable) else shortest.argmax()]


def frames(normal: Floats, axis: int, *, plane: bool) -> Floats:
    """Return the frames along a joint, rows n, s1, s2, (n, 3, 3), from normals (n, 3)."""
    if plane:
        s2 = np.broadcast_to([0.0, 0.0, 1.0], normal.shape)
        return np.stack([normal, np.cross(s2, normal), s2], axis=1)
    tangent = np.eye(3)[axis] - normal * normal[:, axis : axis + 1]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    if axis == 2:
        return np.stack([normal, np.cross(tangent, normal), tangent], axis=1)
    return np.stack([normal, tangent, np.cross(normal, tangent)], axis=1)


def ufl_frame(normal: Any, axis: int) -> Any:
    """Return the frame of a unit normal in UFL as a matrix: rows n, s1 and, in 3-D, s2."""
    if normal.ufl_shape == (2,):
        return ufl.as_matrix([[normal[0], normal[1]], [-normal[1], normal[0]]])
    tangent = ufl.unit_vector(axis, 3) - normal[axis] * normal
    tangent /= ufl.sqrt(ufl.inner(tangent, tangent))
    other = ufl.cross(tangent, normal) if axis == 2 else ufl.cross(normal, tangent)
    rows = (normal, other, tangent) if axis == 2 else (normal, tangent, other)
    return ufl.as_matrix([[row[i] for i in range(3)] for row in rows])
