# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Monitor that writes body and joints for ParaView."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import annotated_types as at
import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.common.file_lock import FileLock, released
from dolfinx_joints.common.mpi import RowsAt, across, blocks_of, dealt, handing_out
from dolfinx_joints.export.grids import (
    Grid,
    StaticArrays,
    joined,
    joint_grid,
    joint_values,
    uniform_grid,
)
from dolfinx_joints.export.paraview import joints_path
from dolfinx_joints.export.vtk_files import SUFFIX, DamagedFileError, VtkFile, check_free, vtk_path
from dolfinx_joints.laws.law import Response
from dolfinx_joints.loads.water.pressures_in_joints import water_in_joints
from dolfinx_joints.mesh.jointed_mesh import local_cells
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.body_cells import CellOrder, own_cells
from dolfinx_joints.monitors.cell_fields import CellFields
from dolfinx_joints.monitors.fields import Fields
from dolfinx_joints.monitors.joint_rows import JointRows
from dolfinx_joints.monitors.probes import facets_of_cells
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.record import Record, StageRecord

Floats = NDArray[np.float64]


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
        self._fields = Fields(model, self._nodes, self._rows, self._wet)
        self._open(self._stages_path, number - 1 if number > 1 else None)
        with released(self._lock, at_end=True):
            state, pressure = stage.state, stage.pressure
            water = None if pressure is None else lambda: pressure
            cells = self._cell_fields(state.displacement, state.joints, stage.time, stage.loads)
            self._append(number, state.displacement, state.joints, water, cells)

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
        self._fields = Fields(model, self._nodes, self._rows, record.wet_joints)
        self._open(self._path, last)

    def _find(self, model: Model) -> None:
        """Grids of body and joints, once (collective)."""
        if self._found is model:
            return
        self._comm, self._nodes = model.jointed.mesh.comm, NodeNumbering(model.V)
        self._cells = CellOrder(model)
        self._cell_fields = CellFields(model, self._cells)
        self._wet = tuple(dict.fromkeys(load.joint for load in water_in_joints(model.loads)))
        kind, own, inside = own_cells(model, self._nodes, self._cells)
        groups = {name: np.flatnonzero(each) for name, each in inside.items()}
        body = uniform_grid(self._nodes.positions, own, kind, groups)
        self._grids, self._rows = [grid_across(self._comm, body)], None
        if model.operator is not None:
            self._rows = JointRows(model.operator)
            joints = joint_grid_of_rank(model, self._nodes, self._rows)
            self._motion, self._moved = joints.grid.motion, joints.nodes
            first = int(blocks_of(self._comm, len(joints.grid.points))[self._comm.rank])
            self._grids.append(grid_across(self._comm, joints.grid, first))
        self._found = model

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

        with handing_out(self._comm, [vars(grid) for grid in self._grids]):
            if self._comm.rank == 0:
                take()

    def record(self, record: Record) -> None:
        """Append a time (collective)."""
        if record.step % self.every:
            return
        cells = self._cell_fields(record.displacement, record.joints, record.time)
        self._append(record.time, record.displacement, record.joints, record.pressure, cells)

    def _append(
        self,
        time: float,
        u: PETSc.Vec,
        joints: Response | None,
        pressure: Callable[[], Floats] | None,
        of_cells: dict[str, NDArray[Any]],
    ) -> None:
        """Write on rank 0; what goes wrong there stops every rank (collective)."""
        name, rows = "displacement [m]", self._nodes.dealt(u)
        values: list[tuple[dict[str, Any], dict[str, Any]]] = [
            (
                {name: self._nodes.across(rows)},
                {what: self._cells.across(each) for what, each in of_cells.items()},
            )
        ]
        if self._rows is not None:
            moved = self._motion @ self._moved(rows)
            found = joint_values(self._of_joints(joints, pressure))
            parts = {what: across(self._comm, each) for what, each in found.items()}
            values.append(({name: across(self._comm, moved)}, parts))
        fixed = [grid.cell_data for grid in self._grids]
        with handing_out(self._comm, values, fixed):
            for file, (points, cells) in zip(self._files, values, strict=False):
                file.append(time, points, cells)

    def _of_joints(
        self, joints: Response | None, pressure: Callable[[], Floats] | None
    ) -> dict[str, NDArray[Any]]:
        """Values of this rank's rows; what only some joints have is NaN in others (collective)."""
        assert self._rows is not None
        values = self._fields.of_joints(joints, pressure)
        for what, each in values.items():
            without = [not self._fields.concerned(what, name) for name in self._rows.names]
            if any(without):
                values[what] = each.astype(float)
                values[what][np.array(without)[self._rows.joint]] = np.nan
        return values

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


class JointsOfRank(NamedTuple):
    """The joints as a grid, of the facets dealt to a rank.

    Attributes:
        grid: The grid; its motion is that from the nodes of these facets.
        nodes: Gives the rows of these nodes from those dealt to the ranks.
    """

    grid: Grid
    nodes: RowsAt


def joint_grid_of_rank(model: Model, nodes: NodeNumbering, rows: JointRows) -> JointsOfRank:
    """The rank's part of the grid of all joints (collective)."""
    comm, pairs = model.jointed.mesh.comm, model.jointed.pairs
    sides = [
        facets_of_cells(model, nodes, local_cells(model.jointed.mesh, side[:, 0]), side[:, 1])
        for side in (pairs.minus, pairs.plus)
    ]
    both = dealt(comm, pairs.count, pairs.number, np.stack(sides, axis=1))
    surface = np.unique(both.reshape(-1, both.shape[2]), axis=0)
    near, numbers = np.unique(surface, return_inverse=True)
    at = RowsAt(comm, len(nodes.positions), near)
    arrays = StaticArrays({"mesh/nodes": at(nodes.positions)})
    arrays["mesh/surface"] = numbers.reshape(surface.shape)
    for name, each in rows.own_statics().items():
        arrays |= {f"joints/{name}/{what}": values for what, values in each.items()}
    return JointsOfRank(joined({name: joint_grid(arrays, name) for name in rows.names}), at)


def grid_across(comm: Any, grid: Grid, first: int = 0) -> Grid:
    """The grid of all ranks from their parts, but for the motion of their points (collective).

    Args:
        comm: Communicator.
        grid: Part of this rank.
        first: Number of the point that ``connectivity`` has for its first.
    """
    begin = blocks_of(comm, len(grid.connectivity))[comm.rank]
    offsets = np.asarray(grid.offsets) + begin
    return Grid(
        points=across(comm, np.asarray(grid.points)),
        connectivity=across(comm, np.asarray(grid.connectivity) + first),
        offsets=across(comm, offsets if comm.rank == 0 else offsets[1:]),
        kinds=across(comm, np.asarray(grid.kinds)),
        cell_data={name: across(comm, np.asarray(v)) for name, v in grid.cell_data.items()},
    )
