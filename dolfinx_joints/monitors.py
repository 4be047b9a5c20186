# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Monitors: results file, ParaView fields, progress bar."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.checks import check_count
from dolfinx_joints.errors import MeshError, ResultsError
from dolfinx_joints.model import Model
from dolfinx_joints.parallel import on_root, raised_together
from dolfinx_joints.results import ENERGY_TERMS, JOINT_ENERGY_TERMS
from dolfinx_joints.results_writer import (
    ResultsWriter,
    declare_energy,
    declare_histories,
    declare_states,
)
from dolfinx_joints.stages import Record

Floats = NDArray[np.float64]


class PointProbe:
    """Reads the displacement at the nodes nearest to given points.

    Where several nodes share the place (on a joint), the first of the mesh file's order is taken,
    on any number of ranks.

    Args:
        model: The model.
        points: Coordinates, shape (n, gdim), [m].
        nodes: Numbers the nodes.

    Attributes:
        positions: Coordinates of the nodes found, shape (n, 3), [m].

    Raises:
        MeshError: A point is farther from every node than a tenth of the body's size.
    """

    def __init__(self, model: Model, points: Sequence[Sequence[float]], nodes: NodeGather) -> None:
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
            wanted = np.zeros(3)
            wanted[: len(point)] = point
            distance = np.round(np.linalg.norm(x - wanted, axis=1), 9)
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
        """Displacements of the points, shape (n, 3), [m], on every rank (collective)."""
        values = np.zeros((len(self.positions), 3))
        blocks = u.getArray(readonly=True).reshape(-1, self._gdim)
        for row, node in self._mine:
            values[row, : self._gdim] = blocks[node]
        return np.asarray(self._comm.allreduce(values))


class ResultsMonitor:
    """Writes histories, energies and states to an HDF5 file as the run goes.

    Every step: displacement of the monitor points, shares of open, sticking and sliding joint
    points, iterations, support reactions by group, energies. Every ``every`` steps: nodal
    displacements, joint gaps and tractions, facet by facet.

    Args:
        path: The file.
        points: Monitor points by name, coordinates [m].
        every: Steps between two states.
        metadata: What else to say of the run; anything JSON can hold.
        overwrite: Replace an existing file.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        points: Mapping[str, Sequence[float]],
        every: int = 10,
        metadata: Mapping[str, Any] | None = None,
        overwrite: bool = False,
    ) -> None:
        """Nothing is written before the run starts."""
        check_count("every", every, 1, "states are written every 1 or more steps")
        if not points:
            raise ValueError("points is empty; at least one monitor point is needed.")
        self._path, self._points, self._every = Path(path), dict(points), every
        self._metadata, self._overwrite = dict(metadata or {}), overwrite
        self._writer: ResultsWriter | None = None

    def start(self, model: Model, stage: str, steps: int, first: Record) -> None:
        """Create the file and write the mesh and the first record (collective)."""
        self._model, self._comm = model, model.jointed.mesh.comm
        self._nodes = NodeGather(model)
        self._probe = PointProbe(model, list(self._points.values()), self._nodes)
        self._supports = model.constraints.groups
        surface = boundary_facets(model, self._nodes)
        joints = _joint_statics(model)
        metadata = {
            "stage": stage,
            "steps": steps,
            "point_names": list(self._points),
            "dofs": model.num_dofs,
            "joint_points": model.operator.num_points if model.operator else 0,
            "ranks": self._comm.size,
            "units": "SI: m, s, N, Pa, J",
            **self._metadata,
        }

        def create() -> None:
            writer = ResultsWriter(self._path, metadata, overwrite=self._overwrite)
            declare_histories(writer, self._probe.positions)
            for group in self._supports:
                text = f"force of the support {group} on the body"
                writer.series("histories", f"reaction/{group}", (model.gdim,), "N", text)
            names = [] if model.operator is None else model.operator.names
            declare_energy(writer, names, first.energy.input_by_load)
            declare_states(writer, self._nodes.positions, surface, joints)
            writer.start()
            self._writer = writer

        on_root(self._comm, create)
        self.record(first)

    def record(self, record: Record) -> None:
        """Append a step (collective)."""
        displacement = self._probe.read(record.displacement)
        counts = record.solve.counts if record.solve else None
        contact = self._model.contact
        if counts is None and contact is not None and record.joints is not None:
            counts = contact.counts(record.joints.status)
        total = max(counts.total, 1) if counts else 1
        shares = {
            f"joint_{name}": getattr(counts, name) / total if counts else 0.0
            for name in ("open", "stick", "slip")
        }
        iterations = record.solve.iterations if record.solve else 0
        history: dict[str, Any] = {"displacement": displacement, **shares}
        history["iterations"] = iterations
        for group in self._supports:
            history[f"reaction/{group}"] = self._model.resultant(record.reaction, group)
        energies = {term: getattr(record.energy, term) for term in ENERGY_TERMS}
        names = [] if contact is None else contact.operator.names
        for i, name in enumerate(names):
            for term in JOINT_ENERGY_TERMS:
                value = getattr(record.energy, f"joint_{term}")[i]
                energies[f"joints/{name}/{term}"] = value
        for name, work in record.energy.input_by_load.items():
            energies[f"loads/{name}"] = work
        self._append("histories", record.time, history)
        self._append("energy", record.time, energies)
        if record.step % self._every == 0:
            self._append_state(record)

    def _append(self, stream: str, time: float, values: dict[str, Any]) -> None:
        """Write on rank 0; what goes wrong there stops every rank."""
        with raised_together(self._comm):
            if self._writer is not None:
                self._writer.append(stream, time, values)

    def _append_state(self, record: Record) -> None:
        values = {"displacement": self._nodes.gather(record.displacement)}
        operator = self._model.operator
        if operator is not None and record.joints is not None:
            gap = operator.gather(record.joints.state.gap)
            traction = operator.gather(record.joints.traction)
            if gap is not None and traction is not None:
                for name, (points, _) in _facet_points(operator).items():
                    values[f"joints/{name}/gap"] = gap[points]
                    values[f"joints/{name}/traction"] = traction[points]
        self._append("states", record.time, values)

    def finish(self, status: str, summary: dict[str, Any]) -> None:
        """Close the file."""
        if self._writer is not None:
            self._writer.finish(status, summary)  # type: ignore[arg-type]
            self._writer.close()
            self._writer = None


def _facet_points(operator: Any) -> dict[str, tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Points and facet numbers of each joint, facet by facet."""
    layout, found = operator.layout, {}
    joint_of_facet = layout.joint[layout.number[:, 0]]
    for i, name in enumerate(operator.names):
        numbers = layout.number[joint_of_facet == i]
        found[name] = (numbers.ravel(), np.repeat(np.arange(len(numbers)), numbers.shape[1]))
    return found


