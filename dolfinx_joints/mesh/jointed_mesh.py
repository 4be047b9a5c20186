# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes with named groups whose nodes are duplicated across the joints.

After splitting, the two sides of a joint are ordinary exterior facets of an ordinary DOLFINx mesh:
any function space, form or writer works on it. What ties the sides together is `JointPairs`, a
table kept on every rank.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import basix.ufl
import dolfinx.mesh
import numpy as np
import ufl
from numpy.typing import NDArray

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.common.parameters import check_count, check_kind_of, check_path, shown
from dolfinx_joints.mesh import dolfinx_versions
from dolfinx_joints.mesh.cells import CellShape, Floats, Ints, find_facets
from dolfinx_joints.mesh.gather import gather_mesh
from dolfinx_joints.mesh.gmsh_file import RawMesh, load_msh
from dolfinx_joints.mesh.orientation import facet_normals
from dolfinx_joints.mesh.splitting import SplitMesh, pair_coincident, split_cells


@dataclass(frozen=True, kw_only=True)
class JointPairs:
    """Facet pairs of all joints, the same table on every rank.

    Attributes:
        names: Joint names.
        joint: Joint number of each pair, ascending, shape (num_pairs,).
        minus: Input cell number and local facet on the - side, shape (num_pairs, 2).
        plus: The same on the + side.
        match: Position among the vertices of the + facet of the partner of each vertex of the
            - facet, shape (num_pairs, vertices per facet).
        minus_vertices: Numbers of the vertices of the - facet, shape like ``match``.
        plus_vertices: Numbers of their partners on the + side; equal on the joint's front.
        nodes: Coordinates of the nodes of the - facet in the order of the facet's own Lagrange
            element, shape (num_pairs, nodes per facet, gdim), [m].
        sign: 1 where the normal by the vertex order of the - facet points to the + side, else -1.
        gaps_in_geometry: Whether the two faces may be apart in the mesh itself.
        bonded: Joint facets per joint that cannot open, shape (num_joints,).
    """

    names: tuple[str, ...]
    joint: Ints
    minus: Ints
    plus: Ints
    match: Ints
    minus_vertices: Ints
    plus_vertices: Ints
    nodes: Floats
    sign: Ints
    gaps_in_geometry: bool
    bonded: Ints


@dataclass(frozen=True, kw_only=True)
class JointedMesh:
    """A DOLFINx mesh split at its joints, with its groups by name.

    Attributes:
        mesh: The mesh; both sides of a joint are exterior facets of it.
        shape: Reference cell and degree of the geometry.
        cell_tags: Tags of the cells.
        facet_tags: Tags of the facets.
        cell_groups: Tags that make up each named cell group.
        facet_groups: Tags that make up each named facet group; the sides of a joint are
            ``NAME-`` and ``NAME+``.
        pairs: The facet pairs of the joints.
    """

    mesh: dolfinx.mesh.Mesh
    shape: CellShape
    cell_tags: dolfinx.mesh.MeshTags
    facet_tags: dolfinx.mesh.MeshTags
    cell_groups: Mapping[str, tuple[int, ...]]
    facet_groups: Mapping[str, tuple[int, ...]]
    pairs: JointPairs

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.pairs.names

    def facets(self, name: str) -> NDArray[np.int32]:
        """Local facets of a named group.

        Raises:
            MeshError: There is no such group.
        """
        tags = _tags_of(self.facet_groups, name, "facet")
        return self.facet_tags.indices[np.isin(self.facet_tags.values, tags)]

    def cells(self, name: str) -> NDArray[np.int32]:
        """Local cells of a named group.

        Raises:
            MeshError: There is no such group.
        """
        tags = _tags_of(self.cell_groups, name, "cell")
        return self.cell_tags.indices[np.isin(self.cell_tags.values, tags)]

    def ds(self, name: str) -> ufl.Measure:
        """Surface measure of a named group, for user-defined forms."""
        tags = _tags_of(self.facet_groups, name, "facet")
        return ufl.Measure("ds", domain=self.mesh, subdomain_data=self.facet_tags)(tags)

    def dx(self, name: str) -> ufl.Measure:
        """Volume measure of a named cell group."""
        tags = _tags_of(self.cell_groups, name, "cell")
        return ufl.Measure("dx", domain=self.mesh, subdomain_data=self.cell_tags)(tags)


