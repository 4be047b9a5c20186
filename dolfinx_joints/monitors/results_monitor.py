# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Monitor that writes the results file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

import annotated_types as at
from petsc4py import PETSc

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import JointsError, MeshError, OtherRunError, warn
from dolfinx_joints.common.mpi import handing_out, raised_together
from dolfinx_joints.common.parameters import check_kind_of
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.plausibility import warn_of_strengths
from dolfinx_joints.model.resolution import resolution
from dolfinx_joints.monitors.body_cells import body_mesh
from dolfinx_joints.monitors.fields import Fields, StageFields
from dolfinx_joints.monitors.joint_rows import JointRows
from dolfinx_joints.monitors.manifest import manifest
from dolfinx_joints.monitors.probes import PointProbe, Probe, check_points
from dolfinx_joints.monitors.resultants import ResultantsStream, strengths
from dolfinx_joints.monitors.step_series import STATIC_PART, StepSeries
from dolfinx_joints.monitors.surface_stress import StressEnvelopes, check_has_envelopes
from dolfinx_joints.postprocessing.envelopes import Strength, declare_directions
from dolfinx_joints.results.layout import declare, declare_body, declare_points, stage_bytes
from dolfinx_joints.results.reader import ABSOLUTE, RELATIVE
from dolfinx_joints.results.writer import ResultsWriter, check_storable, contains_only_statics
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.record import Record, StageRecord


