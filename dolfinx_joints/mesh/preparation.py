# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Splitting of a mesh with named groups into cells, facet pairs and tags, on rank 0."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from difflib import get_close_matches

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Flags
from dolfinx_joints.common.errors import MeshError, warn
from dolfinx_joints.common.parameters import PLAIN_NAMES, is_plain_name, shown
from dolfinx_joints.mesh.cells import CellShape, Floats, Ints, RawMesh, find_facets
from dolfinx_joints.mesh.distribution.shares import PreparedMesh, glued
from dolfinx_joints.mesh.joint_pairs import JointPairs, fixed_axes
from dolfinx_joints.mesh.orientation import facet_normals
from dolfinx_joints.mesh.splitting import SplitMesh, pair_coincident, split_cells


def prepare(raw: RawMesh, joints: list[str] | None) -> PreparedMesh:
    """Split a mesh on rank 0 and tag its groups."""
    names, duplicated = joint_names(raw, joints)
    check_names(raw.facet_groups)
    slots: dict[str, Ints] = {}
    for name, vertices in raw.facet_groups.items():
        owner, count = find_facets(raw.shape, raw.cells, vertices)
        if np.any(count == 0):
            raise MeshError(
                f"Group {name!r}: {np.count_nonzero(count == 0)} of its facets belong to no cell."
            )
        if joints is None and np.any(count == 2):
            _warn_of_misspelt(raw, name, names)
        slots[name] = owner[owner[:, :, 0] >= 0]  # twice for facets on a joint, once per side
    if duplicated or not names:
        split = pair_coincident(raw.shape, raw.cells, raw.x, names, slots)
    else:
        split = split_cells(raw.shape, raw.cells, raw.x, [(n, raw.facet_groups[n]) for n in names])
    x = raw.x[split.parent]
    pairs = _pair_table(raw.shape, x, names, split, duplicated)
    for i, name in enumerate(names):
        of_joint = pairs.joint == i
        slots.pop(name, None)
        slots[f"{name}-"], slots[f"{name}+"] = pairs.minus[of_joint], pairs.plus[of_joint]
    facets, tags, facet_groups = tag_sets(*members(slots))
    facet_values = np.zeros((len(split.cells), len(raw.shape.facet_vertices)), dtype=np.int32)
    facet_values[facets[:, 0], facets[:, 1]] = tags
    chosen = {name: cells[:, None] for name, cells in raw.cell_groups.items()}
    tagged, tags, cell_groups = tag_sets(*members(chosen))
    cell_values = np.zeros(len(split.cells), dtype=np.int32)
    cell_values[tagged[:, 0]] = tags
    return PreparedMesh(
        shape=raw.shape,
        cells=split.cells,
        x=x,
        glued=glued(pairs, 0, len(x)),
        pairs=pairs,
        facet_values=facet_values,
        facet_groups=facet_groups,
        cell_values=cell_values,
        cell_groups=cell_groups,
    )


def check_names(facet_groups: Iterable[str]) -> None:
    """Check facet group names, which become paths in results files."""
    for name in facet_groups:
        if not is_plain_name(name):
            raise MeshError(
                f"The facet group name {shown(name)} cannot be used in results files; names must "
                f"be {PLAIN_NAMES}."
            )


def joint_names(raw: RawMesh, joints: list[str] | None) -> tuple[list[str], bool]:
    """Return the joint names, and True if the mesh already has duplicated joint faces."""
    listed = isinstance(joints, list | tuple) and all(isinstance(name, str) for name in joints)
    if joints is not None and not listed:
        raise MeshError(f"joints is {shown(joints)}; it must be a list of names.")
    groups = raw.facet_groups
    whole = {name.rstrip("+-") for name in groups if name[-1:] in "+-"}
    if joints is None:
        joints = sorted(
            {name for name in (*groups, *whole) if name.lower().startswith("joint")}
            - {name for name in groups if name[-1:] in "+-"},
            key=lambda name: (len(name), name),
        )
    doubled = [name for name in joints if f"{name}-" in groups and f"{name}+" in groups]
    for name in joints:
        if name not in groups and name not in doubled:
            available = ", ".join(sorted(groups)) or "none"
            raise MeshError(
                f"The mesh has no joint {shown(name)}: neither a surface group of that name nor "
                f"a pair of groups NAME- and NAME+; its surface groups are: {available}."
            )
    if doubled and len(doubled) != len(joints):
        raise MeshError(
            f"The mesh has joints with duplicated faces ({', '.join(doubled)}) and joints to be "
            "split; define all joints in the same way."
        )
    return joints, bool(doubled)


