# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Geometry of joint facets, and the local frames (n, s1, s2) of joints.

Each local frame is right-handed and continuous along a joint: s2 is the steepest direction in the
joint and s1 is horizontal. On joints with nearly horizontal facets, s1 is the projection of x or y.
"""

from __future__ import annotations

from typing import Any

import basix
import numpy as np
import ufl

from dolfinx_joints.mesh.cells import CellShape, Floats, lagrange
from dolfinx_joints.mesh.facet_quadrature import facet_cell_type
from dolfinx_joints.mesh.joint_pairs import JointPairs


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