@dataclass(eq=False)
@checked
class ResultsMonitor(Monitor):
    """Writes static stages, time histories, energies and states to an HDF5 file during a run.

    At the end of each static stage: displacements, reactions, joint values and, with ``envelopes``,
    boundary stresses. A file with static stages only is complete after each stage. A dynamic stage
    creates a new file, which repeats all previous static stages. If the first static stage would
    replace another file, that file is renamed to ``NAME.before``. The next dynamic stage deletes
    ``NAME.before`` when it starts, or restores that file to resume it.

    Every step: displacement and acceleration of the monitor points, ground acceleration (for
    incident waves, velocity of the free surface), shares of open, sliding and sticking joint
    points, iterations, support reactions and energies. By joint: largest opening, slip and
    pressure, and the terms of the sliding safety. Every ``every`` steps: nodal displacements, and
    facet by facet joint gaps, tractions and status, water pressures and broken bonds. Optional:
    resultants of joints and blocks at every step, and envelopes of boundary stresses at the end.
    At the end: the largest opening, slip and tractions of each joint point over all steps.

    Args:
        path: Path of the file.
        points: Monitor points by name, coordinates [m] or a `Probe`; nearest nodes are used.
        every: Steps between two states.
        metadata: Further information, storable as JSON; ``checks`` has arguments of `checks`.
        overwrite: Replace an existing file.
        envelopes: Record envelopes of principal, arch and cantilever stresses, including the static
            state, on the whole boundary (in 2-D in all cells) or on the named facet groups. They
            cost one matrix-vector product per step. In 2-D, states have stresses as well.
        strength: `Strength` of the body or by cell group for `checks`, to be given with
            ``envelopes``. Also records the time for which the largest principal stress exceeds
            1, 1.1, ... 2 times the dynamic tensile strength.
        resultants: Record force and moment of each joint and on each block at every step.
        static_part: Record the static part of the displacement under a `DifferingMotion`, at the
            points in every step and at all nodes in each state. Costs one solve per step.
        single_precision: Store states in half the space; the relative error of a number is 6e-8.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.frictionless(normal_stiffness=1e11)
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=[dj.Fixed(group="base")])
        >>> monitor = dj.ResultsMonitor("blocks.h5", points={"top": (0.5, 0.5, 2.0)})
        >>> run = dj.Simulation(model, monitors=[monitor])
        >>> outcome = run.dynamics(dt=0.01, steps=10, motion=lambda t: (1.0, 0.0, 0.0))
        >>> u = dj.Results("blocks.h5").series("histories", "displacement")  # (records, points, 3)
        >>> round(float(u[-1, 0, 0]), 5)  # the upper block slides, -0.5 * 1 m/s^2 * (0.1 s)^2 [m]
        -0.005
    """

    path: str | PathLike[str]
    _: KW_ONLY
    points: Mapping[str, Sequence[float] | Probe]
    every: Annotated[int, at.Ge(1)] = 10
    metadata: Mapping[str, Any] | None = None
    overwrite: bool = False
    envelopes: bool | Sequence[str] = False
    strength: Strength | Mapping[str, Strength] | None = None
    resultants: bool = False
    static_part: bool = False
    single_precision: bool = False

    def __post_init__(self) -> None:
        """Check the arguments; nothing is written before the run starts."""
        check_storable("metadata", facts := self.metadata or {})
        given = self.strength or {}
        self._strengths = dict(given) if isinstance(given, Mapping) else {"": given}
        are_strengths = all(isinstance(s, Strength) for s in self._strengths.values())
        check_kind_of("strength", given, are_strengths, "a Strength, or one by cell group")
        if self._strengths and not self.envelopes:
            raise ValueError("strength needs recorded stresses: set envelopes=True as well.")
        self._doubts: list[str] | None = None  # warnings of strengths
        self._path, self._points = Path(self.path), check_points(self.points)
        if facts.keys() & {"checks", "sliding"}:
            from dolfinx_joints.postprocessing.criteria import checks, sliding

            if isinstance(arguments := facts.get("checks"), Mapping):
                checks.check_arguments(self._points, **arguments)
            sliding.check_blocks(facts.get("sliding", {}), resultants=self.resultants)
        self._backup = self._path.with_name(self._path.name + ".before")
        self._writer: ResultsWriter | None = None
        self._prepared_model: Model | None = None
        self._last_stage: StageRecord | None = None
        self._stages: int | None = None  # Number of stages in the file of static stages, if any.
        self._in_dynamics = self._has_backup = False
        self._acting: dict[str, str] = {}  # Loads of each static stage, as in the manifest.

    def check(self, model: Model) -> None:
        """Raise an error if a quantity to be recorded does not exist in the model."""
        if self.resultants and model.contact is None:
            raise MeshError("resultants=True records forces of joints; the model has no joints.")
        if self.envelopes:
            check_has_envelopes(model)
        for group in filter(None, self._strengths):
            model.jointed.cells(group)  # Raises an error if the group does not exist.
        if self._doubts is None:
            self._doubts = warn_of_strengths(model.jointed.mesh.comm, self._strengths)

    def static_stage(self, model: Model, stages: Sequence[StageRecord]) -> None:
        """Add new stages to a file with static stages only (collective).

        After a dynamic stage, nothing is written: the next dynamic stage writes all stages.
        """
        self._write_stages(model, stages, "complete", {})

    def static_failure(
        self, model: Model, stages: Sequence[StageRecord], status: str, error: str
    ) -> None:
        """Mark a file with static stages only as failed, even without stages (collective)."""
        self._write_stages(model, stages, status, {"error": error})

    def _write_stages(self, model: Model, stages: Sequence[StageRecord], *ending: Any) -> None:
        """Update a file with static stages only; ``ending`` is status and summary (collective)."""
        if self._in_dynamics:
            return
        self._prepare_body(model)
        first = next((i for i, s in enumerate(stages, 1) if s is self._last_stage), 0)
        rows = [self._stage_fields.values(stage) for stage in stages[first:]]
        count = self._stages or 0
        with handing_out(self._comm, self._mesh, self._directions, rows):
            if self._comm.rank == 0:
                with self._static_writer(model, stages) as writer:
                    if not count:
                        empty = {"name": stage_bytes("none"), "load_time": 0.0}
                        self._begin(writer, {"statics": rows[0] if rows else empty})
                    for number, row in enumerate(rows, start=count + 1):
                        writer.append("statics", number, row)
                    writer.finish(*ending)
        self._last_stage = stages[-1] if stages else self._last_stage
        self._stages = count + len(rows)

    def _static_writer(self, model: Model, stages: Sequence[StageRecord]) -> ResultsWriter:
        """Return a writer for a file with static stages only, on rank 0."""
        origin = manifest(model, {}, self._mesh_sha256, stages, self._resolved)
        origin["static_stages"] = self._acting = self._acting | origin["static_stages"]
        facts = {"manifest": origin, "stage": "static", **self._facts(model)}
        if self._stages:
            return ResultsWriter.resume(self._path, {"statics": self._stages}, facts)
        backup = None if contains_only_statics(self._path) else self._backup
        self._has_backup = self.overwrite and backup is not None and self._path.exists()
        overwrite = self.overwrite or self._stages == 0
        rows = {"statics": max(1, len(stages))}
        return ResultsWriter(self._path, facts, overwrite=overwrite, aside=backup, rows=rows)

    def _begin(
        self, writer: ResultsWriter, values: Mapping[str, Mapping[str, Any]], frame: str = ""
    ) -> None:
        """Write constant data and declare the streams from example values, on rank 0."""
        declare_points(writer, self._probe.positions)
        declare_body(writer, *self._mesh)
        if self._directions is not None:
            declare_directions(writer, *self._directions)
        for stream, example in values.items():
            single = self.single_precision and stream == "states"
            declare(writer, stream, example, frame=frame, single=single)
        writer.start()

    def start(self, model: Model, stage: str, steps: int, first: Record) -> None:
        """Create the file and write the mesh and the first record (collective)."""
        self._prepare(model, first)
        facts = {"stage": stage, "steps": steps, **self._facts(model)}
        fixed = first.free_surface is None and not model.constraints.moves
        facts["displacements"] = RELATIVE if first.motion is not None or fixed else ABSOLUTE
        static = self._series.collect(first)
        block, state = self._series.take(), self._values(first, static)
        forces = self._series.resultants
        stages = [self._stage_fields.values(record) for record in first.stages]
        examples = {s: {name: rows[0] for name, rows in v.items()} for s, v in block[1].items()}
        examples |= {"states": state} | ({"statics": stages[0]} if stages else {})
        examples |= self._ending()
        rows = dict.fromkeys(("histories", "energy", "joints", "resultants"), steps + 1)
        rows |= {"statics": len(stages), "states": steps // self.every + 1}
        rows |= {"envelopes": 1, "joint_maxima": 1}

        def create() -> None:
            facts["manifest"] = manifest(
                model, first.settings, self._mesh_sha256, first.stages, self._resolved
            )
            replaces = self.overwrite or (
                self._stages is not None and contains_only_statics(self._path)
            )
            self._writer = writer = ResultsWriter(self._path, facts, overwrite=replaces, rows=rows)
            if self._has_backup:
                self._backup.unlink(missing_ok=True)
            if forces is not None:
                forces.declare(writer)
            self._begin(writer, examples, facts["displacements"])

        try:
            sides = None if forces is None else forces.sides
            with handing_out(self._comm, self._mesh, self._directions, sides):
                if self._comm.rank == 0:
                    create()
            for number, row in enumerate(stages, start=1):
                self._append("statics", number, row)
            self._append("states", first.time, state)
            self._extend(block, flush=True)
            if self._envelopes is not None:
                self._envelopes.see(first.displacement, first.time)
        except BaseException as error:
            if self._writer is not None:
                self._writer.__exit__(type(error), error, None)
                self._writer = None
            raise

    def _facts(self, model: Model) -> dict[str, Any]:
        probes = zip(self._points.items(), self._probe.sides, strict=True)
        return {
            "point_names": list(self._points),
            "points": {name: {**asdict(p), "sides": sides} for (name, p), sides in probes},
            "dofs": model.num_dofs,
            "joint_points": model.operator.num_points if model.operator else 0,
            "ranks": self._comm.size,
            "units": "SI: m, s, N, Pa, J",
            "laws": strengths(model.contact) if model.contact else {},
            **(self.metadata or {}),
        }

    def _prepare_body(self, model: Model) -> None:
        """Prepare nodes, points, supports and joints of the model, once (collective)."""
        if self._prepared_model is model:
            return
        self.check(model)
        self._comm, self._nodes = model.jointed.mesh.comm, NodeNumbering(model.V)
        self._probe = PointProbe(model, list(self._points.values()), self._nodes)
        notes = [f"{n} {m}" for n, m in zip(self._points, self._probe.notes, strict=True) if m]
        texts = [f"Monitored points: {'; '.join(notes)}."] if notes else []
        self._warnings = [*(self._doubts or ()), *texts]
        if texts and self._comm.rank == 0:
            warn(texts[0])
        self._envelopes = self._directions = None
        if self.envelopes:
            groups = None if isinstance(self.envelopes, bool) else self.envelopes
            self._envelopes = StressEnvelopes(model, self._nodes, groups, self._strengths)
            self._directions = self._envelopes.directions
        self._rows = None if model.operator is None else JointRows(model.operator)
        self._mesh, self._mesh_sha256 = body_mesh(model, self._nodes, self._rows)
        parts = self._nodes, self._rows, self._probe, self._envelopes
        self._stage_fields = StageFields(model, *parts)
        self._resolved = resolution(model)
        self._prepared_model = self._model = model

    def _prepare(self, model: Model, first: Record) -> None:
        """Prepare the model and the quantities of a dynamic stage (collective)."""
        self._prepare_body(model)
        self._in_dynamics = True
        if self._envelopes is not None:
            self._envelopes.begin()
        self._fields = Fields(model, self._nodes, self._rows, first.wet_joints)
        self._series = StepSeries(model, self._probe, first)
        self._series.static = self.static_part
        if self.resultants and self._rows is not None:
            forces = ResultantsStream(model, self._nodes, self._rows, first.wet_joints)
            self._series.resultants = forces
        if self.static_part and first.static_part is None:
            raise JointsError("static_part=True needs a DifferingMotion of the supports.")

    def state_dict(self) -> dict[str, Any]:
        """Flush the file; return record counts and data for the next record (collective)."""
        self._extend(self._series.take(), flush=True)
        columns = None if self._envelopes is None else self._envelopes.state_dict()
        series = self._series.state_dict()
        records: dict[str, int] = {}
        with raised_together(self._comm):
            if self._writer is not None:
                self._writer.to_disk()
                records = self._writer.records
        return series | {"records": records, "settings": self._settings, "envelopes": columns}

    @property
    def _settings(self) -> dict[str, Any]:
        """Settings that must not change when the file is continued."""
        points = {name: [*probe.place, probe.group] for name, probe in self._points.items()}
        faces = self.envelopes if isinstance(self.envelopes, bool) else list(self.envelopes)
        names = "every", "resultants", "static_part", "single_precision"
        strength = {group: asdict(given) for group, given in self._strengths.items()}
        settings = {"points": points, "envelopes": faces, "strength": strength}
        return settings | {name: getattr(self, name) for name in names}

    def resume(
        self, model: Model, stage: str, steps: int, last: Record, state_dict: Mapping[str, Any]
    ) -> None:
        """Continue the file and discard records after ``last`` (collective)."""
        for name, setting in self._settings.items():
            saved = state_dict["settings"][name]
            if saved != setting:
                raise OtherRunError(
                    f"{self._path} cannot be continued: the file was recorded with {name}={saved}, "
                    f"but this run has {name}={setting}."
                )
        self._prepare(model, last)
        self._series.load_state_dict(state_dict)
        if self._envelopes is not None:
            self._envelopes.load_state_dict(state_dict["envelopes"], last.time)
        with raised_together(self._comm):
            if self._comm.rank == 0:
                if self._backup.exists():
                    self._backup.replace(self._path)
                self._writer = ResultsWriter.resume(self._path, state_dict["records"])

    def record(self, record: Record) -> None:
        """Collect a step and a state, and write the collected steps if due (collective)."""
        static = self._series.collect(record)
        if record.step % self.every == 0:
            self._append("states", record.time, self._values(record, static))
        due = self._writer is not None and self._writer.due
        if self._comm.size > 1:
            due = self._comm.bcast(due)  # the clocks of the ranks differ
        if due or self._series.full:
            self._extend(self._series.take(), flush=due)
        if self._envelopes is not None:
            self._envelopes.see(record.displacement, record.time)

    def _values(self, record: Record, static: PETSc.Vec | None) -> dict[str, Any]:
        """Return the values of the stream ``states`` (collective)."""
        values = self._fields.values(record.displacement, record.joints, record.pressure)
        if static is not None:
            values[STATIC_PART] = self._nodes.across(self._nodes.dealt(static))
        if self._envelopes is not None:
            values |= self._envelopes.in_plane(record.displacement, record.time)
        return values

    def _extend(self, block: tuple[Sequence[float], Mapping[str, Any]], *, flush: bool) -> None:
        """Add the rows of steps on rank 0; an error is raised on all ranks."""
        with raised_together(self._comm):
            if self._writer is not None:
                self._writer.extend(*block)
                if flush:
                    self._writer.flush()

    def _append(self, stream: str, time: float, values: Mapping[str, Any]) -> None:
        """Append to a stream on rank 0; an error on rank 0 is raised on all ranks."""
        with handing_out(self._comm, values):
            if self._writer is not None:
                # A flush before the rows of all steps would let readers see states without them.
                self._writer.append(stream, time, values, flush=False)

    def _ending(self) -> dict[str, dict[str, Any]]:
        """Return the streams with a single record at the end of a run (collective)."""
        maxima = self._series.joint_maxima(self._rows)
        streams: dict[str, dict[str, Any]] = {"joint_maxima": maxima} if maxima else {}
        if self._envelopes is not None:
            streams["envelopes"] = self._envelopes.values()
        return streams

    def finish(self, status: str, summary: dict[str, Any]) -> None:
        """Write the envelopes and the joint maxima, and close the file (collective)."""
        warnings = summary.get("warnings", [])
        if new := [text for text in self._warnings if text not in warnings]:
            summary = summary | {"warnings": [*new, *warnings]}
        block, streams = self._series.take(), self._ending()
        with handing_out(self._comm, streams):
            if self._writer is not None:
                writer, self._writer = self._writer, None
                with writer:
                    writer.extend(*block)
                    for stream, values in streams.items():
                        writer.append(stream, self._series.last[0], values)
                    writer.finish(status, summary)  # type: ignore[arg-type]
