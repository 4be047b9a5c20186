# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh of three joints that cross, meet and end inside the body."""

import numpy as np

from dolfinx_joints.geometry.meshing.extrusion import PlaneMesh, edges_between, extrude, grid
from dolfinx_joints.geometry.meshing.gmsh_model import write_mesh, write_plane


def network(out, *, cell, solid, **options):
    """Mesh joints of which two cross (X), one ends on another (T) and one inside."""
    points, cells = grid(np.arange(7.0), np.arange(7.0), cell)
    p, q = points.T
    lines = {"joint_1": p == 2, "joint_2": (q == 3) & (p < 5), "joint_3": (p == 4) & (q <= 3)}
    edges = {name: edges_between(cells, chosen) for name, chosen in lines.items()}
    plane = PlaneMesh(points, {"body": cells}, edges)
    if not solid:
        return write_plane(out, plane, **options)
    return write_mesh(out, extrude(plane, np.arange(3.0), ("ends", "ends")), **options)
