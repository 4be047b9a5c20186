# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solids of Open CASCADE: faces, groups, mesh, and wedges cut out by planes with a dip."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import gmsh
import numpy as np

from dolfinx_joints.common.parameters import check_kind_of, numbers_of, shown
from dolfinx_joints.exact import plane_normal
from dolfinx_joints.geometry.meshing import gmsh_model
from dolfinx_joints.geometry.meshing.arguments import check_fine
from dolfinx_joints.geometry.meshing.extrusion import FloatArray
from dolfinx_joints.geometry.meshing.step_file import check_word, is_point


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


# Dip and dip direction as in `plane_normal` [degrees], and a point x, y, z of the plane [m].
Plane = Sequence[float]

ON_PLANE = 1e-6  # largest distance of a face from its plane, relative to the body's extent


def check_planes(planes: Mapping[str, Plane]) -> None:
    """Raise ValueError unless there are planes, each with a name and five numbers."""
    is_named = isinstance(planes, Mapping) and len(planes) > 0
    check_kind_of("planes", planes, is_named, "planes by name, at least one")
    for name, plane in planes.items():
        check_word("A plane", name)
        x = numbers_of(plane)
        if x is None or x.shape != (5,) or not np.isfinite(x).all() or not 0 <= x[0] <= 90:
            raise ValueError(
                f"The plane {name!r} is {shown(plane)}, but it must be (dip, dip direction, x, y, "
                "z) with a dip from 0 to 90 degrees."
            )


def bounded(
    solid: int, planes: Mapping[str, Plane], inside: Sequence[float], *, below: bool = False
) -> int:
    """Cut a solid by planes; return the tag of the part around a point, the rest is removed.

    Raises:
        ValueError: if the point is not in the solid, or lies on a plane or not ``below`` it.
    """
    if not is_point(inside):
        raise ValueError(f"The point of a wedge is {shown(inside)}, but it must be (x, y, z).")
    point, occ, parts = np.asarray(inside, dtype=np.float64), gmsh.model.occ, [(3, solid)]
    box = np.reshape(gmsh.model.getBoundingBox(3, solid), (2, 3))
    reach = 2.0 * float(np.linalg.norm(box[1] - box[0]))
    for name, plane in planes.items():
        normal = plane_normal(*plane[:2])
        distance = float((point - plane[2:]) @ normal)
        if abs(distance) < ON_PLANE * reach or (below and distance > 0):
            where = "is not below" if below else "lies on"
            raise ValueError(f"The point {tuple(inside)} {where} the plane {name!r}.")
        low = 0.0 if distance > 0 else -2.0 * reach
        half = [(3, occ.addBox(-reach, -reach, low, 2 * reach, 2 * reach, 2 * reach))]
        occ.rotate(half, 0, 0, 0, -normal[1], normal[0], 0, np.radians(plane[0]))
        occ.translate(half, *(point - distance * normal))
        parts, _ = occ.intersect(parts, half)
    occ.synchronize()
    around = [tag for dim, tag in parts if dim == 3 and gmsh.model.isInside(3, tag, list(point))]
    if len(around) != 1:
        raise ValueError(f"The point {tuple(inside)} of the wedge is not inside the rock.")
    occ.remove([part for part in parts if part[1] != around[0]], recursive=True)
    occ.synchronize()
    return around[0]


def cut_wedge(
    solid: int, planes: Mapping[str, Plane], inside: Sequence[float]
) -> tuple[int, list[int]]:
    """Cut the part around a point out of a solid; return its tag, and those of the rest."""
    occ = gmsh.model.occ
    ((_, copy),) = occ.copy([(3, solid)])
    occ.synchronize()
    wedge = bounded(copy, planes, inside)
    remaining, _ = occ.cut([(3, solid)], [(3, wedge)], removeTool=False)
    occ.synchronize()
    return wedge, [tag for dim, tag in remaining if dim == 3]


def faces_on_planes(wedge: Iterable[int], planes: Mapping[str, Plane]) -> dict[str, list[int]]:
    """Return the faces between a wedge and other volumes on each plane, by joint name.

    Raises:
        ValueError: if a plane does not bound the wedge, or is given twice.
    """
    tags = set(wedge)
    faces = [f for _, f in gmsh.model.getEntities(2) if len(set(sides_of(f)) & tags) == 1]
    faces = [face for face in faces if len(sides_of(face)) == 2]
    extent = np.ptp(np.reshape(gmsh.model.getBoundingBox(-1, -1), (2, 3)), axis=0).max()
    joints = {}
    for name, plane in planes.items():
        normal = plane_normal(*plane[:2])
        joints[f"joint_{name}"] = [
            face
            for face in faces
            if np.abs((_corners(face) - plane[2:]) @ normal).max() < ON_PLANE * extent
        ]
        if not joints[f"joint_{name}"]:
            raise ValueError(f"The plane {name!r} is given twice or does not bound the wedge.")
        faces = [face for face in faces if face not in joints[f"joint_{name}"]]
    return joints


def _corners(face: int) -> FloatArray:
    """Return the corners of a face, shape (n, 3), [m]."""
    corners = gmsh.model.getBoundary([(2, face)], combined=False, recursive=True)
    return np.array([gmsh.model.getValue(0, tag, []) for _, tag in corners])