def _tags_of(groups: Mapping[str, tuple[int, ...]], name: str, kind: str) -> tuple[int, ...]:
    if not isinstance(name, str) or name not in groups:
        known = ", ".join(sorted(groups)) or "none"
        raise MeshError(
            f"The mesh has no {kind} group {shown(name)}; its {kind} groups are: {known}."
        )
    return groups[name]


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
    return _distribute(comm, lambda: _prepare(load_msh(Path(path)), joints))


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
    return _distribute(mesh.comm, lambda: _prepare(raw, list(joints)))


@dataclass(frozen=True, kw_only=True)
class _Prepared:
    """The split mesh on rank 0, for `_distribute`."""

    shape: CellShape
    cells: Ints
    x: Floats
    pairs: JointPairs
    facets: Ints
    facet_values: Ints
    facet_groups: dict[str, tuple[int, ...]]
    cell_values: Ints
    cell_groups: dict[str, tuple[int, ...]]


def _prepare(raw: RawMesh, joints: list[str] | None) -> _Prepared:
    """Split a mesh on rank 0 and tag its groups."""
    listed = isinstance(joints, list | tuple) and all(isinstance(name, str) for name in joints)
    if joints is not None and not listed:
        raise MeshError(f"joints is {shown(joints)}; it must be a list of names.")
    names, duplicated = _joint_names(raw, joints)
    slots: dict[str, Ints] = {}
    for name, vertices in raw.facet_groups.items():
        owner, count = find_facets(raw.shape, raw.cells, vertices)
        if np.any(count == 0):
            raise MeshError(
                f"Group {name!r}: {np.count_nonzero(count == 0)} of its facets belong to no cell."
            )
        slots[name] = owner[:, 0]
    if duplicated or not names:
        split = pair_coincident(raw.shape, raw.cells, raw.x, names, slots)
    else:
        split = split_cells(raw.shape, raw.cells, raw.x, [(n, raw.facet_groups[n]) for n in names])
    x = raw.x[split.parent]
    pairs = _pair_table(raw.shape, x, names, split, duplicated)
    for i, name in enumerate(names):
        here = pairs.joint == i
        if pairs.bonded[i]:
            warnings.warn(
                f"Joint {name!r}: {pairs.bonded[i]} facets have all their vertices on the joint's "
                "front inside the body and stay closed; a finer mesh there lets them open.",
                stacklevel=2,
            )
        slots.pop(name, None)
        slots[f"{name}-"], slots[f"{name}+"] = pairs.minus[here], pairs.plus[here]
    facets, facet_values, facet_groups = _tag_sets(slots)
    chosen = {name: np.column_stack([c, c]) for name, c in raw.cell_groups.items()}
    tagged, tags, cell_groups = _tag_sets(chosen)
    cell_values = np.zeros(len(split.cells), dtype=np.int64)
    cell_values[tagged[:, 0]] = tags
    return _Prepared(
        shape=raw.shape,
        cells=split.cells,
        x=x,
        pairs=pairs,
        facets=facets,
        facet_values=facet_values,
        facet_groups=facet_groups,
        cell_values=cell_values,
        cell_groups=cell_groups,
    )


def _joint_names(raw: RawMesh, joints: list[str] | None) -> tuple[list[str], bool]:
    """Names of the joints, and whether their faces are already duplicated in the mesh."""
    groups = raw.facet_groups
    whole = {name.rstrip("+-") for name in groups if name[-1:] in "+-"}
    if joints is None:
        joints = sorted(
            {name for name in (*groups, *whole) if name.startswith("joint")}
            - {name for name in groups if name[-1:] in "+-"},
            key=lambda name: (len(name), name),
        )
    doubled = [name for name in joints if f"{name}-" in groups and f"{name}+" in groups]
    for name in joints:
        if name not in groups and name not in doubled:
            known = ", ".join(sorted(groups)) or "none"
            raise MeshError(
                f"The mesh has no joint {shown(name)} (neither a surface group of that name nor "
                f"the pair of its sides, - and +); its surface groups are: {known}."
            )
    if doubled and len(doubled) != len(joints):
        raise MeshError(
            f"Joints with duplicated faces ({', '.join(doubled)}) and joints to be split cannot "
            "stand in one mesh; give all of them in the same way."
        )
    return joints, bool(doubled)


