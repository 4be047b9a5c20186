# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Monitor that writes body and joints for ParaView."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

import annotated_types as at
import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.common.file_lock import FileLock, released
from dolfinx_joints.common.mpi import on_root, raised_together
from dolfinx_joints.export.grids import Grid, StaticArrays, joined, joint_grid, uniform_grid
from dolfinx_joints.export.paraview import joints_path, values_of_all
from dolfinx_joints.export.vtk_files import SUFFIX, DamagedFileError, VtkFile, check_free, vtk_path
from dolfinx_joints.loads.water.pressures_in_joints import water_in_joints
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.body_cells import CellGather, body_cells
from dolfinx_joints.monitors.cell_fields import CellFields
from dolfinx_joints.monitors.fields import Fields
from dolfinx_joints.monitors.probes import boundary_facets, joint_statics
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.record import Record, StageRecord


@dataclass(eq=False)
@checked
class FieldMonitor(Monitor):
    """Writes body and joints for ParaView (VTKHDF); other programs may read them between times.

    ``NAME.vtkhdf`` holds the cells of the body, of the degree of the displacement, with
    ``displacement [m]`` and ``stress [Pa]`` (xx, yy, zz, xy, yz, xz) with its largest and smallest
    principal values, those in the middle of elastic cells and the means of plastic ones; also
    ``temperature change [K]`` and ``accumulated plastic strain [-]`` where the model has them.
    ``NAME_joints.vtkhdf`` holds the joints as `export.write_vtk` writes them. Static stages are in
    ``NAME_stages.vtkhdf`` and ``NAME_stages_joints.vtkhdf``, with the stage's number as time. A
    continued run goes on with its files. A kill loses no more than the time that is being
    written, as `export.vtk_files.VtkFile` says in full; a file damaged otherwise becomes
    ``NAME.damaged`` in a continued run, which says so and begins a new one.

    Args:
        path: ``NAME.vtkhdf``, or ``NAME``.
        every: Steps between two times.
        overwrite: Replace existing files.
    """

    path: str | PathLike[str]
    _: KW_ONLY
    every: Annotated[int, at.Ge(1)] = 10
    overwrite: bool = False

    def __post_init__(self) -> None:
        """Keep the settings; files are written from the start of the run on."""
        self._path = vtk_path(self.path)
        self._stages_path = self._path.with_name(f"{self._path.stem}_stages{SUFFIX}")
        self._lock: FileLock | None = None
        self._found: Model | None = None
        self._files: list[VtkFile] = []

    def static_stage(self, model: Model, stages: Sequence[StageRecord]) -> None:
        """Add a stage to the file of stages (collective)."""
        self._find(model)
        stage, number = stages[-1], len(stages)
        self._fields = Fields(model, self._nodes, self._wet)
        self._open(self._stages_path, number - 1 if number > 1 else None)
        with released(self._lock, at_end=True):
            pressure = stage.pressure
            values = self._fields.values(
                stage.state.displacement,
                stage.state.joints,
                None if pressure is None else lambda: pressure,
            )
            state, loads = stage.state, stage.loads
            cells = self._cells(state.displacement, state.joints, stage.time, loads)
            self._append(number, values, cells)

    def start(self, model: Model, stage: str, steps: int, first: Record) -> None:
        """Create the files and write the first time (collective)."""
        self._begin(model, first, None)
        with released(self._lock, at_end=False):
            self.record(first)

    def resume(
        self, model: Model, stage: str, steps: int, last: Record, state_dict: Mapping[str, Any]
    ) -> None:
        """Go on with the files after ``last`` (collective)."""
        self._begin(model, last, last.time)

    def _begin(self, model: Model, record: Record, last: float | None) -> None:
        self._find(model)
        self._fields = Fields(model, self._nodes, record.wet_joints)
        self._open(self._path, last)

    def _find(self, model: Model) -> None:
        """Grids of body and joints, once (collective)."""
        if self._found is model:
            return
        self._nodes = NodeNumbering(model.V)
        cells = body_cells(model, self._nodes)
        self._cells = CellFields(model, CellGather(model))
        self._wet = tuple(dict.fromkeys(load.joint for load in water_in_joints(model.loads)))
        grids = joint_grids(model, self._nodes)
        self._names, self._grids = list(grids), list[Grid]()
        self._comm, self._found = model.jointed.mesh.comm, model
        if cells is not None:  # on the rank that writes
            nodes = np.asarray(cells.nodes)
            groups = {name: np.asarray(rows) for name, rows in cells.groups.items()}
            self._grids.append(uniform_grid(self._nodes.positions, nodes, cells.kind, groups))
            if grids:
                self._grids.append(joined(grids))

    def _open(self, path: Path, last: float | None) -> None:
        """Create files that no other run writes, or go on after a time (collective)."""

        def take() -> None:
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise ResultsError(f"{path} cannot be written: {error}.") from None
            self._lock = FileLock(path, ResultsError)
            places = [path, joints_path(path)][: len(self._grids)]
            with released(self._lock, at_end=False):
                if last is None:
                    check_free(places, overwrite=self.overwrite)
                pairs = zip(places, self._grids, strict=True)
                self._files = [_opened(place, grid, last) for place, grid in pairs]

        on_root(self._comm, take)

    def record(self, record: Record) -> None:
        """Append a time (collective)."""
        if record.step % self.every:
            return
        values = self._fields.values(record.displacement, record.joints, record.pressure)
        cells = self._cells(record.displacement, record.joints, record.time)
        self._append(record.time, values, cells)

    def _append(self, time: float, values: dict[str, Any], cells: dict[str, Any]) -> None:
        """Write on the rank that does; what goes wrong there stops every rank."""
        with raised_together(self._comm):
            if self._files:
                body, *joints = self._files
                u = values["displacement"]
                body.append(time, {"displacement [m]": u}, cells)
                for file in joints:
                    moved = {"displacement [m]": self._grids[1].motion @ u}
                    file.append(time, moved, values_of_all(values, self._names))

    def finish(self, status: str, summary: dict[str, Any]) -> None:
        """Let others write the files (collective)."""
        with released(self._lock, at_end=True):
            pass


def _opened(path: Path, grid: Grid, last: float | None) -> VtkFile:
    """A new file, or what there is up to a time."""
    if last is None or not path.exists():
        return VtkFile(path, grid)
    try:
        return VtkFile.resume(path, grid, last)
    except DamagedFileError as error:
        aside = path.with_name(f"{path.name}.damaged")
        warnings.warn(f"{error} It is now {aside}; a new file begins here.", stacklevel=2)
        path.replace(aside)
        return VtkFile(path, grid)


def joint_grids(model: Model, nodes: NodeNumbering) -> dict[str, Grid]:
    """Grid of each joint, on rank 0 (collective)."""
    surface, joints = boundary_facets(model, nodes), joint_statics(model)
    if model.jointed.mesh.comm.rank > 0:
        return {}
    arrays = StaticArrays({"mesh/nodes": nodes.positions, "mesh/surface": surface})
    arrays |= {f"joints/{j}/{k}": v for j, each in joints.items() for k, v in each.items()}
    return {name: joint_grid(arrays, name) for name in joints}
