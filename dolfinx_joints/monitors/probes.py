# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values of a model at points, boundary and joints, on any number of ranks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.parameters import check_kind_of, check_vector, shown
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model

Floats = NDArray[np.float64]


def checked_points(points: Any) -> dict[str, tuple[float, ...]]:
    """Monitor points by name."""
    named = isinstance(points, Mapping) and all(isinstance(n, str) and n for n in points)
    check_kind_of(
        "points", points, named and len(points) > 0, "coordinates by name of one or more points"
    )
    places = (check_vector(f"The point {shown(n)}", p, (2, 3)) for n, p in points.items())
    return {n: tuple(float(x) for x in place) for n, place in zip(points, places, strict=True)}


def boundary_facets(
    model: Model,
    nodes: NodeNumbering,
    *,
    without: NDArray[np.int32] | None = None,
    only: NDArray[np.int32] | None = None,
) -> NDArray[np.int64]:
    """Vertices of all exterior facets in cyclic order, on every rank (collective).

    Both sides of the joints are among them.

    Args:
        model: The model.
        nodes: Numbers the nodes.
        without: Local numbers of facets to leave out.
        only: Local numbers of facets, of which the exterior ones are taken; all unless given.

    Returns:
        Node numbers, shape (num_facets, vertices per facet).
    """
    from dolfinx.cpp.mesh import cell_num_entities
    from dolfinx.mesh import exterior_facet_indices

    mesh, shape = model.jointed.mesh, model.jointed.shape
    tdim = mesh.topology.dim
    mesh.topology.create_connectivity(tdim - 1, tdim)
    mesh.topology.create_connectivity(tdim, tdim - 1)
    facets = exterior_facet_indices(mesh.topology)
    if without is not None:
        facets = np.setdiff1d(facets, without)
    if only is not None:
        facets = np.intersect1d(facets, only)
    to_cell = mesh.topology.connectivity(tdim - 1, tdim)
    to_facet = mesh.topology.connectivity(tdim, tdim - 1)
    cells = to_cell.array[to_cell.offsets[facets]]
    per_cell = to_facet.array.reshape(  # a rank may have no cells
        -1, cell_num_entities(mesh.topology.cell_type, tdim - 1)
    )
    local = np.argmax(per_cell[cells] == facets[:, None], axis=1)
    corners = shape.facet_vertices[local][:, shape.facet_cycle]
    vertices = nodes.number[np.take_along_axis(model.V.dofmap.list[cells], corners, axis=1)]
    every = np.concatenate(mesh.comm.allgather(vertices))
    return every[np.lexsort(every.T[::-1])]


class PointProbe:
    """Reads nodal vectors at the nodes nearest to given points.

    Where several nodes share the place (on a joint), the first of the mesh file's order is taken,
    on any number of ranks.

    Args:
        model: The model.
        points: Coordinates, shape (n, gdim), [m].
        nodes: Numbers the nodes.

    Attributes:
        positions: Coordinates of the nodes found, shape (n, 3), [m].
    """

    def __init__(
        self, model: Model, points: Sequence[Sequence[float]], nodes: NodeNumbering
    ) -> None:
        """Find the nodes (collective)."""
        self._comm, self._gdim = model.jointed.mesh.comm, model.gdim
        owned = model.V.dofmap.index_map.size_local
        x = model.V.tabulate_dof_coordinates()[:owned]
        self._mine: list[tuple[int, int]] = []
        boxes = self._comm.allgather((x.min(axis=0), x.max(axis=0)) if owned else None)
        lowest, highest = zip(*(box for box in boxes if box is not None), strict=True)
        extent = float((np.max(highest, axis=0) - np.min(lowest, axis=0)).max())
        positions = []
        for row, point in enumerate(points):
            if len(point) < self._gdim:
                raise MeshError(
                    f"Monitor point {tuple(point)} has {len(point)} coordinates; the mesh has "
                    f"{self._gdim}."
                )
            wanted = np.zeros(3)
            wanted[: len(point)] = point
            distance = extent * np.round(np.linalg.norm(x - wanted, axis=1) / extent, 9)
            found = (np.inf, 0, -1, (0.0, 0.0, 0.0))
            if owned:
                near = int(np.lexsort((nodes.number[:owned], distance))[0])
                found = (float(distance[near]), int(nodes.number[near]), near, tuple(x[near]))
            ranked = self._comm.allgather(found)
            owner = min(range(len(ranked)), key=lambda rank: ranked[rank][:2])
            if not ranked[owner][0] <= 0.1 * extent:
                raise MeshError(
                    f"Monitor point {tuple(point)} lies {ranked[owner][0]:.3g} m from the nearest "
                    "node."
                )
            positions.append(ranked[owner][3])
            if owner == self._comm.rank:
                self._mine.append((row, ranked[owner][2]))
        self.positions = np.array(positions).reshape(-1, 3)

    def read(self, u: PETSc.Vec) -> Floats:
        """Nodal vectors of the points, shape (n, 3), on every rank (collective)."""
        values = np.zeros((len(self.positions), 3))
        blocks = u.getArray(readonly=True).reshape(-1, self._gdim)
        for row, node in self._mine:
            values[row, : self._gdim] = blocks[node]
        return np.asarray(self._comm.allreduce(values))


def joint_facet_points(operator: Any) -> dict[str, tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Points and facet numbers of each joint, facet by facet."""
    layout, found = operator.layout, {}
    joint_of_facet = layout.joint[layout.number[:, 0]]
    for i, name in enumerate(operator.names):
        numbers = layout.number[joint_of_facet == i]
        found[name] = (numbers.ravel(), np.repeat(np.arange(len(numbers)), numbers.shape[1]))
    return found


def joint_statics(model: Model) -> dict[str, dict[str, NDArray[Any]]]:
    """Arrays that `declare_states` wants of each joint."""
    if model.operator is None:
        return {}
    layout, arrays = model.operator.layout, {}
    shares = layout.share * layout.areas[layout.number]
    joint_of_facet = layout.joint[layout.number[:, 0]]
    for i, (name, (points, facet)) in enumerate(joint_facet_points(model.operator).items()):
        arrays[name] = {
            "points": layout.points[points],
            "frames": layout.frames[points],
            "areas": shares[joint_of_facet == i].ravel(),
            "facet": facet,
        }
    return arrays
