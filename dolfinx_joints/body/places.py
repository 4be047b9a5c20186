# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nodes of a space in a named group or near a point."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from dolfinx import fem, la
from dolfinx.fem import FunctionSpace
from numpy.typing import NDArray

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.mesh.cells import Ints
from dolfinx_joints.mesh.jointed_mesh import JointedMesh

# Nodes coincide if their distance divided by the extent of the mesh is below this value.
SAME_PLACE = 1e-9

# Largest distance of a given point from its node, divided by the extent of the mesh.
NO_NODE = 1e-6


def nodes_of_facets(jointed: JointedMesh, V: FunctionSpace, group: str) -> Ints:
    """Return owned nodes of a facet group or joint side, local numbers (collective)."""
    facets = jointed.facets(group)
    nodes = fem.locate_dofs_topological(V, jointed.mesh.topology.dim - 1, facets)
    return nodes[nodes < V.dofmap.index_map.size_local].astype(np.int64)


def nodes_of_group(jointed: JointedMesh, V: FunctionSpace, group: str) -> Ints:
    """Return owned nodes of a cell group, facet group or joint side (collective)."""
    if group not in jointed.cell_groups:
        return nodes_of_facets(jointed, V, group)
    marks = la.vector(V.dofmap.index_map)
    marks.array[:] = 0.0
    marks.array[V.dofmap.list[jointed.cells(group)].ravel()] = 1.0
    marks.scatter_reverse(la.InsertMode.add)  # other ranks may have the cells of an owned node
    return np.flatnonzero(marks.array[: V.dofmap.index_map.size_local])


def nearest_nodes(
    jointed: JointedMesh, V: FunctionSpace, point: Sequence[float], group: str | None = None
) -> tuple[float, Ints]:
    """Return the nodes nearest to a point: distance [m] and owned nearest nodes (collective).

    The point has as many coordinates as the mesh, or three, [m]. On a joint several nodes may be
    nearest. If ``group`` is given, only nodes of this group or joint side are considered.
    """
    gdim, owned = jointed.mesh.geometry.dim, V.dofmap.index_map.size_local
    if len(point) < gdim:
        raise MeshError(
            f"The point {shown(tuple(point))} has {len(point)} coordinates; give {gdim}."
        )
    x = V.tabulate_dof_coordinates()[:owned]
    candidates = np.arange(owned) if group is None else nodes_of_group(jointed, V, group)
    target = np.zeros(3)
    target[: len(point)] = point
    distance = np.linalg.norm(x[candidates] - target, axis=1)
    smallest = min(jointed.mesh.comm.allgather(float(distance.min(initial=np.inf))))
    return smallest, candidates[distance <= smallest + SAME_PLACE * extent(V)]


def node_at(
    jointed: JointedMesh,
    V: FunctionSpace,
    label: str,
    point: Sequence[float],
    group: str | None = None,
    *,
    remedy: str,
) -> Ints:
    """Return the node at a point, shape (1,), or (0,) if not owned (collective).

    Raises:
        MeshError: ``label`` has no node at the point, or several, for which ``remedy`` is given.
    """
    distance, nodes = nearest_nodes(jointed, V, point, group)
    own_nodes = [x.tolist() for x in V.tabulate_dof_coordinates()[nodes]]
    all_nodes = [x for part in jointed.mesh.comm.allgather(own_nodes) for x in part]
    if not distance <= NO_NODE * extent(V):
        near = as_text(all_nodes[0], V) if all_nodes else "none"
        raise MeshError(f"{label} has no node there; the nearest is {near}, at {distance:.3g} m.")
    if len(all_nodes) > 1:
        count = len(all_nodes)
        raise MeshError(f"{label} has {count} nodes there, on both sides of a joint; {remedy}.")
    return nodes


def extent(V: FunctionSpace) -> float:
    """Return the largest extent of the mesh along an axis [m] (collective)."""
    x = V.tabulate_dof_coordinates()[: V.dofmap.index_map.size_local]
    boxes = V.mesh.comm.allgather((x.min(axis=0), x.max(axis=0)) if len(x) else None)
    lowest, highest = zip(*(box for box in boxes if box is not None), strict=True)
    return float((np.max(highest, axis=0) - np.min(lowest, axis=0)).max())


def as_text(place: Sequence[float], V: FunctionSpace) -> str:
    """Return coordinates as text, without rounding errors (collective)."""
    size = extent(V)
    exact = size * np.round(np.asarray(place) / size, 9) + 0.0
    return f"({', '.join(f'{x:.6g}' for x in exact[: V.mesh.geometry.dim])})"


def cell_size(V: FunctionSpace, nodes: NDArray[np.int64]) -> float:
    """Return the diameter of the largest cell at local nodes, with ghosts, [m] (collective)."""
    mesh = V.mesh
    cells = np.flatnonzero(np.isin(V.dofmap.list, nodes).any(axis=1)).astype(np.int32)
    largest = mesh.h(mesh.topology.dim, cells).max(initial=0.0) if len(cells) else 0.0
    return max(mesh.comm.allgather(float(largest)))


def sides_at(jointed: JointedMesh, V: FunctionSpace, node: int | None) -> tuple[str, ...]:
    """Return the joint sides that contain a node; pass None on ranks not owning it (collective)."""
    sides = [f"{name}{sign}" for name in jointed.joint_names for sign in "-+"]
    nodes = {side: nodes_of_facets(jointed, V, side) for side in sides}
    local_sides = [side for side in sides if node is not None and node in nodes[side]]
    return tuple(name for names in jointed.mesh.comm.allgather(local_sides) for name in names)
