# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Model values at points, boundary and joints, on any number of ranks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import annotated_types as at
import numpy as np
from dolfinx.mesh import exterior_facet_indices
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.body.places import as_text, cell_size, extent, nearest_nodes, sides_at
from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.mpi import sorted_rows, summed
from dolfinx_joints.common.parameters import check_kind_of, check_vector, shown
from dolfinx_joints.mesh.cells import facet_slots
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.mesh.orientation import facet_normals
from dolfinx_joints.model.model import Model

# Largest distance of a node from its monitor point without a warning, divided by the cell size.
FAR = 0.1


@dataclass(frozen=True)
@checked
class Probe:
    """Monitored point, optionally limited to the nodes of one group.

        points = {"crest": (0.0, 4.0, 100.0), "at the joint": Probe(place, group="joint_2+")}

    Attributes:
        place: Coordinates [m].
        group: Name of a cell group, a facet group or a side of a joint that the node must belong
            to; any node by default.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=20e9, poisson=0.0, density=2400.0)
        >>> law = dj.frictionless(normal_stiffness=1e9)
        >>> base = [dj.Fixed(group="base")]
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=base, loads=[dj.Gravity()])
        >>> sides = {side: dj.Probe((0.5, 0.5, 1.0), group=f"joint_1{side}") for side in "-+"}
        >>> monitor = dj.ResultsMonitor("blocks.h5", points=sides)
        >>> state = dj.Simulation(model, monitors=[monitor]).statics()
        >>> below, above = dj.Results("blocks.h5").series("statics", "point_displacement")[0, :, 2]
        >>> round(float(above - below), 9)  # overlap by the weight of the upper block / k_n [m]
        -2.3536e-05
    """

    place: Annotated[Sequence[float], at.MinLen(2), at.MaxLen(3), at.Unit("m")]
    group: str | None = None


def check_points(points: Any) -> dict[str, Probe]:
    """Check monitor points and return them by name."""
    named = isinstance(points, Mapping) and all(isinstance(n, str) and n for n in points)
    check_kind_of(
        "points", points, named and len(points) > 0, "coordinates by name of one or more points"
    )
    return {name: _probe(f"The point {shown(name)}", point) for name, point in points.items()}


def _probe(name: str, point: Any) -> Probe:
    place = point.place if isinstance(point, Probe) else point
    numbers = tuple(float(x) for x in check_vector(name, place, (2, 3)))
    return Probe(numbers, point.group if isinstance(point, Probe) else None)


def boundary_facets(
    model: Model, nodes: NodeNumbering, facets: NDArray[np.int32] | None = None
) -> Ints:
    """Return the vertices of exterior facets: all, or the given local facets (collective).

    The result contains node numbers, shape (num_facets, vertices per facet), in cyclic order with
    outward normals (`facet_normals`); facets are ascending. Both sides of joints are included. Each
    facet is on the rank whose node block contains the first vertex of the facet.
    """
    mesh = model.jointed.mesh
    chosen = exterior_facet_indices(mesh.topology) if facets is None else facets
    cells, local = facet_slots(mesh, chosen)
    return sorted_rows(mesh.comm, nodes.blocks, facets_of_cells(model, nodes, cells, local))


def facets_of_cells(
    model: Model, nodes: NodeNumbering, cells: NDArray[Any], local: NDArray[Any]
) -> Ints:
    """Return the vertices of one facet of each local cell, shape (n, vertices per facet).

    The node numbers are in cyclic order, with normals out of the cells.
    """
    shape = model.jointed.shape
    corners = shape.facet_vertices[local][:, shape.facet_cycle]
    cell_nodes = model.V.dofmap.list[cells]
    vertices = np.take_along_axis(cell_nodes, corners, axis=1)
    x = model.V.tabulate_dof_coordinates()[:, : model.gdim]
    outward = x[vertices].mean(axis=1) - x[cell_nodes].mean(axis=1)
    inward = np.einsum("ij,ij->i", facet_normals(x[vertices]), outward) < 0.0
    return nodes.number[np.where(inward[:, None], vertices[:, ::-1], vertices)]


