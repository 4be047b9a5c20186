# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint points, their areas and local frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import basix
import numpy as np

from dolfinx_joints.common.mpi import dealt, equal_blocks, positions, rank_of, rows_at, sent_to
from dolfinx_joints.mesh.cells import CellShape, Floats, Ints
from dolfinx_joints.mesh.facet_quadrature import facet_cell_type, facet_rule, vertex_functions
from dolfinx_joints.mesh.joint_pairs import JointPairs, facet_geometry, frames


@dataclass(frozen=True, kw_only=True)
class JointPoints:
    """Joint facets and joint points of this rank.

    All facets of a joint around a vertex or edge midpoint share the joint point there; every other
    point belongs to one facet. Points of all ranks are numbered in the order of their first facet
    and distributed in equal blocks.

    Attributes:
        rule: Points on the reference facet, shape (q, facet dimension).
        facet: Global number of each facet, as in `JointPairs`, shape (num_facets,).
        number: Number of the joint point at each rule point of a facet, shape (num_facets, q).
        share: Fraction of the point's area that lies on the facet, shape (num_facets, q).
        count: Number of points on all ranks.
        points: Coordinates of the points of this rank, shape (n, 3), [m].
        frames: Rows n, s1, s2, shape (n, 3, 3).
        areas: Area of each point, shape (n,), [m^2].
        joint: Joint number of each point, ascending, shape (n,).
        sizes: Shortest edge of the facets that share each point, shape (n,), [m].
    """

    rule: Floats
    facet: Ints
    number: Ints
    share: Floats
    count: int
    points: Floats
    frames: Floats
    areas: Floats
    joint: Ints
    sizes: Floats

    def from_facets(self, comm: Any, values: Ints) -> Ints:
        """Return integers of facets, (num_facets, k), at this rank's points, (n, k) (collective).

        If facets share a point, the point receives the value of the last facet.
        """
        number, blocks = self.number.ravel(), equal_blocks(self.count, comm.size)
        of_facet = np.column_stack([self.facet, values]).repeat(len(self.rule), axis=0)
        rows = sent_to(comm, rank_of(blocks, number), np.column_stack([number, of_facet]))
        rows = rows[np.argsort(rows[:, 1], kind="stable")]
        at_points = np.zeros((len(self.areas), values.shape[1]), dtype=np.int64)
        at_points[rows[:, 0] - blocks[comm.rank]] = rows[:, 2:]
        return at_points


def joint_points(
    comm: Any, pairs: JointPairs, shape: CellShape, degree: int, quadrature: str | int
) -> JointPoints:
    """Lay out the points of all joints (collective).

    Args:
        comm: Communicator of the mesh.
        pairs: This rank's facet pairs.
        shape: Reference cell of the geometry.
        degree: Degree of the displacement.
        quadrature: ``auto``, ``nodal``, ``gauss`` or a degree, see `facet_rule`.

    Raises:
        ValueError: The rule does not exist on these facets.
    """
    corners = shape.facet_vertices.shape[1]
    rule, weights = facet_rule(corners, degree, quadrature)
    x, normal, size = facet_geometry(pairs, shape, rule)
    area = (size * weights)[..., None]
    edge = np.broadcast_to(_shortest_edges(pairs.nodes, corners)[:, None, None], area.shape)
    values: Floats = np.concatenate([area, area * normal, edge, x], axis=2).reshape(-1, 8)
    # Number the rule points of all facets; collect all rule points of a joint point on one rank.
    place = (pairs.number[:, None] * len(rule) + np.arange(len(rule))).ravel()
    keys = _keys(pairs, corners, rule)
    rank = keys[:, 2] % comm.size
    table: Ints = sent_to(comm, rank, np.column_stack([place, keys]))
    order = np.argsort(table[:, 0])  # the sums then do not depend on the number of ranks
    table, values = table[order], sent_to(comm, rank, values)[order]
    _, first, of = np.unique(table[:, 1:], axis=0, return_index=True, return_inverse=True)
    of, total = of.ravel(), pairs.count * len(rule)
    sums, shortest = np.zeros((len(first), 4)), np.full(len(first), np.inf)
    np.add.at(sums, of, values[:, :4])
    np.minimum.at(shortest, of, values[:, 4])
    number, count = positions(comm, table[first, 0], total), comm.allreduce(len(first))
    share = values[:, 0] / sums[of, 0]
    areas, mean, sizes, points = (
        dealt(comm, count, number, column)
        for column in (sums[:, 0], sums[:, 1:], shortest, values[first, 5:])
    )
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    joint = dealt(comm, count, number, table[first, 1])
    rows = np.empty((len(joint), 3, 3))
    for i, axis in enumerate(pairs.axes):
        rows[joint == i] = frames(mean[joint == i], axis, plane=shape.dim == 2)
    own_number, own_share = (
        rows_at(comm, dealt(comm, total, table[:, 0], column), place).reshape(-1, len(rule))
        for column in (number[of], share)
    )
    return JointPoints(
        rule=rule,
        facet=pairs.number,
        number=own_number,
        share=own_share,
        count=count,
        points=points,
        frames=rows,
        areas=areas,
        joint=joint,
        sizes=sizes,
    )


def _shortest_edges(nodes: Floats, corners: int) -> Floats:
    """Return the shortest edge of each facet, shape (num_facets,), [m]."""
    edges = np.array(basix.topology(facet_cell_type(corners))[1])
    vectors = nodes[:, edges[:, 1]] - nodes[:, edges[:, 0]]
    return np.linalg.norm(vectors, axis=2).min(axis=1)


def _keys(pairs: JointPairs, corners: int, rule: Floats) -> Ints:
    """Return keys that identify the joint points, a row per rule point of each facet.

    The key of a point consists of the joint and the vertices, on both sides, of the sub-entity
    (vertex, edge or facet) that contains the point. Points inside a facet add their rule number.
    """
    around = vertex_functions(corners, rule) > 1e-9  # vertices of the sub-entity
    keys = np.full((len(pairs.joint), len(rule), 2 + 2 * corners), -1, dtype=np.int64)
    keys[..., 0] = pairs.joint[:, None]
    for point, vertices in enumerate(around):
        size = np.count_nonzero(vertices)
        if size == corners:
            keys[:, point, 1] = point
        keys[:, point, 2 : 2 + size] = np.sort(pairs.minus_vertices[:, vertices], axis=1)
        keys[:, point, 2 + corners : 2 + corners + size] = np.sort(
            pairs.plus_vertices[:, vertices], axis=1
        )
    return keys.reshape(-1, keys.shape[2])
