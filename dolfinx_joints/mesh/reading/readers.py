# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Readers of split meshes: from mesh files, DOLFINx meshes and arrays."""

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
    """Read a Gmsh ``.msh`` file and split the mesh at its joints (collective).

    Args:
        path: File with named physical groups. A joint is an interior surface group of a
            conforming mesh. If the nodes are already duplicated, a joint is two matching boundary
            groups ``NAME-`` and ``NAME+``, whose distance is the initial gap.
        comm: MPI communicator of the mesh.
        joints: Names of the joints. The default is all surface groups whose name begins with
            ``joint`` in lower or upper case.

    Raises:
        MeshError: The file cannot be read, mixes cell types or has no joint of a given name. A
            joint facet does not have one cell on each side.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> path = two_blocks("blocks.msh", size=0.5)  # two cubes of 1 m, one on the other
        >>> mesh = dj.read_msh(path, MPI.COMM_WORLD)
        >>> mesh.joint_names
        ('joint_1',)
        >>> sorted(mesh.facet_groups), sorted(mesh.cell_groups)
        (['base', 'sides', 'top'], ['lower', 'upper'])
    """
    return distribute(comm, lambda: prepare(load_msh(Path(path)), joints))


def read_mesh(
    path: str | Path, comm: Any, *, unit: str | float, joints: list[str] | None = None
) -> JointedMesh:
    """Read a mesh file of another program and split the mesh at its joints (collective).

    Args:
        path: Abaqus (``.inp``), Salome (``.med``), I-DEAS (``.unv``), Exodus (``.exo``, ``.e``,
            ``.ex2``, ``.g``) or VTK (``.vtu``) file. Sets of cells become cell groups. Surfaces,
            sets of shells or lines, and node sets become facet groups; a facet is in a node set if
            all its vertices are. Quadratic hexahedra and quadrilaterals without nodes at their
            centres are completed, without change of the geometry.
        comm: MPI communicator of the mesh.
        unit: Unit of the coordinates: ``m``, ``cm``, ``mm``, ``ft``, ``in``, or its length [m].
        joints: Names of the joints: facet groups between two cells, faces with coincident nodes,
            or sets of cohesive elements or of cells without thickness. The default is all sets of
            such elements, and facet groups whose name begins with ``joint`` in lower or upper case.

    Raises:
        MeshError: The file cannot be read, is in no known format or mixes kinds of cells. It has
            no joint of a given name. A joint facet does not have one cell on each side.
        ValueError: The unit is unknown.
    """

    def prepare_mesh() -> PreparedMesh:
        from dolfinx_joints.mesh.reading.other_programs import load_mesh

        return prepare(*load_mesh(Path(path), unit, joints))

    return distribute(comm, prepare_mesh)