def _pair_table(
    shape: CellShape, x: Floats, names: list[str], split: SplitMesh, duplicated: bool
) -> JointPairs:
    """Collect what every rank needs to know of the facet pairs."""
    cells, minus, plus = split.cells, split.minus, split.plus
    cycle = cells[minus[:, :1], shape.facet_vertices[minus[:, 1]][:, shape.facet_cycle]]
    corners = int(shape.facet_vertices.max()) + 1
    inward = x[cells[minus[:, 0], :corners]].mean(axis=1) - x[cycle].mean(axis=1)
    plus_vertices = cells[plus[:, :1], shape.facet_vertices[plus[:, 1]]]
    outward = np.einsum("ij,ij->i", facet_normals(x[cycle]), inward) < 0
    return JointPairs(
        names=tuple(names),
        joint=split.joint,
        minus=minus,
        plus=plus,
        match=split.match,
        minus_vertices=cells[minus[:, :1], shape.facet_vertices[minus[:, 1]]],
        plus_vertices=np.take_along_axis(plus_vertices, split.match, axis=1),
        nodes=x[cells[minus[:, :1], shape.facet_nodes[minus[:, 1]]]],
        sign=np.where(outward, 1, -1),
        gaps_in_geometry=duplicated,
        bonded=split.bonded,
    )


def _tag_sets(slots: dict[str, Ints]) -> tuple[Ints, Ints, dict[str, tuple[int, ...]]]:
    """Give each set of groups that some entity belongs to a tag of its own.

    Groups may overlap although a DOLFINx tag is one number per entity.
    """
    if not slots:
        return np.empty((0, 2), dtype=np.int64), np.empty(0, dtype=np.int64), {}
    entities, inverse = np.unique(np.vstack(list(slots.values())), axis=0, return_inverse=True)
    member = np.zeros((len(entities), len(slots)), dtype=bool)
    group = np.repeat(np.arange(len(slots)), [len(s) for s in slots.values()])
    member[inverse.ravel(), group] = True
    sets, values = np.unique(member, axis=0, return_inverse=True)
    tags = {
        name: tuple(int(t) + 1 for t in np.flatnonzero(sets[:, i])) for i, name in enumerate(slots)
    }
    return entities, values.ravel() + 1, tags


def _distribute(comm: Any, prepare: Any) -> JointedMesh:
    """Create the DOLFINx mesh from what rank 0 prepared, and tag its entities."""
    here: list[_Prepared] = []

    def work() -> _Prepared:
        here.append(prepare())
        return replace(here[0], cells=here[0].cells[:0], x=here[0].x[:0])

    known = on_root(comm, work)
    whole = here[0] if here else known
    element = basix.ufl.element(
        "Lagrange", known.shape.name, known.shape.degree, shape=(whole.x.shape[1],)
    )
    mesh = dolfinx_versions.create_mesh(comm, whole.cells, whole.x, element)
    mesh.name = "jointed_mesh"
    tdim, original = mesh.topology.dim, np.asarray(mesh.topology.original_cell_index)
    local, index = _local_facets(mesh, local_cells(mesh, len(known.cell_values)), known.facets)
    return JointedMesh(
        mesh=mesh,
        shape=known.shape,
        cell_tags=_tags(mesh, tdim, np.arange(len(original)), known.cell_values[original]),
        facet_tags=_tags(mesh, tdim - 1, local, known.facet_values[index]),
        cell_groups=known.cell_groups,
        facet_groups=known.facet_groups,
        pairs=known.pairs,
    )


def _tags(mesh: dolfinx.mesh.Mesh, dim: int, entities: Ints, values: Ints) -> Any:
    return dolfinx.mesh.meshtags(mesh, dim, entities.astype(np.int32), values.astype(np.int32))


def local_cells(mesh: dolfinx.mesh.Mesh, num_input_cells: int) -> NDArray[np.int32]:
    """Local number of each input cell, -1 where this rank does not hold it."""
    original = mesh.topology.original_cell_index
    local = np.full(num_input_cells, -1, dtype=np.int32)
    local[original] = np.arange(len(original), dtype=np.int32)
    return local


def _local_facets(
    mesh: dolfinx.mesh.Mesh, cell_of: NDArray[np.int32], slots: Ints
) -> tuple[Ints, Ints]:
    """Local facets of (input cell, local facet) slots, ascending, and the slots they come from."""
    tdim = mesh.topology.dim
    mesh.topology.create_entities(tdim - 1)
    mesh.topology.create_connectivity(tdim, tdim - 1)
    mesh.topology.create_connectivity(tdim - 1, tdim)
    here = np.flatnonzero(cell_of[slots[:, 0]] >= 0)
    facets_of_cell = mesh.topology.connectivity(tdim, tdim - 1).array.reshape(
        -1, len(CellShape(name=mesh.topology.cell_name(), degree=1).facet_vertices)
    )
    local = facets_of_cell[cell_of[slots[here, 0]], slots[here, 1]]
    facets, first = np.unique(local, return_index=True)
    return facets, here[first]
