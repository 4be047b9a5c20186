# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Split meshes from where a user has them: files of Gmsh and XDMF, DOLFINx, arrays."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import dolfinx.mesh
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.parameters import check_count, check_named, shown
from dolfinx_joints.mesh.distribution.shares import PreparedMesh, create_jointed, distribute
from dolfinx_joints.mesh.jointed_mesh import JointedMesh
from dolfinx_joints.mesh.preparation import prepare
from dolfinx_joints.mesh.reading.arrays import mesh_of_arrays
from dolfinx_joints.mesh.reading.dolfinx_mesh import split_share
from dolfinx_joints.mesh.reading.gmsh_file import load_msh
from dolfinx_joints.mesh.reading.xdmf_file import XdmfGrids

TagsOrEntities = Mapping[str, int] | Mapping[str, NDArray[np.int32]]


def read_msh(path: str | Path, comm: Any, *, joints: list[str] | None = None) -> JointedMesh:
    """Read a Gmsh ``.msh`` file and split it at its joints (collective).

    Args:
        path: File with named physical groups. A joint is an interior surface group of a
            conforming mesh, or two coincident boundary groups ``NAME-`` and ``NAME+`` of a mesh
            whose nodes are already duplicated; the distance of the latter is an initial gap.
        comm: MPI communicator of the mesh.
        joints: Names of the joints; all surface groups ``joint...``, in any case, unless given.

    Raises:
        MeshError: The file cannot be read, mixes cell types, lacks a joint that was asked for, or
            a joint facet does not have one cell on each side.
    """
    return distribute(comm, lambda: prepare(load_msh(Path(path)), joints))


def split_mesh(
    mesh: dolfinx.mesh.Mesh,
    facet_tags: dolfinx.mesh.MeshTags | None = None,
    *,
    joints: TagsOrEntities | None = None,
    groups: TagsOrEntities | None = None,
    cell_tags: dolfinx.mesh.MeshTags | None = None,
    cell_groups: TagsOrEntities | None = None,
) -> JointedMesh:
    """Split a user's own DOLFINx mesh at some of its facets (collective).

    Args:
        mesh: A conforming mesh of tetrahedra, hexahedra, triangles or quadrilaterals of degree
            1 or 2. It is left as it is; the result holds a new mesh.
        facet_tags: Tags of the joint facets and of the boundary groups.
        joints: Tag of each joint by name; without ``facet_tags`` its local facets, as from
            ``dolfinx.mesh.locate_entities``.
        groups: The same of each boundary group.
        cell_tags: Tags of the cells.
        cell_groups: Tag of each cell group by name; without ``cell_tags`` its local cells.

    Raises:
        MeshError: A tag stands on no facet, or a joint facet does not have one cell on each side.
        ValueError: Joints or groups are no tags by name.
    """
    joints, groups, cell_groups = joints or {}, groups or {}, cell_groups or {}
    every = _checked_groups(joints, groups, cell_groups, facet_tags, cell_tags)
    share = split_share(mesh, facet_tags, every, list(joints), cell_tags, cell_groups)
    return create_jointed(mesh.comm, share)


def read_xdmf(
    path: str | Path,
    comm: Any,
    *,
    joints: Mapping[str, int],
    groups: Mapping[str, int] | None = None,
    cell_groups: Mapping[str, int] | None = None,
    mesh: str | None = None,
    facet_tags: str | None = None,
    cell_tags: str | None = None,
    facet_file: str | Path | None = None,
) -> JointedMesh:
    """Read an XDMF file with its HDF5 file, and split the mesh at tagged facets (collective).

    Args:
        path: File with a mesh and its tags, as from ``dolfinx.io.XDMFFile`` or meshio.
        comm: MPI communicator of the mesh.
        joints: Tag of each joint by name.
        groups: Tag of each boundary group by name.
        cell_groups: Tag of each cell group by name.
        mesh: Name of the mesh in the file; needed where there are several.
        facet_tags: Name of the facet tags in the file, of a grid or of its attribute on cells;
            needed where there are several and not one of them is ``gmsh:physical``.
        cell_tags: Name of the cell tags alike.
        facet_file: XDMF file of the facet tags, if they are in another one.

    Raises:
        MeshError: A file is missing, cannot be read or holds no mesh or tags of that name, a tag
            stands on no facet, or a joint facet does not have one cell on each side.
    """
    joints, groups, cell_groups = joints or {}, groups or {}, cell_groups or {}
    every = _checked_groups(joints, groups, cell_groups, True, True)

    def prepared() -> PreparedMesh:
        body = XdmfGrids(Path(path))
        faces = body if facet_file is None else XdmfGrids(Path(facet_file))
        raw = body.mesh(faces, every, cell_groups, (mesh, facet_tags, cell_tags))
        return prepare(raw, list(joints))

    return distribute(comm, prepared)


def _checked_groups(
    joints: Any, groups: Any, cell_groups: Any, facet_tags: Any, cell_tags: Any
) -> dict[str, Any]:
    """Check groups, given by their tags where there are tags; return boundary groups and joints."""
    for what, given, tags in (
        ("joints", joints, facet_tags),
        ("groups", groups, facet_tags),
        ("cell_groups", cell_groups, cell_tags),
    ):
        check_named(what, given, "a tag by name")
        for name, tag in given.items() if tags is not None else ():
            check_count(f"The tag of {shown(name)}", tag, 0, "it must be a whole number")
    both = sorted(set(joints) & set(groups))
    tags_of_groups = list(groups.values()) if facet_tags is not None else []
    shared = [tag for tag in joints.values() if tag in tags_of_groups]
    if both or shared:
        what = f"The name {both[0]!r}" if both else f"The tag {shared[0]}"
        raise MeshError(f"{what} stands for a joint and for a group; it can be only one of them.")
    return {**groups, **joints}


def mesh_from_arrays(
    comm: Any,
    *,
    cell: str,
    x: Floats,
    cells: Ints,
    facet_groups: Mapping[str, Ints] | None = None,
    cell_groups: Mapping[str, Ints] | None = None,
    joints: list[str] | None = None,
) -> JointedMesh:
    """Split a mesh given as arrays (collective); those of rank 0 count.

    Args:
        comm: MPI communicator of the mesh.
        cell: ``triangle``, ``quadrilateral``, ``tetrahedron`` or ``hexahedron``.
        x: Node coordinates, shape (nodes, 2), of solids (nodes, 3), [m].
        cells: Nodes of each cell, shape (cells, nodes of a cell): 3, 4, 4 or 8 for cells of degree
            1, 6, 9, 10 or 27 for (curved) ones of degree 2, in the order of DOLFINx (basix):
            ``cells[:, [0, 1, 3, 2]]`` of quadrilaterals and ``[0, 1, 3, 2, 4, 5, 7, 6]`` of
            hexahedra in the order of Gmsh, VTK and Abaqus.
        facet_groups: Vertices of the facets of each group in any order, shape (n, vertices of a
            facet); joints are among them, as in `read_msh`.
        cell_groups: Numbers of the cells of each group, shape (n,).
        joints: Names of the joints; all facet groups ``joint...``, in any case, unless given.

    Raises:
        MeshError: An array has another shape or names what is not there, nodes of cells come in
            another order, or a joint facet does not have one cell on each side.
    """

    def prepared() -> PreparedMesh:
        raw = mesh_of_arrays(cell, x, cells, facet_groups or {}, cell_groups or {})
        return prepare(raw, joints)

    return distribute(comm, prepared)
