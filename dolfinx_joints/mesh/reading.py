# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Split meshes from where a user has them: a Gmsh file, a DOLFINx mesh."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import dolfinx.mesh

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.parameters import check_count, check_kind_of, check_path, shown
from dolfinx_joints.mesh.gather import gather_mesh
from dolfinx_joints.mesh.gmsh_file import load_msh
from dolfinx_joints.mesh.jointed_mesh import JointedMesh, distribute
from dolfinx_joints.mesh.preparation import prepare


def read_msh(path: str | Path, comm: Any, *, joints: list[str] | None = None) -> JointedMesh:
    """Read a Gmsh ``.msh`` file and split it at its joints (collective).

    Args:
        path: File with named physical groups. A joint is an interior surface group of a
            conforming mesh, or two coincident boundary groups ``NAME-`` and ``NAME+`` of a mesh
            whose nodes are already duplicated; the distance of the latter is an initial gap.
        comm: MPI communicator of the mesh.
        joints: Names of the joints; every surface group whose name starts with ``joint`` unless
            given.

    Raises:
        MeshError: The file cannot be read, mixes cell types, lacks a joint that was asked for, or
            a joint facet does not have one cell on each side.
    """
    check_path("path", path)
    return distribute(comm, lambda: prepare(load_msh(Path(path)), joints))


def split_mesh(
    mesh: dolfinx.mesh.Mesh,
    facet_tags: dolfinx.mesh.MeshTags,
    *,
    joints: Mapping[str, int],
    groups: Mapping[str, int],
    cell_tags: dolfinx.mesh.MeshTags | None = None,
    cell_groups: Mapping[str, int] | None = None,
) -> JointedMesh:
    """Split a user's own DOLFINx mesh at tagged facets (collective).

    Args:
        mesh: A conforming mesh of tetrahedra, hexahedra, triangles or quadrilaterals of degree
            1 or 2. It is left as it is; the result holds a new mesh.
        facet_tags: Tags of the joint facets and of the boundary groups.
        joints: Tag of each joint by name.
        groups: Tag of each boundary group by name.
        cell_tags: Tags of the cells, if there are cell groups.
        cell_groups: Tag of each cell group by name.

    Raises:
        MeshError: A tag stands on no facet, or a joint facet does not have one cell on each side.
        ValueError: Mesh or tags are not DOLFINx's, or joints or groups are no tags by name.
    """
    check_kind_of("mesh", mesh, isinstance(mesh, dolfinx.mesh.Mesh), "a DOLFINx mesh")
    cell_groups = {} if cell_groups is None else cell_groups
    for what, given in (("joints", joints), ("groups", groups), ("cell_groups", cell_groups)):
        named = isinstance(given, Mapping) and all(isinstance(name, str) for name in given)
        check_kind_of(what, given, named, "a tag by name")
        for name, tag in given.items():
            check_count(f"The tag of {shown(name)}", tag, 0, "it must be a whole number")
    both = sorted(set(joints) & set(groups))
    shared = sorted(set(joints.values()) & set(groups.values()))
    if both or shared:
        what = f"The name {both[0]!r}" if both else f"The tag {shared[0]}"
        raise MeshError(f"{what} stands for a joint and for a group; it can be only one of them.")
    raw = gather_mesh(mesh, facet_tags, {**groups, **joints}, cell_tags, cell_groups)
    return distribute(mesh.comm, lambda: prepare(raw, list(joints)))
