# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where joints are evaluated: points, their areas and local frames, the same on every rank.

Each local frame (n, s1, s2) is right-handed and continuous along a joint: s2 is the steepest
direction in the joint and s1 is horizontal; where a joint comes near the horizontal, s1 follows x
(else y) instead.
"""

from __future__ import annotations

from dataclasses import dataclass

import basix
import numpy as np

from dolfinx_joints.mesh.cells import CellShape, Floats, Ints
from dolfinx_joints.mesh.facet_quadrature import (
    facet_cell_type,
    facet_rule,
    is_nodal,
    nodes_with_points,
)
from dolfinx_joints.mesh.joint_pairs import JointPairs


@dataclass(frozen=True, kw_only=True)
class JointPoints:
    """All joint points.

    With a nodal rule there is one point per pair of nodes and joint, shared by the facets around
    it; with a Gauss rule every point belongs to one facet.

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
    x, normal, size = _facet_geometry(pairs, shape, rule)
    area = size * weights
    if is_nodal(corners, degree, quadrature):
        number = _node_pairs(pairs, corners, degree)
    else:
        number = np.arange(area.size, dtype=np.int64).reshape(area.shape)
    count = int(number.max(initial=-1)) + 1
    first = np.unique(number.ravel(), return_index=True)[1]
    total, mean = np.zeros(count), np.zeros((count, 3))
    sizes = np.full(count, np.inf)
    np.add.at(total, number, area)
    np.add.at(mean, number, area[..., None] * normal)
    np.minimum.at(sizes, number, _shortest_edges(pairs.nodes, corners)[:, None])
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    joint = np.repeat(pairs.joint, len(weights))[first]
    frames = np.empty((count, 3, 3))
    for i in range(len(pairs.names)):
        here = joint == i
        frames[here] = _frames(mean[here], plane=pairs.nodes.shape[2] == 2)
    return JointPoints(
        rule=rule,
        number=number,
        share=area / total[number] if count else area,
        points=x.reshape(-1, 3)[first],
        frames=frames,
        areas=total,
        joint=joint,
        sizes=sizes,
    )


def _shortest_edges(nodes: Floats, corners: int) -> Floats:
    """Shortest distance of two neighbouring vertices of each facet, shape (num_facets,), [m]."""
    edges = np.array(basix.topology(facet_cell_type(corners))[1])
    along = nodes[:, edges[:, 1]] - nodes[:, edges[:, 0]]
    return np.linalg.norm(along, axis=2).min(axis=1)


def _facet_geometry(
    pairs: JointPairs, shape: CellShape, rule: Floats
) -> tuple[Floats, Floats, Floats]:
    """Coordinates (F, q, 3), unit normals (F, q, 3) and area stretch (F, q) on curved facets."""
    gdim = pairs.nodes.shape[2]
    element = basix.create_element(
        basix.ElementFamily.P,
        facet_cell_type(shape.facet_vertices.shape[1]),
        shape.degree,
        basix.LagrangeVariant.gll_warped,
    )
    table = element.tabulate(1, rule)[:, :, :, 0]
    x = np.zeros((len(pairs.joint), len(rule), 3))
    x[..., :gdim] = np.einsum("qa,fai->fqi", table[0], pairs.nodes)
    along = np.zeros((2, *x.shape))
    along[1, ..., 2] = 1.0  # a unit thickness in 2-D, replaced in 3-D
    for k in range(table.shape[0] - 1):
        along[k, ..., :gdim] = np.einsum("qa,fai->fqi", table[k + 1], pairs.nodes)
    normal = np.cross(along[0], along[1])
    size = np.linalg.norm(normal, axis=2)
    return x, normal * pairs.sign[:, None, None] / size[..., None], size


def _node_pairs(pairs: JointPairs, corners: int, degree: int) -> Ints:
    """Number the pairs of nodes, shape (num_facets, q), in the order of their first facet.

    A pair is known by its joint and by the vertices, on both sides, of the facet's sub-entity
    (vertex, edge or the facet itself) that it lies on.
    """
    kind = facet_cell_type(corners)
    element = basix.create_element(
        basix.ElementFamily.P, kind, degree, basix.LagrangeVariant.gll_warped
    )
    keys = np.full((len(pairs.joint), element.dim, 1 + 2 * corners), -1, dtype=np.int64)
    keys[..., 0] = pairs.joint[:, None]
    for dim, entities in enumerate(element.entity_dofs):
        for entity, dofs in enumerate(entities):
            vertices = basix.topology(kind)[dim][entity]
            size = len(vertices)
            for dof in dofs:
                keys[:, dof, 1 : 1 + size] = np.sort(pairs.minus_vertices[:, vertices], axis=1)
                keys[:, dof, 1 + corners : 1 + corners + size] = np.sort(
                    pairs.plus_vertices[:, vertices], axis=1
                )
    keys = keys[:, nodes_with_points(corners, degree)]
    _, first, inverse = np.unique(
        keys.reshape(-1, keys.shape[2]), axis=0, return_index=True, return_inverse=True
    )
    order = np.empty(len(first), dtype=np.int64)
    order[np.argsort(first)] = np.arange(len(first))
    return order[inverse.ravel()].reshape(keys.shape[:2])


def _frames(normal: Floats, *, plane: bool) -> Floats:
    """Continuous right-handed frames (n, s1, s2) of one joint, normals of shape (n, 3)."""
    if plane:
        s2 = np.broadcast_to([0.0, 0.0, 1.0], normal.shape)
        return np.stack([normal, np.cross(s2, normal), s2], axis=1)
    axes = (2, 0, 1)
    shortest = [np.sqrt(1.0 - np.minimum(normal[:, k] ** 2, 1.0)).min() for k in axes]
    long_enough = [i for i, length in enumerate(shortest) if length > 0.3]
    choice = axes[long_enough[0] if long_enough else int(np.argmax(shortest))]
    tangent = np.eye(3)[choice] - normal * normal[:, choice : choice + 1]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    if choice == 2:
        return np.stack([normal, np.cross(tangent, normal), tangent], axis=1)
    return np.stack([normal, tangent, np.cross(normal, tangent)], axis=1)
