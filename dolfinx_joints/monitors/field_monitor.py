# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Monitor that writes body and joints to ParaView files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

import annotated_types as at
import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ResultsError, warn
from dolfinx_joints.common.files import FileLock, released
from dolfinx_joints.common.mpi import RowsAt, across, blocks_of, dealt, handing_out, summed
from dolfinx_joints.export.grids import (
    Grid,
    StaticArrays,
    joined,
    joint_grid,
    joint_values,
    uniform_grid,
)
from dolfinx_joints.export.paraview import SUFFIX, DamagedFileError, VtkFile, check_free, vtk_path
from dolfinx_joints.laws.law import Response
from dolfinx_joints.loads.water.pressures_in_joints import water_in_joints
from dolfinx_joints.loads.water.water import Water
from dolfinx_joints.mesh.jointed_mesh import local_cells
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.body_cells import CellOrder, cells_of_rank
from dolfinx_joints.monitors.cell_fields import CellFields
from dolfinx_joints.monitors.fields import Fields
from dolfinx_joints.monitors.joint_rows import JointRows
from dolfinx_joints.monitors.probes import facets_of_cells
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.record import Record, StageRecord

# Point values and cell values, by name.
Values = tuple[Mapping[str, Any], Mapping[str, Any]]

# Endings of the file names.
BODY, JOINTS, RESERVOIR = "", "_joints", "_reservoir"


