# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Monitor that writes the results file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

import annotated_types as at
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import MeshError, ResultsError
from dolfinx_joints.common.mpi import on_root, raised_together
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.joint_extremes import JointExtremesStream
from dolfinx_joints.monitors.manifest import manifest
from dolfinx_joints.monitors.probes import (
    PointProbe,
    boundary_facets,
    checked_points,
    joint_facet_points,
    joint_statics,
)
from dolfinx_joints.monitors.resultants import PointExtras, ResultantsStream, strengths
from dolfinx_joints.monitors.surface_stress import StressEnvelopes
from dolfinx_joints.postprocessing.envelopes import ENVELOPE_NAMES, declare_envelopes
from dolfinx_joints.results.layout import declare_energy, declare_histories, declare_states
from dolfinx_joints.results.reader import ENERGY_TERMS, JOINT_ENERGY_TERMS
from dolfinx_joints.results.writer import ResultsWriter, check_storable
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.record import Record

Floats = NDArray[np.floating[Any]]


@dataclass(eq=False)
@checked
class ResultsMonitor(Monitor):
    """Writes histories, energies and states to an HDF5 file as the run goes.

    Every step: displacement and acceleration of the monitor points, acceleration of the ground,
    shares of open, sticking and sliding joint points, iterations, support reactions by group,
    energies; of each joint the largest opening, slip and pressure and what its safety against
    sliding is made of. Every ``every`` steps: nodal displacements, joint gaps, tractions and
    status, facet by facet; the pressures of water in joints and broken bonds, where there are any.
    If asked for: resultants of joints and blocks at every step, and at the end envelopes of the
    stresses at the boundary over all steps.

    Args:
        path: The file.
        points: Monitor points by name, coordinates [m].
        every: Steps between two states.
        metadata: Further facts of the run; anything JSON can hold.
        overwrite: Replace an existing file.
        envelopes: Record envelopes of principal, arch and cantilever stresses, the static state
            included, at the whole boundary or on the facet groups named; of models in space only.
            Costs a product with a matrix each step.
        resultants: Record force and moment of each joint, and on each block, at every step.
    """

    path: str | PathLike[str]
    _: KW_ONLY
    points: Mapping[str, Sequence[float]]
    every: Annotated[int, at.Ge(1)] = 10
    metadata: Mapping[str, Any] | None = None
    overwrite: bool = False
    envelopes: bool | Sequence[str] = False
    resultants: bool = False

    def __post_init__(self) -> None:
        """Check what is no plain parameter; nothing is written before the run starts."""
        check_storable("metadata", self.metadata or {})
        self._path, self._points = Path(self.path), checked_points(self.points)
        self._writer: ResultsWriter | None = None

    def start(self, model: Model, stage: str, steps: int, first: Record) -> None:
        """Create the file and write the mesh and the first record (collective)."""
        self._find(model, first)
        surface = boundary_facets(model, self._nodes)
        joints = joint_statics(model)
        metadata = {
            "stage": stage,
            "steps": steps,
            "point_names": list(self._points),
            "dofs": model.num_dofs,
            "joint_points": model.operator.num_points if model.operator else 0,
            "ranks": self._comm.size,
            "units": "SI: m, s, N, Pa, J",
            "laws": strengths(model.contact) if model.contact else {},
            **(self.metadata or {}),
        }

        def create() -> None:
            made_by = manifest(model, first.settings, self._nodes.positions, surface)
            facts = {"manifest": made_by, **metadata}
            self._writer = writer = ResultsWriter(self._path, facts, overwrite=self.overwrite)
            declare_histories(writer, self._probe.positions, accelerations=True)
            for group in self._supports:
                text = f"force of the support {group} on the body"
                writer.series("histories", f"reaction/{group}", (model.gdim,), "N", text)
            names = [] if model.operator is None else model.operator.names
            declare_energy(writer, names, first.energy.input_by_load)
            if model.bulk is not None:
                writer.series("energy", "plastic", (), "J", "plastic work of the bulk")
            declare_states(writer, self._nodes.positions, surface, joints, status=True)
            if self._extras is not None:
                self._extras.declare(writer, joints)
            if self._extremes is not None:
                self._extremes.declare(writer)
            if self._resultants is not None:
                self._resultants.declare(writer)
            if self._envelopes is not None:
                found = self._envelopes
                declare_envelopes(writer, found.nodes, found.arch, found.cantilever)
            writer.start()

        try:
            on_root(self._comm, create)
            self.record(first)
        except BaseException as error:
            if self._writer is not None:
                self._writer.__exit__(type(error), error, None)
                self._writer = None
            raise

    def _find(self, model: Model, first: Record) -> None:
        """Nodes, points, supports and joints of the model (collective)."""
        self._model, self._comm = model, model.jointed.mesh.comm
        self._nodes = NodeNumbering(model.V)
        self._probe = PointProbe(model, list(self._points.values()), self._nodes)
        self._supports = model.constraints.groups
        self._envelopes = None
        if self.envelopes:
            groups = None if isinstance(self.envelopes, bool) else self.envelopes
            self._envelopes = StressEnvelopes(model, self._nodes, groups)
        self._extras = PointExtras(model.contact, first) if model.contact else None
        self._extremes = None
        if first.joints is not None:
            self._extremes = JointExtremesStream(model, first.joints.state.gap)
        self._resultants: ResultantsStream | None = None
        if self.resultants:
            if model.contact is None:
                raise MeshError("resultants=True records forces of joints; the model has none.")
            self._resultants = ResultantsStream(model, self._nodes, first.wet_joints)
        self._before: tuple[float, Floats] | None = None

    def state_dict(self) -> dict[str, Any]:
        """Records written, brought to the disk, and what the next one needs (collective)."""
        columns = None if self._envelopes is None else self._envelopes.gather()
        gap = None if self._extremes is None else self._extremes.state_dict()
        records: dict[str, int] = {}
        with raised_together(self._comm):
            if self._writer is not None:
                self._writer.to_disk()
                records = self._writer.records
        assert self._before is not None
        time, velocity = self._before
        return {
            "records": records,
            "settings": self._settings,
            "time": time,
            "velocity": velocity,
            "envelopes": columns,
            "gap": gap,
        }

    @property
    def _settings(self) -> dict[str, Any]:
        """Settings that a continued file must agree in."""
        points = {name: [float(x) for x in place] for name, place in self._points.items()}
        faces = self.envelopes if isinstance(self.envelopes, bool) else list(self.envelopes)
        extra = {"envelopes": faces, "resultants": self.resultants}
        return {"points": points, "every": self.every, **extra}

    def resume(
        self, model: Model, stage: str, steps: int, last: Record, state_dict: Mapping[str, Any]
    ) -> None:
        """Go on with the file; records after ``last`` are cut off (collective)."""
        for name, here in self._settings.items():
            was = state_dict["settings"][name]
            if was != here:
                raise ResultsError(
                    f"{self._path} cannot be continued: it was recorded with {name}={was}, now "
                    f"{name}={here}."
                )
        self._find(model, last)
        self._before = state_dict["time"], state_dict["velocity"]
        self._time = last.time
        if self._envelopes is not None:
            self._envelopes.load_state_dict(state_dict["envelopes"])
        if self._extremes is not None:
            self._extremes.load_state_dict(state_dict["gap"])
        with raised_together(self._comm):
            if self._comm.rank == 0:
                self._writer = ResultsWriter.resume(self._path, state_dict["records"])

    def record(self, record: Record) -> None:
        """Append a step (collective)."""
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
        history: dict[str, Any] = {**self._motion(record), **shares, "iterations": iterations}
        for group in self._supports:
            history[f"reaction/{group}"] = self._model.resultant(record.reaction, group)
        energies = {term: getattr(record.energy, term) for term in ENERGY_TERMS}
        names = [] if contact is None else contact.operator.names
        for i, name in enumerate(names):
            for term in JOINT_ENERGY_TERMS:
                value = getattr(record.energy, f"joint_{term}")[i]
                energies[f"joints/{name}/{term}"] = value
        if self._model.bulk is not None:
            energies["plastic"] = record.energy.plastic
        for name, work in record.energy.input_by_load.items():
            energies[f"loads/{name}"] = work
        self._append("histories", record.time, history)
        self._append("energy", record.time, energies)
        if self._extremes is not None and record.joints is not None:
            self._append("joints", record.time, self._extremes.values(record.joints))
        if self._resultants is not None:
            self._append("resultants", record.time, self._resultants.values(record))
        if record.step % self.every == 0:
            self._append_state(record)
        if self._envelopes is not None:
            self._envelopes.see(record.displacement, record.time)
        self._time = record.time

    def _motion(self, record: Record) -> dict[str, Floats]:
        """Displacement and acceleration of the points, acceleration of the ground.

        The acceleration is the change of velocity since the last record over the time between: the
        mean of the step, which every scheme knows, however many substeps it was cut into.
        """
        velocity = self._probe.read(record.velocity)
        acceleration: Floats = np.zeros_like(velocity)
        if self._before is not None:
            time, before = self._before
            acceleration = (velocity - before) / (record.time - time)
        self._before = record.time, velocity
        return {
            "displacement": self._probe.read(record.displacement),
            "acceleration": acceleration,
            "ground_acceleration": record.ground_acceleration,
        }

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
            status = operator.gather(record.joints.status)
            assert self._extras is not None
            extras = self._extras.values(record)
            if gap is not None and traction is not None and status is not None:
                for name, (points, _) in joint_facet_points(operator).items():
                    values[f"joints/{name}/gap"] = gap[points]
                    values[f"joints/{name}/traction"] = traction[points]
                    values[f"joints/{name}/status"] = status[points]
                    for what, every in extras.items():
                        if name in self._extras.joints[what]:
                            values[f"joints/{name}/{what}"] = every[points]
        self._append("states", record.time, values)

    def finish(self, status: str, summary: dict[str, Any]) -> None:
        """Write the envelopes and close the file (collective)."""
        columns = None if self._envelopes is None else self._envelopes.gather()
        with raised_together(self._comm):
            if self._writer is not None:
                writer, self._writer = self._writer, None
                with writer:
                    if columns is not None:
                        values = dict(zip(ENVELOPE_NAMES, columns.T, strict=True))
                        writer.append("envelopes", self._time, values)
                    writer.finish(status, summary)  # type: ignore[arg-type]