def _joint_statics(model: Model) -> dict[str, dict[str, NDArray[Any]]]:
    """Arrays that `declare_states` wants of each joint."""
    if model.operator is None:
        return {}
    layout, arrays = model.operator.layout, {}
    shares = layout.share * layout.areas[layout.number]
    joint_of_facet = layout.joint[layout.number[:, 0]]
    for i, (name, (points, facet)) in enumerate(_facet_points(model.operator).items()):
        arrays[name] = {
            "points": layout.points[points],
            "frames": layout.frames[points],
            "areas": shares[joint_of_facet == i].ravel(),
            "facet": facet,
        }
    return arrays


class NodeGather:
    """Collects nodal vectors on rank 0 in the order of the input mesh's nodes.

    Attributes:
        positions: Node coordinates on rank 0, shape (num_nodes, 3), [m].
        number: Position of each local node (ghosts included) in that order.
    """

    def __init__(self, model: Model) -> None:
        """Exchange the order once (collective)."""
        self._comm, self._gdim = model.jointed.mesh.comm, model.gdim
        index_map = model.V.dofmap.index_map
        owned = index_map.size_local
        x = model.V.tabulate_dof_coordinates()
        keys = _node_keys(model)
        parts = self._comm.allgather(keys[:owned])
        every = np.concatenate(parts)
        order = np.argsort(every, kind="stable")
        self._order = order
        sorted_keys = every[order]
        self.number = np.searchsorted(sorted_keys, keys)
        positions = self._comm.gather(x[:owned], root=0)
        self.positions = np.zeros((0, 3)) if positions is None else np.concatenate(positions)[order]

    def gather(self, u: PETSc.Vec) -> Floats:
        """Nodal vectors (num_nodes, 3) on rank 0, empty elsewhere (collective)."""
        parts = self._comm.gather(u.getArray(readonly=True).reshape(-1, self._gdim), root=0)
        if parts is None:
            return np.zeros((0, 3))
        values = np.zeros((len(self._order), 3))
        values[:, : self._gdim] = np.concatenate(parts)[self._order]
        return values


def _node_keys(model: Model) -> NDArray[np.int64]:
    """A number for each local node that no partition changes.

    The smallest (input cell, position in the cell) slot that holds the node.
    """
    mesh, dofmap = model.jointed.mesh, model.V.dofmap
    cells = np.asarray(mesh.topology.original_cell_index, dtype=np.int64)
    table = dofmap.list[: len(cells)]
    slots = cells[:, None] * table.shape[1] + np.arange(table.shape[1])
    index_map = dofmap.index_map
    keys = np.full(index_map.size_local + index_map.num_ghosts, np.iinfo(np.int64).max)
    np.minimum.at(keys, table.ravel(), slots.ravel())
    return _least_over_ranks(mesh.comm, index_map, keys)


