# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solids of Open CASCADE in the current Gmsh model: faces, groups, mesh."""

from __future__ import annotations

import gmsh
import numpy as np

from dolfinx_joints.geometry.meshing import gmsh_model
from dolfinx_joints.geometry.meshing.arguments import check_fine


def faces_of(volume: int) -> list[int]:
    """Return the faces of a volume."""
    return [int(face) for face in gmsh.model.getAdjacencies(3, volume)[1]]


def sides_of(face: int) -> list[int]:
    """Return the volumes next to a face."""
    return [int(volume) for volume in gmsh.model.getAdjacencies(2, face)[0]]


def add_groups(dim: int, groups: dict[str, list[int]]) -> None:
    """Add physical groups of the given dimension, by name."""
    for name, tags in groups.items():
        gmsh.model.addPhysicalGroup(dim, tags, name=name)


def _number_of_cells(size: float, joint_size: float, joint: list[tuple[int, int]]) -> float:
    """Return the approximate number of tetrahedra in the solids and at the joints."""
    volume = sum(gmsh.model.occ.getMass(3, tag) for _, tag in gmsh.model.getEntities(3))
    outer = sum(gmsh.model.occ.getMass(2, tag) for _, tag in gmsh.model.getEntities(2))
    edges = sum(gmsh.model.occ.getMass(1, tag) for _, tag in gmsh.model.getEntities(1))
    joint_area = sum(gmsh.model.occ.getMass(2, tag) for _, tag in joint)
    h = min(size, joint_size)
    return volume / size**3 * 8 + outer / size**2 * 2 + edges / size + joint_area / h**2 * 8


def mesh_solids(
    size: float, joint_size: float | None, faces: dict[str, list[int]], order: int
) -> None:
    """Mesh the current model and check its cells."""
    joint = [(2, f) for name, tags in faces.items() if name.startswith("joint_") for f in tags]
    check_fine(_number_of_cells(size, size if joint_size is None else joint_size, joint))
    gmsh.model.mesh.setSize(gmsh.model.getEntities(0), size)
    if joint_size is not None:
        corners = gmsh.model.getBoundary(joint, combined=False, recursive=True) if joint else []
        gmsh.model.mesh.setSize(corners, min(size, joint_size))
    try:
        gmsh.model.mesh.generate(3)
        gmsh_model.raise_order(order)
    except Exception as error:
        raise RuntimeError(f"Gmsh cannot mesh the solids: {error}.") from None
    kind = 11 if order == 2 else 4
    smallest = float(
        np.min([gmsh_model.scaled_jacobians(kind, t).min() for _, t in gmsh.model.getEntities(3)])
    )
    if not smallest > 0:
        raise RuntimeError(
            f"the smallest scaled Jacobian of the mesh is {smallest:.3g}, but it must be positive: "
            "choose a smaller size or order 1."
        )
