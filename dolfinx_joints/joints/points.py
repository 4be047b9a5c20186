# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where joints are evaluated: points, their areas and local frames, the same on every rank."""

from __future__ import annotations

from dataclasses import dataclass

import basix
import numpy as np

from dolfinx_joints.mesh.cells import CellShape, Floats, Ints
from dolfinx_joints.mesh.facet_quadrature import facet_cell_type, facet_rule
from dolfinx_joints.mesh.joint_frames import facet_geometry, fixed_axes, frames
from dolfinx_joints.mesh.joint_pairs import JointPairs


@dataclass(frozen=True, kw_only=True)
class JointPoints:
    """All joint points.

    A point at a vertex or in the middle of an edge is one for all facets of its joint around it;
    every other point belongs to one facet.

    Attributes:
        rule: Points on the reference facet, shape (q, facet dimension).
        number: Point at each facet's rule point, shape (num_facets, q).
        share: Share of the point's area that the facet holds, shape (num_facets, q).
        points: Coordinates, shape (n, 3), [m].
        frames: Rows n, s1, s2, shape (n, 3, 3).
        areas: Area of each point, shape (n,), [m^2].
        joint: Joint number of each point, ascending, shape (n,).
        sizes: Shortest edge of the facets that share each point, shape (n,), [m].
    """

    rule: Floats
    number: Ints
    share: Floats
    points: Floats
    frames: Floats
    areas: Floats
    joint: Ints
    sizes: Floats


def joint_points(
    pairs: JointPairs, shape: CellShape, degree: int, quadrature: str | int
) -> JointPoints:
    """Lay out the points of all joints.

    Args:
        pairs: The facet pairs.
        shape: Reference cell of the geometry.
        degree: Degree of the displacement.
        quadrature: ``auto``, ``nodal``, ``gauss`` or a degree, see `facet_rule`.

    Raises:
        ValueError: The rule does not exist on these facets.
    """
    corners = shape.facet_vertices.shape[1]
    rule, weights = facet_rule(corners, degree, quadrature)
    x, normal, size = facet_geometry(pairs, shape, rule)
    area = size * weights
    number = _numbers(pairs, corners, rule)
    count = int(number.max(initial=-1)) + 1
    first = np.unique(number.ravel(), return_index=True)[1]
    total, mean = np.zeros(count), np.zeros((count, 3))
    sizes = np.full(count, np.inf)
    np.add.at(total, number, area)
    np.add.at(mean, number, area[..., None] * normal)
    np.minimum.at(sizes, number, _shortest_edges(pairs.nodes, corners)[:, None])
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    joint = np.repeat(pairs.joint, len(weights))[first]
    rows = np.empty((count, 3, 3))
    for i, axis in enumerate(fixed_axes(pairs, shape)):
        rows[joint == i] = frames(mean[joint == i], axis, plane=pairs.nodes.shape[2] == 2)
    return JointPoints(
        rule=rule,
        number=number,
        share=area / total[number] if count else area,
        points=x.reshape(-1, 3)[first],
        frames=rows,
        areas=total,
        joint=joint,
        sizes=sizes,
    )


def _shortest_edges(nodes: Floats, corners: int) -> Floats:
    """Shortest distance of two neighbouring vertices of each facet, shape (num_facets,), [m]."""
    edges = np.array(basix.topology(facet_cell_type(corners))[1])
    along = nodes[:, edges[:, 1]] - nodes[:, edges[:, 0]]
    return np.linalg.norm(along, axis=2).min(axis=1)


def _numbers(pairs: JointPairs, corners: int, rule: Floats) -> Ints:
    """Number the points, shape (num_facets, q), in the order of their first facet.

    A point is known by its joint, by the vertices, on both sides, of the facet's sub-entity
    (vertex, edge or the facet itself) that it lies on, and within a facet by its place in the rule.
    """
    kind = facet_cell_type(corners)
    linear = basix.create_element(basix.ElementFamily.P, kind, 1, basix.LagrangeVariant.gll_warped)
    around = linear.tabulate(0, rule)[0, :, :, 0] > 1e-9  # vertices of the sub-entity
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
    _, first, inverse = np.unique(
        keys.reshape(-1, keys.shape[2]), axis=0, return_index=True, return_inverse=True
    )
    order = np.empty(len(first), dtype=np.int64)
    order[np.argsort(first)] = np.arange(len(first))
    return order[inverse.ravel()].reshape(keys.shape[:2])