def _least_over_ranks(comm: Any, index_map: Any, keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """Smallest key that any rank holds for each node."""
    numbers = index_map.local_to_global(np.arange(len(keys), dtype=np.int32))
    least = np.full(index_map.size_global, np.iinfo(np.int64).max)
    for part_numbers, part_keys in comm.allgather((numbers, keys)):
        np.minimum.at(least, part_numbers, part_keys)
    return least[numbers]


def boundary_facets(model: Model, nodes: NodeGather) -> NDArray[np.int64]:
    """Vertices of all exterior facets in cyclic order, on every rank (collective).

    Both sides of the joints are among them.

    Args:
        model: The model.
        nodes: Numbers the nodes.

    Returns:
        Node numbers, shape (num_facets, vertices per facet).
    """
    from dolfinx.mesh import exterior_facet_indices

    mesh, shape = model.jointed.mesh, model.jointed.shape
    tdim = mesh.topology.dim
    mesh.topology.create_connectivity(tdim - 1, tdim)
    mesh.topology.create_connectivity(tdim, tdim - 1)
    facets = exterior_facet_indices(mesh.topology)
    to_cell = mesh.topology.connectivity(tdim - 1, tdim)
    to_facet = mesh.topology.connectivity(tdim, tdim - 1)
    cells = to_cell.array[to_cell.offsets[facets]]
    per_cell = to_facet.array.reshape(-1, to_facet.offsets[1])
    local = np.argmax(per_cell[cells] == facets[:, None], axis=1)
    corners = shape.facet_vertices[local][:, shape.facet_cycle]
    vertices = nodes.number[np.take_along_axis(model.V.dofmap.list[cells], corners, axis=1)]
    every = np.concatenate(mesh.comm.allgather(vertices))
    return every[np.lexsort(every.T[::-1])]


class FieldMonitor:
    """Writes the displacement for ParaView (VTX, folder ``*.bp``), joints opened.

    Args:
        path: The folder.
        every: Steps between two times.
    """

    def __init__(self, path: str | Path, *, every: int = 10) -> None:
        """Nothing is written before the run starts."""
        check_count("every", every, 1, "fields are written every 1 or more steps")
        self._path, self._every = Path(path), every

    def start(self, model: Model, stage: str, steps: int, first: Record) -> None:
        """Create the folder and write the first time (collective)."""
        from dolfinx.io import VTXWriter

        on_root(model.jointed.mesh.comm, self._check_writable)
        self._u = model.function(first.displacement)
        self._writer = VTXWriter(model.jointed.mesh.comm, self._path, [self._u])
        self.record(first)

    def _check_writable(self) -> None:
        """Find out on one rank what would leave the others waiting in the writer."""
        try:
            self._path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ResultsError(f"{self._path} cannot be written: {error}.") from None

    def record(self, record: Record) -> None:
        """Append a time (collective)."""
        if record.step % self._every == 0:
            owned = record.displacement.getLocalSize()
            self._u.x.array[:owned] = record.displacement.getArray(readonly=True)
            self._u.x.scatter_forward()
            self._writer.write(record.time)

    def finish(self, status: str, summary: dict[str, Any]) -> None:
        """Close the folder (collective)."""
        self._writer.close()


class ProgressMonitor:
    """A progress bar on rank 0: time left, Newton iterations, open and sliding shares.

    Args:
        label: Text before the bar.
    """

    def __init__(self, label: str = "dynamic") -> None:
        """The bar appears when the run starts."""
        self._label = label
        self._bar: Any = None

    def start(self, model: Model, stage: str, steps: int, first: Record) -> None:
        """Show the bar."""
        if model.jointed.mesh.comm.rank == 0:
            from tqdm import tqdm

            self._bar = tqdm(total=steps, desc=self._label, unit="step", mininterval=1.0)

    def record(self, record: Record) -> None:
        """Advance the bar."""
        if self._bar is None or record.step == 0 or record.solve is None:
            return
        counts, shown = record.solve.counts, f"{record.solve.iterations} it"
        if counts is not None and counts.total:
            opened, sliding = counts.open / counts.total, counts.slip / counts.total
            shown += f", {100 * opened:.0f} % open, {100 * sliding:.0f} % sliding"
        self._bar.set_postfix_str(shown, refresh=False)
        self._bar.update(1)

    def finish(self, status: str, summary: dict[str, Any]) -> None:
        """Close the bar."""
        if self._bar is not None:
            self._bar.close()
