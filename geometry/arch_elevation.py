# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elevation of half an arch dam as a plane mesh, and its fit to the foundation."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dolfinx_joints.geometry.arch import Sector
from dolfinx_joints.geometry.meshing.columns import Elevation
from dolfinx_joints.geometry.meshing.extrusion import (
    FloatArray,
    IntArray,
    PlaneMesh,
    boundary_edges,
    edges_between,
    split_quadrilaterals,
)

_MIDDLE = 0.5  # ta of the elevation, a surface halfway between the faces


def half_elevation(
    sector: Sector, size: float, cell: str, joints: Mapping[str, float], active: float
) -> PlaneMesh:
    """Return the mesh of half the surface halfway between the faces, developed about the axis.

    Args:
        sector: the body and the axis of its top arch.
        size: cell size [m].
        cell: "hex" or "tet".
        joints: coordinate a of each joint by name, at least 0 [m].
        active: relative height up to which the joints are active.

    Returns:
        Mesh in the coordinates a = (radius of the top's upstream edge) theta and z [m], with the
        edges ``crest``, ``base``, ``abutments`` and the joints with at least half a cell.
    """
    height, radius = sector.dam.height, sector.radius

    def ground(a: FloatArray) -> FloatArray:
        return height * sector.foundation(a / radius, _MIDDLE)

    lines = np.unique([0.0, *joints.values(), radius * sector.half_angle])
    half = Elevation(lines, ground, height * sector.top, height * active, size)
    points, quads = half.mesh()
    cells = split_quadrilaterals(points, quads) if cell == "tet" else quads

    outline = boundary_edges(quads)
    a, z = points[outline].transpose(2, 0, 1)
    on_top, on_axis = (z == half.top).all(axis=1), (a == 0).all(axis=1)
    flat = radius * sector.abutment_angle(_MIDDLE, 0.0)
    on_base = ~on_top & ~on_axis & ((a.mean(axis=1) < flat) | (a == 0).any(axis=1))
    if sector.upright:
        on_base = (z == 0).all(axis=1)
    edges: dict[str, IntArray] = {
        "crest": outline[on_top],
        "base": outline[on_base],
        "abutments": outline[~on_top & ~on_axis & ~on_base],
    }
    for name, line in joints.items():
        if half.reaches(line):
            below = (points[:, 0] == line) & (points[:, 1] <= half.level)
            edges[name] = edges_between(cells, below)
    return PlaneMesh(points, {"concrete": cells}, edges)


def fitted_level(
    sector: Sector, theta: FloatArray, ta: FloatArray, zeta: FloatArray, active: float, depth: float
) -> FloatArray:
    """Return the levels of the elevation, shifted so that they fit the foundation at ta.

    The shift decreases linearly from the foundation to zero at the active height, which therefore
    does not move. If the foundation is near or above the active height, the shift decreases to
    zero within ``depth``.

    Args:
        sector: the body and the axis of its top arch.
        theta: angles about the axis [radians], shape (num_nodes,).
        ta: relative positions between the faces, shape (num_nodes,).
        zeta: relative heights in the elevation, shape (num_nodes,).
        active: relative height up to which the joints are active.
        depth: least difference of relative heights in which the shift decreases to zero.

    Returns:
        Relative heights, shape (num_nodes,).
    """
    elevation_level = sector.foundation(theta, _MIDDLE)
    shift = sector.foundation(theta, ta) - elevation_level
    reach = np.maximum(active - elevation_level, np.minimum(depth, sector.top - elevation_level))
    fade = np.clip(1 - (zeta - elevation_level) / np.maximum(reach, 1e-12), 0, 1)
    return zeta + shift * fade
