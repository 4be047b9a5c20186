# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stresses at vertices from displacements, and their envelopes over a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import basix
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import exterior_facet_indices
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.sparse import coo_matrix

from dolfinx_joints.common.arrays import Dealt, Floats, Ints
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.mpi import (
    across,
    added,
    blocks_of,
    dealt,
    equal_blocks,
    lasting,
    rank_of,
    rows_at,
    sent_to,
)
from dolfinx_joints.loads.temperature.thermal_strain import Temperature
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.probes import boundary_facets
from dolfinx_joints.postprocessing.envelopes import (
    ENVELOPE_NAMES,
    PLANE_STRESS,
    STRENGTHS,
    Envelopes,
    Strength,
    face_directions,
    stage_stresses,
)

Array = NDArray[Any] | Dealt

_CHUNK = 512  # Cells evaluated at a time: 16 MB for hexahedra of degree 2.


class SurfaceStress:
    """Stresses at vertices, computed as a matrix times the displacement.

    The stress that temperatures would cause in a fully constrained body is subtracted. The stress
    at a vertex is the mean over the adjacent cells. Nodes on a joint are duplicated, so cells on
    the other side of the joint do not contribute.

    Args:
        model: The model.
        nodes: Node numbering.
        facets: Vertices of this rank's part of the facets to evaluate, shape (facets, vertices per
            facet); by default all exterior facets, in 2-D all cells.

    Attributes:
        nodes: Vertex numbers in this rank's block, ascending over the ranks, shape (n,).
        comm: Communicator.
    """

    def __init__(self, model: Model, nodes: NodeNumbering, facets: Ints | None = None) -> None:
        """Assemble the matrix (collective)."""
        check_has_envelopes(model)
        self.comm = comm = model.jointed.mesh.comm
        topology, vertices = (
            model.jointed.mesh.topology,
            len(basix.geometry(model.jointed.shape.type)),
        )
        num_cells = topology.index_map(topology.dim).size_local
        corners = nodes.number[model.V.dofmap.list[:num_cells, :vertices]]
        if facets is None:
            facets = boundary_facets(model, nodes) if model.gdim == 3 else corners
        owned = np.unique(facets)
        owned = np.unique(sent_to(comm, rank_of(nodes.blocks, owned), owned))
        ends = blocks_of(comm, len(owned))
        numbers = ends[comm.rank] + np.arange(len(owned))
        place = np.full(len(nodes.positions), -1, dtype=np.int64)
        place[owned - nodes.first] = numbers
        self.nodes: Ints = dealt(comm, int(ends[-1]), numbers, owned)
        self._blocks = equal_blocks(int(ends[-1]), comm.size)
        self._place = place = rows_at(comm, place, corners.ravel()).reshape(corners.shape)
        numbered = place[place >= 0]
        cells = added(comm, self._blocks, numbered, np.ones(len(numbered)))
        count = np.ones(place.shape)
        count[place >= 0] = rows_at(comm, cells, numbered)
        self._matrix = self._assemble(model, place, count)
        self._thermal = [
            (i, self._thermal_stress(model, load, place) / cells, load.factor)
            for i, load in enumerate(model.loads)
            if isinstance(load, Temperature)
        ]
        self._stress = self._matrix.createVecLeft()
        # Temperatures cause no stress across the plane in plane stress.
        axes = model.body.strained_axes
        self._isotropic = np.array([1.0, 1.0, 1.0 if axes == 3 else 0.0, 0.0, 0.0, 0.0])

    def _assemble(self, model: Model, place: Ints, count: Floats) -> PETSc.Mat:
        """Return six rows per vertex; ``place`` is the vertex of each cell corner, -1 if inside."""
        dofmap, columns, gdim = model.V.dofmap, model.stiffness.getSizes()[1], model.gdim
        evaluate = _evaluator(model)
        cells = np.flatnonzero((place >= 0).any(axis=1)).astype(np.int32)
        local = gdim * (dofmap.index_map.size_local + dofmap.index_map.num_ghosts)
        rows = np.unique(place[place >= 0])
        shape = (6 * len(rows), local)
        parts = [(np.empty(0), np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int32))]
        for start in range(0, len(cells), _CHUNK):
            chunk = cells[start : start + _CHUNK]
            dofs = (gdim * dofmap.list[chunk][:, :, None] + np.arange(gdim)).reshape(len(chunk), -1)
            cell, vertex = np.nonzero(place[chunk] >= 0)
            number = np.searchsorted(rows, place[chunk][cell, vertex])
            values = evaluate(chunk)[cell, vertex] / count[chunk][cell, vertex][:, None, None]
            i = np.broadcast_to((6 * number[:, None] + np.arange(6))[:, :, None], values.shape)
            j = np.broadcast_to(dofs[cell][:, None, :], values.shape)
            part = coo_matrix((values.ravel(), (i.ravel(), j.ravel())), shape)
            part.sum_duplicates()
            parts.append((part.data, part.row, part.col))
        data, row, column = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        summed = coo_matrix((data, (row, column)), shape).tocsr()
        block = dofmap.index_map.local_to_global(np.arange(local // gdim, dtype=np.int32))
        indices = gdim * block.astype(np.int64)[summed.indices // gdim] + summed.indices % gdim
        matrix = PETSc.Mat().create(comm=lasting(self.comm))
        matrix.setSizes(((6 * len(self.nodes), 6 * int(self._blocks[-1])), columns))
        matrix.setType("aij")
        matrix.setUp()
        csr = (array.astype(PETSc.IntType) for array in (summed.indptr, indices))
        rowmap = (6 * rows[:, None] + np.arange(6)).ravel().astype(PETSc.IntType)
        matrix.setValuesIJV(*csr, summed.data, addv=True, rowmap=rowmap)
        matrix.assemble()
        return matrix

    def _thermal_stress(self, model: Model, load: Temperature, place: Ints) -> Floats:
        """Return the thermal stress of the constrained body, summed over cells per vertex [Pa]."""
        heated = np.zeros(len(place), dtype=bool)
        if load.cells is None:
            heated[:] = True
        else:
            cells = model.jointed.cells(load.cells)
            heated[cells[cells < len(place)]] = True
        cells = np.flatnonzero(heated & (place >= 0).any(axis=1)).astype(np.int32)
        values = _at_vertices(model, load.blocked_stress(model))(cells)
        values = values.reshape(len(cells), place.shape[1])
        on_boundary = place[cells] >= 0
        return added(self.comm, self._blocks, place[cells][on_boundary], values[on_boundary])

    def __call__(self, u: PETSc.Vec, time: float, loads: Sequence[int] | None = None) -> Floats:
        """Return stresses (xx, yy, zz, xy, yz, xz) at vertices, shape (n, 6), [Pa] (collective).

        Args:
            u: Displacement [m].
            time: Time at which temperatures are evaluated [s].
            loads: Indices in ``Model.loads`` of the acting loads; all by default.
        """
        self._matrix.mult(u, self._stress)
        stress: Floats = self._stress.getArray(readonly=True).reshape(-1, 6)
        if self._thermal:
            thermal = sum(
                factor(time) * unit
                for i, unit, factor in self._thermal
                if loads is None or i in loads
            )
            stress = stress - np.outer(thermal, self._isotropic)
        return stress

    def strengths(self, model: Model, by_group: Mapping[str, Strength]) -> dict[str, Floats]:
        """Return the lowest strengths of the cells at vertices, shape (n,), [Pa] (collective).

        Names are those in ``STRENGTHS``. A strength is infinite if no cell at the vertex is in a
        group. The group "" is the whole body.
        """
        everywhere: Floats = np.full(len(self.nodes), np.inf)
        lowest = {name: everywhere.copy() for name in STRENGTHS if by_group}
        for group, strength in by_group.items():
            cells = model.jointed.cells(group) if group else np.arange(len(self._place))
            numbers = self._place[cells[cells < len(self._place)]]
            numbers = numbers[numbers >= 0]
            adjacent = added(self.comm, self._blocks, numbers, np.ones(len(numbers))) > 0.0
            for name, values in lowest.items():
                values[adjacent] = np.minimum(values[adjacent], getattr(strength, name))
        return lowest

    def across(self, rows: NDArray[Any]) -> NDArray[Any] | Dealt:
        """Return the rows of all ranks as one array."""
        return across(self.comm, rows, self._blocks)


def _evaluator(model: Model) -> Any:
    """Return a function from cells to d stress/d displacement, (cells, vertices, 6, cell dofs)."""
    evaluate = _at_vertices(model, model.body.stress_vector(ufl.TrialFunction(model.V)))
    vertices = len(basix.geometry(model.jointed.shape.type))
    return lambda cells: evaluate(cells).reshape(len(cells), vertices, 6, -1)


def _at_vertices(model: Model, expression: Any) -> Any:
    """Return a function that evaluates a UFL expression at the vertices of given cells."""
    mesh = model.jointed.mesh
    vertices = basix.geometry(model.jointed.shape.type)
    compiled = fem.Expression(expression, vertices, comm=mesh.comm)
    return lambda cells: np.asarray(compiled.eval(mesh, cells))


class StressEnvelopes:
    """Envelopes over a run of the stresses at the vertices of the boundary, in 2-D of all cells.

    Arch and cantilever directions are computed from the facets of the groups, or by default from
    the free faces: exterior facets outside joints and supports. In 2-D there is no arch direction,
    and the cantilever direction is upwards (y).

    Args:
        model: The model.
        nodes: Node numbering.
        groups: Names of facet groups, such as ``["upstream"]``; by default the whole boundary, in
            2-D all cells.
        strength: Strengths by cell group, see `SurfaceStress.strengths`.

    Attributes:
        nodes: Vertex numbers in this rank's block, ascending over the ranks, shape (n,).
        arch: Arch directions, shape (n, 3), NaN if undefined.
        cantilever: Cantilever directions, shape (n, 3), NaN if undefined.
    """

    def __init__(
        self,
        model: Model,
        nodes: NodeNumbering,
        groups: Sequence[str] | None = None,
        strength: Mapping[str, Strength] | None = None,
    ) -> None:
        """Assemble the stress recovery (collective)."""
        chosen = None if groups is None else facets_of_groups(model, nodes, groups)
        self._facets = None if chosen is None else across(model.jointed.mesh.comm, chosen)
        self._stress = SurfaceStress(model, nodes, chosen)
        self.nodes = self._stress.nodes
        self._strengths = self._stress.strengths(model, strength or {})
        self._plane = model.gdim == 2
        if not self._plane:
            free = free_facets(model, nodes) if chosen is None else chosen
            self.arch, self.cantilever = _directions(model, nodes, free, self.nodes)
        else:
            self.arch = np.full((len(self.nodes), 3), np.nan)
            self.cantilever = np.tile([0.0, 1.0, 0.0], (len(self.nodes), 1))
        self.begin()

    @property
    def directions(self) -> list[Any]:
        """Facets of the groups, ``nodes``, directions and, if given, strengths on all ranks."""
        rows = (self.nodes, self.arch, self.cantilever, *self._strengths.values())
        return [self._facets, *(self._stress.across(values) for values in rows)]

    def begin(self) -> None:
        """Reset the envelopes at the start of a run."""
        strength = self._strengths.get("dynamic_tensile")
        self._envelopes = Envelopes(self.arch, self.cantilever, strength)

    def see(self, u: PETSc.Vec, time: float) -> None:
        """Update the envelopes with the stresses at a time [s], from displacements (collective)."""
        self._envelopes.see(self._stress(u, time), time)

    def in_plane(self, u: PETSc.Vec, time: float) -> dict[str, Array]:
        """Return the in-plane stresses at a time [s] of all ranks, nothing in 3-D (collective)."""
        return self._in_plane(self._stress(u, time)) if self._plane else {}

    def _in_plane(self, stress: Floats) -> dict[str, Array]:
        return {PLANE_STRESS: self._stress.across(stress[:, [0, 1, 3]])} if self._plane else {}

    def at(
        self, u: PETSc.Vec, time: float, loads: Sequence[int], present: Floats
    ) -> dict[str, Array]:
        """Return the stresses of a static stage of all ranks by series (collective).

        Args:
            u: Displacement [m].
            time: Time at which temperatures are evaluated [s].
            loads: Indices in ``Model.loads`` of the acting loads.
            present: 1 at this rank's vertices, 0 at vertices of absent blocks, shape (n,).
        """
        stress = present[:, None] * self._stress(u, time, loads)
        series = stage_stresses(stress, self.arch, self.cantilever)
        across_ranks = {name: self._stress.across(values) for name, values in series.items()}
        return across_ranks | self._in_plane(stress)

    def state_dict(self) -> Dealt:
        """Return the columns of the envelopes of all ranks (collective)."""
        return Dealt(self._stress.comm, self._envelopes.columns)

    def values(self) -> dict[str, Array]:
        """Return the envelopes of all ranks by series of the stream ``envelopes``."""
        columns = self._envelopes.columns
        series = {name: columns[:, i] for i, name in enumerate(ENVELOPE_NAMES)}
        if self._strengths:
            series["overstress_time"] = columns[:, len(series) : -1]
        return {name: self._stress.across(rows) for name, rows in series.items()}

    def load_state_dict(self, columns: Floats, time: float) -> None:
        """Restore the envelopes at this rank's vertices from ``state_dict`` at a time [s]."""
        self._envelopes.load_state_dict(columns, time)


def _directions(
    model: Model, nodes: NodeNumbering, facets: Ints, vertices: Ints
) -> tuple[Floats, Floats]:
    """Return arch and cantilever directions at vertices, from all ranks' facets (collective)."""
    comm = model.jointed.mesh.comm
    # Send each facet to all ranks with one of its vertices, in an order that all ranks share.
    first = comm.allgather(int(vertices[0]) if len(vertices) else nodes.count)
    starts = np.minimum.accumulate([*first, nodes.count][::-1])[::-1]
    ranks = rank_of(np.append(0, starts[1:]), facets)
    pairs = np.column_stack([np.arange(len(facets)).repeat(facets.shape[1]), ranks.ravel()])
    row, rank = np.unique(pairs, axis=0).T
    around = sent_to(comm, rank, facets[row])
    near, numbers = np.unique(np.append(around, vertices), return_inverse=True)
    places = rows_at(comm, nodes.positions, near)
    numbers = numbers.ravel()
    rows = numbers[around.size :]
    arch, cantilever = face_directions(places, numbers[: around.size].reshape(around.shape))
    return arch[rows], cantilever[rows]


def check_has_envelopes(model: Model) -> None:
    """Raise ValueError if stress envelopes cannot be recorded for the model."""
    if model.bulk is not None:
        raise ValueError(
            "Stress envelopes need an elastic body: stresses in nonlinear cells also depend on "
            "internal variables."
        )


def facets_of_groups(model: Model, nodes: NodeNumbering, groups: Sequence[str]) -> Ints:
    """Return vertices of exterior facets of the groups, in this rank's block (collective)."""
    parts, comm = [], model.jointed.mesh.comm
    for group in groups:
        outer = exterior_facet_indices(model.jointed.mesh.topology)
        facets = boundary_facets(model, nodes, np.intersect1d(outer, model.jointed.facets(group)))
        if not comm.allreduce(len(facets)):
            raise MeshError(f"The facet group {group!r} has no facets on the boundary.")
        parts.append(facets)
    return np.unique(np.concatenate(parts), axis=0)


def free_facets(model: Model, nodes: NodeNumbering) -> Ints:
    """Return vertices of exterior facets outside joints and supports (collective)."""
    jointed = model.jointed
    sides = [f"{name}{side}" for name in jointed.joint_names for side in "-+"]
    free = exterior_facet_indices(jointed.mesh.topology)
    for group in (*sides, *model.constraints.groups):
        free = np.setdiff1d(free, jointed.facets(group))
    return boundary_facets(model, nodes, free)