def _warn_of_misspelt(raw: RawMesh, name: str, joints: list[str]) -> None:
    """Warn of a facet group inside the body whose name resembles a joint name."""
    stem, *stems = (n.rstrip("_-+.0123456789").lower() for n in (name, "joint", *joints))
    on_joints = [raw.facet_groups[n].ravel() for n in joints if n in raw.facet_groups]
    if name in joints or np.isin(raw.facet_groups[name], np.concatenate([[-1], *on_joints])).all():
        return
    if "joint" in stem or get_close_matches(stem, stems, cutoff=0.75):
        warn(
            f"Facets of {name!r} lie inside the body but are not a joint, because the name does "
            "not begin with 'joint'; list it in joints= if it is a joint."
        )


def _pair_table(
    shape: CellShape, x: Floats, names: list[str], split: SplitMesh, duplicated: bool
) -> JointPairs:
    cells, minus, plus = split.cells, split.minus, split.plus
    cycle = cells[minus[:, :1], shape.facet_vertices[minus[:, 1]][:, shape.facet_cycle]]
    corners = int(shape.facet_vertices.max()) + 1
    inward = x[cells[minus[:, 0], :corners]].mean(axis=1) - x[cycle].mean(axis=1)
    plus_vertices = cells[plus[:, :1], shape.facet_vertices[plus[:, 1]]]
    outward = np.einsum("ij,ij->i", facet_normals(x[cycle]), inward) < 0
    pairs = JointPairs(
        names=tuple(names),
        count=len(minus),
        axes=(),
        number=np.arange(len(minus)),
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
    return replace(pairs, axes=tuple(fixed_axes(pairs, shape)))


def tag_sets(
    entities: Ints,
    group: Ints,
    names: Iterable[str],
    of_all: Callable[[Flags], Flags] = lambda member: member,
) -> tuple[Ints, NDArray[np.int32], dict[str, tuple[int, ...]]]:
    """Return the distinct entities, their tags, and the tags of each group.

    DOLFINx allows one tag per entity. Groups may overlap, so each combination of groups has a tag.
    ``entities`` has one row per membership, ``group`` the position of the row's group in ``names``.
    ``of_all`` gathers the combinations of all ranks.
    """
    names = tuple(names)
    if not names:
        return entities[:0], np.empty(0, dtype=np.int32), {}
    distinct, inverse = np.unique(entities, axis=0, return_inverse=True)
    member = np.zeros((len(distinct), len(names)), dtype=bool)
    member[inverse.ravel(), group] = True
    combinations, combination = np.unique(member, axis=0, return_inverse=True)
    sets = np.unique(of_all(combinations), axis=0)
    values = np.unique(np.vstack([sets, combinations]), axis=0, return_inverse=True)[1].ravel()
    tags = {
        name: tuple(int(t) + 1 for t in np.flatnonzero(sets[:, i])) for i, name in enumerate(names)
    }
    return distinct, (values[len(sets) :][combination.ravel()] + 1).astype(np.int32), tags


def members(slots: Mapping[str, Ints]) -> tuple[Ints, Ints, Iterable[str]]:
    """Return the arguments of `tag_sets` for the rows of each group."""
    if not slots:
        return np.empty((0, 2), dtype=np.int64), np.empty(0, dtype=np.int64), ()
    group = np.repeat(np.arange(len(slots)), [len(s) for s in slots.values()])
    return np.vstack(list(slots.values())), group, slots