@dataclass(eq=False)
@checked
class FieldMonitor(Monitor):
    """Writes body and joints for ParaView (VTKHDF); files may be read while the run continues.

    ``NAME.vtkhdf`` contains the cells of the body as Lagrange cells of the same degree as the
    displacement. The values are ``displacement [m]``, ``stress [Pa]`` (xx, yy, zz, xy, yz, xz), and
    the largest and smallest principal stress. The stress of an elastic cell is the value at its
    centre, the stress of a nonlinear cell the mean over the cell. Depending on the model there are
    also ``temperature change [K]`` and the scalar internal variables of materials by name.

    ``NAME_joints.vtkhdf`` contains the joints as in `export.write_vtk`. ``NAME_reservoir.vtkhdf``
    contains the cells of a reservoir with waves; the ``hydrodynamic pressure [Pa]`` excludes the
    hydrostatic pressure. ``NAME_stages.vtkhdf`` and ``NAME_stages_joints.vtkhdf`` contain the
    static stages, with the stage number as time.

    A continued run appends to the files of the interrupted run. A killed run loses at most the
    state being written (see `export.paraview.VtkFile`). If a file is damaged, a continued run
    renames it to ``NAME.damaged``, warns and creates a new file.

    Args:
        path: ``NAME.vtkhdf``, or ``NAME``.
        every: Steps between two written states.
        overwrite: Replace existing files.

    Example:
        >>> from pathlib import Path
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.frictionless(normal_stiffness=1e11)
        >>> base = [dj.Fixed(group="base")]
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=base, loads=[dj.Gravity()])
        >>> run = dj.Simulation(model, monitors=[dj.FieldMonitor("blocks.vtkhdf", every=10)])
        >>> state = run.statics()
        >>> sorted(path.name for path in Path().glob("*.vtkhdf"))
        ['blocks_stages.vtkhdf', 'blocks_stages_joints.vtkhdf']
    """

    path: str | PathLike[str]
    _: KW_ONLY
    every: Annotated[int, at.Ge(1)] = 10
    overwrite: bool = False

    def __post_init__(self) -> None:
        """Check the path; files are created with the first stage or state."""
        self._path = vtk_path(self.path)
        self._stages_path = self._path.with_name(f"{self._path.stem}_stages{SUFFIX}")
        self._lock: FileLock | None = None
        self._prepared_model: Model | None = None
        self._files: dict[str, VtkFile] = {}

    def static_stage(self, model: Model, stages: Sequence[StageRecord]) -> None:
        """Add a stage to the files of static stages (collective)."""
        self._prepare(model)
        stage, number = stages[-1], len(stages)
        self._fields = Fields(model, self._nodes, self._joint_order, self._wet)
        endings = [ending for ending in self._grids if ending != RESERVOIR]
        self._open(self._stages_path, number - 1 if number > 1 else None, endings)
        with released(self._lock, at_end=True):
            state, pressure = stage.state, stage.pressure
            water = None if pressure is None else lambda: pressure
            cells = self._cell_fields(
                state.displacement, state.joints, stage.time, stage.loads, state.absent
            )
            values = self._values(state.displacement, state.joints, water, cells)
            self._append(number, values)

    def start(self, model: Model, stage: str, steps: int, first: Record) -> None:
        """Create the files and write the first state (collective)."""
        self._begin(model, first, None)
        with released(self._lock, at_end=False):
            self.record(first)

    def resume(
        self, model: Model, stage: str, steps: int, last: Record, state_dict: Mapping[str, Any]
    ) -> None:
        """Continue the files after the state ``last`` (collective)."""
        self._begin(model, last, last.time)

    def _begin(self, model: Model, record: Record, last: float | None) -> None:
        self._prepare(model)
        self._fields = Fields(model, self._nodes, self._joint_order, record.wet_joints)
        self._open(self._path, last, list(self._grids))

    def _prepare(self, model: Model) -> None:
        """Prepare the grids of body, joints and water, once (collective)."""
        if self._prepared_model is model:
            return
        self._comm, self._nodes = model.jointed.mesh.comm, NodeNumbering(model.V)
        self._cells = CellOrder(model)
        self._cell_fields = CellFields(model, self._cells)
        self._wet = tuple(dict.fromkeys(load.joint for load in water_in_joints(model.loads)))
        kind, cells, members = cells_of_rank(model, self._nodes, self._cells)
        groups = {name: np.flatnonzero(marks) for name, marks in members.items()}
        body = uniform_grid(self._nodes.positions, cells, kind, groups)
        self._grids, self._joint_order = {BODY: grid_across(self._comm, body)}, None
        if model.operator is not None:
            self._joint_order = JointRows(model.operator)
            self._joints, self._facet_rows = joint_grid_of_rank(
                model, self._nodes, self._joint_order
            )
            first = int(blocks_of(self._comm, len(self._joints.points))[self._comm.rank])
            self._grids[JOINTS] = grid_across(self._comm, self._joints, first)
        if model.coupled is not None:
            water = model.coupled.water
            self._grids[RESERVOIR] = reservoir_grid(water)
            self._level_points = len(self._grids[RESERVOIR].points) - water.size
        self._prepared_model = model

    def _open(self, path: Path, last: float | None, endings: Sequence[str]) -> None:
        """Create files, or continue them after time ``last``; lock out other runs (collective)."""

        def lock_and_open() -> None:
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise ResultsError(f"{path} cannot be written: {error}.") from None
            self._lock = FileLock(path, ResultsError)
            paths = {end: path.with_name(f"{path.stem}{end}{SUFFIX}") for end in endings}
            with released(self._lock, at_end=False):
                if last is None:
                    check_free(paths.values(), overwrite=self.overwrite)
                self._files = {
                    ending: _open_file(file, self._grids[ending], last)
                    for ending, file in paths.items()
                }

        with handing_out(self._comm, [vars(grid) for grid in self._grids.values()]):
            if self._comm.rank == 0:
                lock_and_open()

    def record(self, record: Record) -> None:
        """Append a state (collective)."""
        if record.step % self.every:
            return
        cells = self._cell_fields(record.displacement, record.joints, record.time)
        values = self._values(record.displacement, record.joints, record.pressure, cells)
        if record.reservoir_pressure is not None:
            # The last rank adds the points at the water level, where the pressure is zero.
            is_last = self._comm.rank == self._comm.size - 1
            zeros = np.zeros(self._level_points if is_last else 0)
            waves = across(self._comm, np.append(record.reservoir_pressure(), zeros))
            values[RESERVOIR] = ({"hydrodynamic pressure [Pa]": waves}, {})
        self._append(record.time, values)

    def _append(self, time: float, values: Mapping[str, Values]) -> None:
        """Append a state on rank 0; an error on rank 0 is raised on all ranks (collective)."""
        fixed = [grid.cell_data for grid in self._grids.values()]
        with handing_out(self._comm, values, fixed):
            for ending, file in self._files.items():
                file.append(np.array([time]), *values[ending])

    def _values(
        self,
        u: PETSc.Vec,
        joints: Response | None,
        pressure: Callable[[], Floats] | None,
        cell_values: dict[str, NDArray[Any]],
    ) -> dict[str, Values]:
        """Return point values and cell values of body and joints, by file ending (collective)."""
        name, rows = "displacement [m]", self._nodes.dealt(u)
        values: dict[str, Values] = {
            BODY: (
                {name: self._nodes.across(rows)},
                {key: self._cells.across(part) for key, part in cell_values.items()},
            )
        }
        if self._joint_order is not None:
            displacement = self._joints.motion @ self._facet_rows(rows)
            facet_values = joint_values(
                self._ordered_joint_values(joints, pressure),
                self._joints.cell_data,
                len(self._joint_order.names),
                partial(summed, self._comm),
            )
            parts = {key: across(self._comm, part) for key, part in facet_values.items()}
            values[JOINTS] = ({name: across(self._comm, displacement)}, parts)
        return values

    def _ordered_joint_values(
        self, joints: Response | None, pressure: Callable[[], Floats] | None
    ) -> dict[str, NDArray[Any]]:
        """Return joint values by quantity, in the order of `JointRows` (collective).

        Values are NaN in joints that do not have the quantity.
        """
        assert self._joint_order is not None
        values = self._fields.joint_rows(joints, pressure)
        for quantity, local_values in values.items():
            missing = [
                not self._fields.has_values(quantity, name) for name in self._joint_order.names
            ]
            if any(missing):
                values[quantity] = local_values.astype(float)
                values[quantity][np.array(missing)[self._joint_order.joint]] = np.nan
        return values

    def finish(self, status: str, summary: dict[str, Any]) -> None:
        """Close and unlock the files (collective)."""
        for file in self._files.values():
            file.close()
        if self._lock is not None:
            self._lock.release()


