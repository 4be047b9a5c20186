# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values of a model at points, boundary and joints, on any number of ranks."""

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

# Of the size of the cells there: a node farther from its point is told of.
FAR = 0.1


@dataclass(frozen=True)
@checked
class Probe:
    """A monitored point, and the group whose nodes count.

        points = {"crest": (0.0, 4.0, 100.0), "beside the joint": Probe(place, group="joint_2+")}

    Attributes:
        place: Coordinates [m].
        group: Name of a cell group, a facet group or a side of a joint, which the node must belong
            to; any node unless given.
    """

    place: Annotated[Sequence[float], at.MinLen(2), at.MaxLen(3), at.Unit("m")]
    group: str | None = None


def checked_points(points: Any) -> dict[str, Probe]:
    """Monitor points by name."""
    named = isinstance(points, Mapping) and all(isinstance(n, str) and n for n in points)
    check_kind_of(
        "points", points, named and len(points) > 0, "coordinates by name of one or more points"
    )
    return {name: _probe(f"The point {shown(name)}", given) for name, given in points.items()}


def _probe(name: str, given: Any) -> Probe:
    place = given.place if isinstance(given, Probe) else given
    numbers = tuple(float(x) for x in check_vector(name, place, (2, 3)))
    return Probe(numbers, given.group if isinstance(given, Probe) else None)


def boundary_facets(
    model: Model, nodes: NodeNumbering, facets: NDArray[np.int32] | None = None
) -> Ints:
    """Vertices of exterior facets, of all unless given by their local numbers (collective).

    Node numbers, shape (num_facets, vertices per facet), in cyclic order, facets in rising order.
    Both sides of the joints are among them. The normals of that order, `facet_normals`, point out
    of the body. A rank has the facets whose first vertex is dealt to it.
    """
    mesh = model.jointed.mesh
    chosen = exterior_facet_indices(mesh.topology) if facets is None else facets
    cells, local = facet_slots(mesh, chosen)
    return sorted_rows(mesh.comm, nodes.blocks, facets_of_cells(model, nodes, cells, local))


def facets_of_cells(
    model: Model, nodes: NodeNumbering, cells: NDArray[Any], local: NDArray[Any]
) -> Ints:
    """Vertices of a facet of each local cell, node numbers, shape (n, vertices per facet).

    They are in cyclic order, normals pointing out of the cells.
    """
    shape = model.jointed.shape
    corners = shape.facet_vertices[local][:, shape.facet_cycle]
    of_cells = model.V.dofmap.list[cells]
    vertices = np.take_along_axis(of_cells, corners, axis=1)
    x = model.V.tabulate_dof_coordinates()[:, : model.gdim]
    outward = x[vertices].mean(axis=1) - x[of_cells].mean(axis=1)
    inside_out = np.einsum("ij,ij->i", facet_normals(x[vertices]), outward) < 0.0
    return nodes.number[np.where(inside_out[:, None], vertices[:, ::-1], vertices)]


class PointProbe:
    """Reads nodal vectors at the nodes nearest to given points.

    Where several nodes share the place (on a joint), the first of the mesh file's order is taken,
    on any number of ranks.

    Args:
        model: The model.
        points: Coordinates, shape (n, gdim), [m], or a `Probe` each.
        nodes: Numbers the nodes.

    Attributes:
        positions: Coordinates of the nodes found, shape (n, 3), [m].
        sides: Sides of joints that each node belongs to, none where no other node is there.
        moved: Where each point went if its node is far from it or one of several, else empty.

    Raises:
        MeshError: A point is far from the body, or has not all coordinates.
    """

    def __init__(
        self, model: Model, points: Sequence[Sequence[float] | Probe], nodes: NodeNumbering
    ) -> None:
        """Find the nodes (collective)."""
        self._comm, self._gdim = model.jointed.mesh.comm, model.gdim
        self._mine: list[tuple[int, int]] = []
        self.positions = np.zeros((len(points), 3))
        self.sides: list[tuple[str, ...]] = []
        self.moved: list[str] = []
        for row, point in enumerate(points):
            probe = point if isinstance(point, Probe) else Probe(tuple(point))
            self._find(model, row, probe, nodes)

    def _find(self, model: Model, row: int, probe: Probe, nodes: NodeNumbering) -> None:
        """Find the node of a point (collective)."""
        jointed, V = model.jointed, model.V
        distance, near = nearest_nodes(jointed, V, probe.place, probe.group)
        place = f"({', '.join(f'{x:g}' for x in probe.place)})"
        if not distance <= 0.1 * extent(V):
            raise MeshError(f"Monitor point {place} lies {distance:.3g} m from the nearest node.")
        found = {int(nodes.number[node]): int(node) for node in near}
        every = [number for numbers in self._comm.allgather(list(found)) for number in numbers]
        mine = found.get(min(every))
        x = None if mine is None else V.tabulate_dof_coordinates()[mine]
        there = next(each for each in self._comm.allgather(x) if each is not None)
        self.positions[row] = there
        if mine is not None:
            self._mine.append((row, mine))
        copies = sum(self._comm.allgather(len(nearest_nodes(jointed, V, there)[1])))
        self.sides.append(sides_at(jointed, V, mine) if copies > 1 else ())
        size = cell_size(V, np.flatnonzero(nodes.number == min(every)))
        texts = []
        if distance > FAR * size:
            at_node = as_text(there, V)
            texts.append(f"at the node {at_node}, {distance:.3g} m away (cells: {size:.3g} m)")
        if len(every) > 1 and self.sides[-1]:
            which = " and ".join(self.sides[-1])
            texts.append(f"on the side {which}, as dj.Probe(place, group=...) does not say which")
        self.moved.append(f"{place} is read {', and '.join(texts)}" if texts else "")

    def read(self, u: PETSc.Vec) -> Floats:
        """Nodal vectors of the points, shape (n, 3), on every rank (collective)."""
        values = np.zeros((len(self.positions), 3))
        blocks = u.getArray(readonly=True).reshape(-1, self._gdim)
        for row, node in self._mine:
            values[row, : self._gdim] = blocks[node]
        return summed(self._comm, values)