def split_mesh(
    mesh: dolfinx.mesh.Mesh,
    facet_tags: dolfinx.mesh.MeshTags | None = None,
    *,
    joints: TagsOrEntities | None = None,
    groups: TagsOrEntities | None = None,
    cell_tags: dolfinx.mesh.MeshTags | None = None,
    cell_groups: TagsOrEntities | None = None,
) -> JointedMesh:
    """Split a DOLFINx mesh at given facets (collective).

    Args:
        mesh: Conforming mesh of tetrahedra, hexahedra, triangles or quadrilaterals of degree 1 or
            2. This mesh is not changed; the result contains a new mesh.
        facet_tags: Tags of the joint facets and of the boundary groups.
        joints: Tag of each joint by name. Without ``facet_tags``: local facets of each joint, for
            example from ``dolfinx.mesh.locate_entities``.
        groups: Tag or local facets of each boundary group by name.
        cell_tags: Tags of the cells.
        cell_groups: Tag of each cell group by name. Without ``cell_tags``: local cells.

    Raises:
        MeshError: No facet has a given tag, or a joint facet does not have one cell on each side.
        ValueError: Joints or groups are not given as tags or entities by name.

    Example:
        >>> from mpi4py import MPI
        >>> import numpy as np
        >>> from dolfinx.mesh import create_unit_cube, locate_entities
        >>> import dolfinx_joints as dj
        >>> cube = create_unit_cube(MPI.COMM_WORLD, 2, 2, 2)
        >>> middle = locate_entities(cube, 2, lambda x: np.isclose(x[2], 0.5))
        >>> base = locate_entities(cube, 2, lambda x: np.isclose(x[2], 0.0))
        >>> halves = dj.split_mesh(cube, joints={"joint": middle}, groups={"base": base})
        >>> len(cube.geometry.x), len(halves.mesh.geometry.x)  # 9 nodes are duplicated
        (27, 36)
    """
    joints, groups, cell_groups = joints or {}, groups or {}, cell_groups or {}
    all_groups = _checked_groups(joints, groups, cell_groups, facet_tags, cell_tags)
    share = split_share(mesh, facet_tags, all_groups, list(joints), cell_tags, cell_groups)
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
        path: File with a mesh and its tags, written by ``dolfinx.io.XDMFFile`` or meshio.
        comm: MPI communicator of the mesh.
        joints: Tag of each joint by name.
        groups: Tag of each boundary group by name.
        cell_groups: Tag of each cell group by name.
        mesh: Name of the mesh in the file; required if the file has several meshes.
        facet_tags: Name of the grid or of the attribute with the facet tags. Required if the file
            has several facet tags, unless exactly one has the name ``gmsh:physical``.
        cell_tags: Name of the grid or of the attribute with the cell tags.
        facet_file: XDMF file of the facet tags, if they are not in ``path``.

    Raises:
        MeshError: A file is missing or cannot be read. A mesh, tags or a group are not in the
            file. A joint facet does not have one cell on each side.
    """
    joints, groups, cell_groups = joints or {}, groups or {}, cell_groups or {}
    all_groups = _checked_groups(joints, groups, cell_groups, True, True)

    def prepare_mesh() -> PreparedMesh:
        body = XdmfGrids(Path(path))
        faces = body if facet_file is None else XdmfGrids(Path(facet_file))
        raw = body.mesh(faces, all_groups, cell_groups, (mesh, facet_tags, cell_tags))
        return prepare(raw, list(joints))

    return distribute(comm, prepare_mesh)


def _checked_groups(
    joints: Any, groups: Any, cell_groups: Any, facet_tags: Any, cell_tags: Any
) -> dict[str, Any]:
    """Check the groups, and return boundary groups and joints together."""
    for argument, given, tags in (
        ("joints", joints, facet_tags),
        ("groups", groups, facet_tags),
        ("cell_groups", cell_groups, cell_tags),
    ):
        check_named(argument, given, "a tag by name")
        for name, tag in given.items() if tags is not None else ():
            check_count(f"The tag of {shown(name)}", tag, 0, "it must be a whole number")
    both = sorted(set(joints) & set(groups))
    tags_of_groups = list(groups.values()) if facet_tags is not None else []
    shared = [tag for tag in joints.values() if tag in tags_of_groups]
    if both or shared:
        subject = f"The name {both[0]!r}" if both else f"The tag {shared[0]}"
        raise MeshError(f"{subject} is given for a joint and for a group; use it for only one.")
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
    """Split a mesh given as arrays on rank 0 (collective).

    Args:
        comm: MPI communicator of the mesh.
        cell: ``triangle``, ``quadrilateral``, ``tetrahedron`` or ``hexahedron``.
        x: Node coordinates, shape (nodes, 2) in 2-D or (nodes, 3) in 3-D, [m].
        cells: Nodes of each cell in the order of DOLFINx (basix), shape (cells, nodes of a cell).
            Cells have 3, 4, 4 or 8 nodes (degree 1), or 6, 9, 10 or 27 (degree 2, curved). Convert
            from the order of Gmsh, VTK and Abaqus by ``cells[:, [0, 1, 3, 2]]`` for quadrilaterals
            and ``cells[:, [0, 1, 3, 2, 4, 5, 7, 6]]`` for hexahedra.
        facet_groups: Vertices of the facets of each group, including joints as in `read_msh`, in
            any order, shape (n, vertices of a facet).
        cell_groups: Cell numbers of each group, shape (n,).
        joints: Names of the joints. The default is all facet groups whose name begins with
            ``joint`` in lower or upper case.

    Raises:
        MeshError: An array has the wrong shape or invalid numbers. Nodes of cells are in the wrong
            order. A joint facet does not have one cell on each side.

    Example:
        >>> from mpi4py import MPI
        >>> import numpy as np
        >>> import dolfinx_joints as dj
        >>> x = np.array([[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]])  # two squares [m]
        >>> cells = np.array([[0, 1, 3, 4], [1, 2, 4, 5]])
        >>> groups = {"base": np.array([[0, 1], [1, 2]]), "joint": np.array([[1, 4]])}
        >>> mesh = dj.mesh_from_arrays(
        ...     MPI.COMM_WORLD, cell="quadrilateral", x=x, cells=cells, facet_groups=groups
        ... )
        >>> len(mesh.mesh.geometry.x)  # nodes 1 and 4 are duplicated
        8
    """

    def prepare_mesh() -> PreparedMesh:
        raw = mesh_of_arrays(cell, x, cells, facet_groups or {}, cell_groups or {})
        return prepare(raw, joints)

    return distribute(comm, prepare_mesh)