class PointProbe:
    """Reads nodal vectors at the nodes nearest to given points.

    If several nodes have the same position, as on a joint, the first node in the mesh file is used,
    for any number of ranks.

    Args:
        model: The model.
        points: Coordinates, shape (n, gdim), [m], or a `Probe` for each point.
        nodes: Node numbering.

    Attributes:
        positions: Coordinates of the selected nodes, shape (n, 3), [m].
        sides: Joint sides of each node; empty if no other node has the same position.
        dofs: Dofs of this rank's points, shape (local points, gdim).
        notes: Text on the node of each point if the node is far away or one of several, else "".

    Raises:
        MeshError: A point is far from the body, or lacks a coordinate.
    """

    def __init__(
        self, model: Model, points: Sequence[Sequence[float] | Probe], nodes: NodeNumbering
    ) -> None:
        """Find the nodes (collective)."""
        self._comm, self._gdim = model.jointed.mesh.comm, model.gdim
        local: list[tuple[int, int]] = []
        self.positions = np.zeros((len(points), 3))
        self.sides: list[tuple[str, ...]] = []
        self.notes: list[str] = []
        for row, point in enumerate(points):
            probe = point if isinstance(point, Probe) else Probe(tuple(point))
            node = self._find(model, row, probe, nodes)
            local += [] if node is None else [(row, node)]
        self._rows, nodes_here = np.array(local, dtype=np.int64).reshape(-1, 2).T
        self.dofs: Ints = self._gdim * nodes_here[:, None] + np.arange(self._gdim)

    def _find(self, model: Model, row: int, probe: Probe, nodes: NodeNumbering) -> int | None:
        """Find the node for a point; return its local number if this rank owns it (collective)."""
        jointed, V = model.jointed, model.V
        distance, near = nearest_nodes(jointed, V, probe.place, probe.group)
        place = f"({', '.join(f'{x:g}' for x in probe.place)})"
        if not distance <= 0.1 * extent(V):
            raise MeshError(f"Monitor point {place} is {distance:.3g} m from the nearest node.")
        candidates = {int(nodes.number[node]): int(node) for node in near}
        numbers = [n for ranks in self._comm.allgather(list(candidates)) for n in ranks]
        local = candidates.get(min(numbers))
        x = None if local is None else V.tabulate_dof_coordinates()[local]
        position = next(part for part in self._comm.allgather(x) if part is not None)
        self.positions[row] = position
        copies = sum(self._comm.allgather(len(nearest_nodes(jointed, V, position)[1])))
        self.sides.append(sides_at(jointed, V, local) if copies > 1 else ())
        size = cell_size(V, np.flatnonzero(nodes.number == min(numbers)))
        texts = []
        if distance > FAR * size:
            at_node = as_text(position, V)
            texts.append(f"at the node {at_node}, {distance:.3g} m away (cells: {size:.3g} m)")
        if len(numbers) > 1 and self.sides[-1]:
            side = " and ".join(self.sides[-1])
            texts.append(f"on the side {side}; select a side with dj.Probe(place, group=...)")
        self.notes.append(f"{place} is read {', and '.join(texts)}" if texts else "")
        return local

    def read(self, u: PETSc.Vec) -> Floats:
        """Return the nodal vectors at the points, shape (n, 3), on every rank (collective)."""
        return self.of_all_ranks(self.local(u)[None])[0]

    def local(self, u: PETSc.Vec) -> Floats:
        """Return a copy of the nodal vectors at this rank's points, shape (local points, gdim)."""
        values: Floats = u.getArray(readonly=True).take(self.dofs)
        return values

    def add(self, u: PETSc.Vec, row: int, values: Floats) -> None:
        """Add values (3,) to the nodal vector at a point; transposed of `read`."""
        dofs = self.dofs[self._rows == row]
        u.getArray()[dofs] += values[: self._gdim]

    def of_all_ranks(self, steps: Floats) -> Floats:
        """Return the vectors of all points, (steps, n, 3), from `local` of steps (collective)."""
        values = np.zeros((len(steps), len(self.positions), 3))
        values[:, self._rows, : self._gdim] = steps
        return summed(self._comm, values)
