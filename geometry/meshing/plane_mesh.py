# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plane meshes of triangles and quadrilaterals as ``.msh`` files with named groups."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import gmsh
import numpy as np

from dolfinx_joints.geometry.meshing import gmsh_model
from dolfinx_joints.geometry.meshing.arguments import mesh_path
from dolfinx_joints.geometry.meshing.extrusion import FloatArray, PlaneMesh

Section = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


def write_plane(
    out: str | os.PathLike[str],
    plane: PlaneMesh,
    order: int,
    *,
    section: Section | None = None,
    gui: bool = False,
    duplicated: bool = False,
) -> Path:
    """Raise the order, move every node to its exact position and write the file.

    Args:
        out: path of the file; ".msh" is the only format.
        plane: mesh of order 1, in (x, y) or in the reference coordinates of ``section``.
        order: order of the elements, 1 or 2 (complete: 9-node quadrilaterals, 6-node triangles).
        section: map from the reference coordinates (p, q) of all nodes to (x, y) [m]; None if the
            mesh already has its final coordinates and straight edges.
        gui: show the mesh in Gmsh's window afterwards.
        duplicated: duplicate the joint faces.

    Returns:
        The path written.

    Raises:
        ValueError: if the name does not end in ".msh", its folder does not exist, or the file
            cannot be written.
    """
    path = mesh_path(out)
    with gmsh_model.gmsh_session():
        points = np.column_stack([plane.points, np.zeros(len(plane.points))])
        gmsh_model.add_mesh(points, plane.cells, plane.edges, 2)
        gmsh_model.raise_order(order)
        if section is not None:
            tags, reference, _ = gmsh.model.mesh.getNodes()
            p, q, _ = reference.reshape(-1, 3).T
            for tag, x, y in zip(tags, *section(p, q), strict=True):
                gmsh.model.mesh.setNode(tag, [x, y, 0.0], [])
        gmsh_model.save(path, gui, duplicated)
    return path