def _open_file(path: Path, grid: Grid, last: float | None) -> VtkFile:
    """Return a new file, or the existing file to be continued after the time ``last``."""
    if last is None or not path.exists():
        return VtkFile(path, grid)
    try:
        return VtkFile.resume(path, grid, last)
    except DamagedFileError as error:
        renamed = path.with_name(f"{path.name}.damaged")
        warn(f"{error} The file was renamed to {renamed}; a new file starts at this time.")
        path.replace(renamed)
        return VtkFile(path, grid)


def reservoir_grid(water: Water) -> Grid:
    """Return the grid of the water; the points at the water level come last.

    The pressure at the water level is zero, all other pressures are unknowns.
    """
    cells = water.cells()
    points = np.zeros((water.size + len(cells.surface), 3))
    points[:, : water.places.shape[1]] = np.concatenate([water.places, cells.surface])
    return uniform_grid(points, cells.nodes, cells.kind, {})


def joint_grid_of_rank(model: Model, nodes: NodeNumbering, rows: JointRows) -> tuple[Grid, RowsAt]:
    """Return this rank's part of the grid of all joints (collective).

    Returns:
        The grid, whose matrix ``motion`` maps displacements of facet nodes to displacements of grid
        points, and a `RowsAt` that collects the values of these nodes from all ranks.
    """
    comm, pairs = model.jointed.mesh.comm, model.jointed.pairs
    sides = [
        facets_of_cells(model, nodes, local_cells(model.jointed.mesh, side[:, 0]), side[:, 1])
        for side in (pairs.minus, pairs.plus)
    ]
    both = dealt(comm, pairs.count, pairs.number, np.stack(sides, axis=1))
    surface = np.unique(both.reshape(-1, both.shape[2]), axis=0)
    facet_nodes, numbers = np.unique(surface, return_inverse=True)
    exchange = RowsAt(comm, len(nodes.positions), facet_nodes)
    arrays = StaticArrays({"mesh/nodes": exchange(nodes.positions)})
    arrays["mesh/surface"] = numbers.reshape(surface.shape)
    for name, joint_arrays in rows.constant_arrays(local=True).items():
        arrays |= {f"joints/{name}/{key}": values for key, values in joint_arrays.items()}
    return joined({name: joint_grid(arrays, name) for name in rows.names}), exchange


def grid_across(comm: Any, grid: Grid, first: int = 0) -> Grid:
    """Join the grids of all ranks; the result has no matrix ``motion`` (collective).

    Args:
        comm: Communicator.
        grid: Grid of this rank.
        first: Global number of this rank's first point.
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
