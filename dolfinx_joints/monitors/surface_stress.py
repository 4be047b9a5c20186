# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stresses at the vertices of the boundary from displacements, and their envelopes over a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import basix
import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.sparse import coo_matrix

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.mpi import lasting, on_root
from dolfinx_joints.loads.temperature.thermal_strain import Temperature
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.probes import boundary_facets
from dolfinx_joints.postprocessing.envelopes import Envelopes, face_directions, stage_stresses

Floats = NDArray[np.floating[Any]]
Ints = NDArray[np.int64]

_CHUNK = 512  # cells evaluated at a time: 16 MB for hexahedra of degree 2


class SurfaceStress:
    """Stresses at the vertices of all exterior facets, one product with a matrix.

    Those that the model's temperatures make in a clamped body are taken off.

    The stress at a vertex is the mean of those that the cells around it have there. As the nodes on
    a joint are double, cells beyond the joint do not count.

    Args:
        model: The model, in space.
        nodes: Numbers the nodes.
        facets: Vertices of the facets concerned, shape (facets, vertices per facet), the same on
            every rank; all exterior facets unless given.

    Attributes:
        nodes: Numbers of the vertices, rising, the same on every rank, shape (n,).
        own: Positions in ``nodes`` of those of this rank, shape (own,).
    """

    def __init__(self, model: Model, nodes: NodeNumbering, facets: Ints | None = None) -> None:
        """Assemble the matrix (collective)."""
        if model.gdim != 3:
            raise ValueError("Stress envelopes are recorded of bodies in space, got a plane model.")
        if model.bulk is not None:
            raise ValueError(
                "Stress envelopes are recorded of elastic bodies; plastic cells have stresses that "
                "displacements alone do not determine."
            )
        self._comm = model.jointed.mesh.comm
        self.nodes: Ints = np.unique(boundary_facets(model, nodes) if facets is None else facets)
        owned = model.V.dofmap.index_map.size_local
        self.own: Ints = np.flatnonzero(np.isin(self.nodes, nodes.number[:owned]))
        parts = self._comm.allgather(self.own)
        self._order = np.argsort(np.concatenate(parts), kind="stable")
        vertices = len(basix.geometry(model.jointed.shape.type))
        num_cells = model.jointed.mesh.topology.index_map(3).size_local
        corners = nodes.number[model.V.dofmap.list[:num_cells, :vertices]]
        place = np.searchsorted(self.nodes, corners)
        met = self.nodes[np.minimum(place, len(self.nodes) - 1)] == corners
        count = np.bincount(place[met], minlength=len(self.nodes))
        count = np.sum(self._comm.allgather(count), axis=0)
        place = np.where(met, place, -1)
        self._matrix = self._assemble(model, place, count)
        self._thermal = [
            (i, self._blocked(model, load, place, count), load.factor)
            for i, load in enumerate(model.loads)
            if isinstance(load, Temperature)
        ]
        self._stress = self._matrix.createVecLeft()

    def _assemble(self, model: Model, place: Ints, count: Ints) -> PETSc.Mat:
        """Rows of the own vertices, six each; ``place`` is -1 off the boundary."""
        dofmap, columns = model.V.dofmap, model.stiffness.getSizes()[1]
        evaluate = _evaluator(model)
        cells = np.flatnonzero((place >= 0).any(axis=1)).astype(np.int32)
        local = 3 * (dofmap.index_map.size_local + dofmap.index_map.num_ghosts)
        shape = (6 * len(self.nodes), local)
        parts = [(np.empty(0), np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int32))]
        for start in range(0, len(cells), _CHUNK):
            chunk = cells[start : start + _CHUNK]
            dofs = (3 * dofmap.list[chunk][:, :, None] + np.arange(3)).reshape(len(chunk), -1)
            cell, vertex = np.nonzero(place[chunk] >= 0)
            at = place[chunk][cell, vertex]
            values = evaluate(chunk)[cell, vertex] / count[at][:, None, None]
            i = np.broadcast_to((6 * at[:, None] + np.arange(6))[:, :, None], values.shape)
            j = np.broadcast_to(dofs[cell][:, None, :], values.shape)
            part = coo_matrix((values.ravel(), (i.ravel(), j.ravel())), shape)
            part.sum_duplicates()
            parts.append((part.data, part.row, part.col))
        data, row, column = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        summed = coo_matrix((data, (row, column)), shape).tocsr()
        block = dofmap.index_map.local_to_global(np.arange(local // 3, dtype=np.int32))
        rows = np.empty(len(self.nodes), dtype=np.int64)
        rows[np.concatenate(self._comm.allgather(self.own))] = np.arange(len(self.nodes))
        rows = (6 * rows[:, None] + np.arange(6)).ravel()
        filled = np.flatnonzero(np.diff(summed.indptr))
        summed = summed[filled]
        indices = 3 * block.astype(np.int64)[summed.indices // 3] + summed.indices % 3
        matrix = PETSc.Mat().create(comm=lasting(self._comm))
        matrix.setSizes(((6 * len(self.own), 6 * len(self.nodes)), columns))
        matrix.setType("aij")
        matrix.setUp()
        csr = (array.astype(PETSc.IntType) for array in (summed.indptr, indices))
        matrix.setValuesIJV(*csr, summed.data, addv=True, rowmap=rows[filled].astype(PETSc.IntType))
        matrix.assemble()
        return matrix

    def _blocked(self, model: Model, load: Temperature, place: Ints, count: Ints) -> Floats:
        """Stress of a temperature in a clamped body, at the own vertices, shape (own,), [Pa]."""
        warm = np.zeros(len(place), dtype=bool)
        if load.cells is None:
            warm[:] = True
        else:
            cells = model.jointed.cells(load.cells)
            warm[cells[cells < len(place)]] = True
        cells = np.flatnonzero(warm & (place >= 0).any(axis=1)).astype(np.int32)
        values = _at_vertices(model, load.blocked_stress(model))(cells)
        values = values.reshape(len(cells), place.shape[1])
        cell, vertex = np.nonzero(place[cells] >= 0)
        at = place[cells][cell, vertex]
        summed = np.bincount(at, weights=values[cell, vertex], minlength=len(self.nodes))
        total: Floats = np.sum(self._comm.allgather(summed), axis=0) / count
        return total[self.own]

    def __call__(self, u: PETSc.Vec, time: float, loads: Sequence[int] | None = None) -> Floats:
        """Stresses (xx, yy, zz, xy, yz, xz) at the own vertices, shape (own, 6), [Pa] (collective).

        Args:
            u: Displacement [m].
            time: Time of the temperatures [s].
            loads: Places in ``Model.loads`` of those that act; all unless given.
        """
        self._matrix.mult(u, self._stress)
        stress: Floats = self._stress.getArray(readonly=True).reshape(-1, 6)
        if self._thermal:
            blocked_now = sum(
                factor(time) * blocked
                for i, blocked, factor in self._thermal
                if loads is None or i in loads
            )
            stress = stress - np.outer(blocked_now, [1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
        return stress

    def gather(self, values: Floats) -> Floats | None:
        """Rows of all vertices in the order of ``nodes`` on rank 0, None elsewhere (collective)."""
        parts = self._comm.gather(values, root=0)
        return None if parts is None else np.concatenate(parts)[self._order]


def _evaluator(model: Model) -> Any:
    """A function of cells: d stress / d displacement, (cells, vertices, 6, dofs of a cell)."""
    evaluate = _at_vertices(model, model.body.stress_vector(ufl.TrialFunction(model.V)))
    vertices = len(basix.geometry(model.jointed.shape.type))
    return lambda cells: evaluate(cells).reshape(len(cells), vertices, 6, -1)


def _at_vertices(model: Model, expression: Any) -> Any:
    """A function of cells: the values of a UFL expression at their vertices."""
    mesh = model.jointed.mesh
    vertices = basix.geometry(model.jointed.shape.type)
    compiled = fem.Expression(expression, vertices, comm=mesh.comm)
    return lambda cells: np.asarray(compiled.eval(mesh, cells))


class StressEnvelopes:
    """Envelopes of the stresses at the vertices of the boundary over a run.

    The directions are those of the free faces: facets of joints and supports do not count. On
    chosen groups they are those of the groups' facets.

    Args:
        model: The model, in space.
        nodes: Numbers the nodes.
        groups: Names of facet groups, such as ``["upstream"]``; the whole boundary unless given.

    Attributes:
        nodes: Numbers of the vertices, shape (n,).
        arch: Arch directions, shape (n, 3), NaN where there are none.
        cantilever: Cantilever directions likewise.
    """

    def __init__(
        self, model: Model, nodes: NodeNumbering, groups: Sequence[str] | None = None
    ) -> None:
        """Assemble what the recovery needs (collective)."""
        chosen = None if groups is None else facets_of_groups(model, nodes, groups)
        self._stress = SurfaceStress(model, nodes, chosen)
        self.nodes = self._stress.nodes
        free = free_facets(model, nodes) if chosen is None else chosen
        comm = model.jointed.mesh.comm
        self.arch, self.cantilever = on_root(
            comm, lambda: [d[self.nodes] for d in face_directions(nodes.positions, free)]
        )
        self.begin()

    @property
    def directions(self) -> tuple[Ints, Floats, Floats]:
        """``nodes``, ``arch`` and ``cantilever``."""
        return self.nodes, self.arch, self.cantilever

    def begin(self) -> None:
        """Begin anew, before the first stresses of a run."""
        own = self._stress.own
        self._seen = Envelopes(self.arch[own], self.cantilever[own])

    def see(self, u: PETSc.Vec, time: float) -> None:
        """Take in the stresses of a displacement [m] at a time [s] (collective)."""
        self._seen.see(self._stress(u, time))

    def at(self, u: PETSc.Vec, time: float, loads: Sequence[int]) -> Floats | None:
        """Stresses of a static stage on rank 0, columns as in `stage_stresses` (collective)."""
        own = self._stress.own
        stress = self._stress(u, time, loads)
        return self._stress.gather(stage_stresses(stress, self.arch[own], self.cantilever[own]))

    def gather(self) -> Floats | None:
        """Envelopes on rank 0, columns as in ``ENVELOPE_NAMES``, None elsewhere (collective)."""
        return self._stress.gather(self._seen.columns)

    def load_state_dict(self, columns: Floats) -> None:
        """Go on from the envelopes of all vertices, as ``gather`` gave them."""
        self._seen.load_state_dict(columns[self._stress.own])


def facets_of_groups(model: Model, nodes: NodeNumbering, groups: Sequence[str]) -> Ints:
    """Vertices of the exterior facets of named groups, on every rank (collective)."""
    found = []
    for group in groups:
        facets = boundary_facets(model, nodes, only=model.jointed.facets(group))
        if not len(facets):
            raise MeshError(f"The facet group {group!r} has no facets on the boundary.")
        found.append(facets)
    return np.unique(np.concatenate(found), axis=0)


def free_facets(model: Model, nodes: NodeNumbering) -> Ints:
    """Vertices of the exterior facets of no joint and no support, on every rank (collective)."""
    jointed = model.jointed
    sides = [f"{name}{side}" for name in jointed.joint_names for side in "-+"]
    taken = [jointed.facets(group) for group in (*sides, *model.constraints.groups)]
    without = np.unique(np.concatenate(taken)) if taken else np.empty(0, dtype=np.int32)
    return boundary_facets(model, nodes, without=without)
