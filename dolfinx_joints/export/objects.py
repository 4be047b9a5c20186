# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results as pandas data frames, xarray datasets and PyVista grids."""

from __future__ import annotations

import importlib
from collections.abc import Collection
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.export.grids import Grid, body_grid, joint_grid
from dolfinx_joints.export.paraview import values_of
from dolfinx_joints.export.tables import TABLES, tables_of
from dolfinx_joints.results.arguments import COMPONENTS, check_results, chosen_state
from dolfinx_joints.results.joint_points import tied_points
from dolfinx_joints.results.reader import Results, listing

if TYPE_CHECKING:
    from pandas import DataFrame
    from pyvista import MultiBlock
    from xarray import Dataset

_EXTRAS = {"pandas": "tables", "xarray": "tables", "pyvista": "views"}


def _import(package: str) -> Any:
    """Import an optional package.

    Raises:
        ImportError: The package is missing.
    """
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise ImportError(
            f"{package} is missing ({error}): pip install {package}, or install dolfinx_joints "
            f"with the extra {_EXTRAS[package]!r}."
        ) from error


if TYPE_CHECKING:
    TableName = str
else:
    TableName = Literal[tuple(TABLES)]


@checked
def to_pandas(results: Results, table: TableName = "histories") -> DataFrame:
    """Return a table of a results file, with the contents of `write_csv`.

    Column names include the unit: ``displacement of crest from the static state x [m]``. A table
    with one row per time is indexed by the time. ``frame.attrs["file"]`` is the path of the results
    file.

    Args:
        results: The run.
        table: Name of the table.

    Raises:
        ResultsError: The file has no data for the table.
        ImportError: pandas is missing.
    """
    pandas = _import("pandas")
    tables = tables_of(results, table)
    if not tables:
        available = listing(tables_of(results))
        raise ResultsError(f"{results.path} has no table {table!r}; it has {available}.")
    columns = tables[table]
    frame = pandas.DataFrame(columns.rows, columns=columns.header)
    if columns.header[0] == "time [s]":
        frame = frame.set_index("time [s]")
    frame.attrs["file"] = str(results.path)
    return frame


StreamName = Literal["histories", "energy", "states", "joints"]
_AXES = ("n", "s1", "s2")  # local axes of a joint


@checked
def to_xarray(results: Results, stream: StreamName = "histories") -> Dataset:
    """Return a stream of a results file as a dataset.

    Variables are the series of the file with the attributes ``units`` and ``long_name``.

    - ``histories``: dimensions ``time``, ``point`` (names; coordinates ``x``, ``y``, ``z``) and
      ``component`` (x, y, z; forces in a plane model have NaN in z);
    - ``energy``, ``joints``: ``time``, and ``component`` for vectors;
    - ``states``: ``displacement`` with ``time``, ``node``, ``component``. The points of all joints
      form one dimension: ``gap``, ``traction``, ``status`` have ``time``, ``joint_point`` and
      ``axis`` (n, s1, s2). Coordinates of ``joint_point`` are ``joint``, ``area``, ``tied`` (True
      if both sides share their nodes), ``joint_x``, ``joint_y`` and ``joint_z``.

    Args:
        results: The run.
        stream: Name of the stream.

    Raises:
        ResultsError: The file does not contain the stream.
        ImportError: xarray is missing.
    """
    xarray = _import("xarray")
    check_results(results)
    if stream not in results.streams:
        available = listing(results.streams)
        raise ResultsError(f"{results.path} has no stream {stream!r}; it has {available}.")
    rows = results.rows(stream)
    builder = _Builder(results, stream, rows)
    names = results.streams[stream]
    of_points = [name for name in names if stream == "states" and name.startswith("joints/")]
    for name in names:
        if name not in of_points:
            builder.add(name)
    if of_points:
        builder.add_joint_points({name.rpartition("/")[2] for name in of_points})
    return xarray.Dataset(builder.variables, builder.coordinates, {"file": str(results.path)})


class _Builder:
    """Variables and coordinates of a stream, in the form of xarray's arguments."""

    def __init__(self, results: Results, stream: str, rows: int) -> None:
        self._results, self._stream, self._rows = results, stream, rows
        self.variables: dict[str, Any] = {}
        times = results.time(stream)[:rows]
        self.coordinates: dict[str, Any] = {"time": ("time", times, {"units": "s"})}

    def add(self, name: str) -> None:
        """Add a series; the shape of its records determines its dimensions."""
        values = self._results.series(self._stream, name, slice(self._rows))
        if values.ndim == 3:
            dimension, places = "node", "mesh/nodes"
            if self._stream == "histories":
                dimension, places = "point", "histories/points"
                self.coordinates["point"] = self._results.point_names
            self._coordinates(dimension, "", self._results.static(places))
            dims: tuple[str, ...] = ("time", dimension, "component")
        else:
            dims = ("time", "component")[: values.ndim]
        if "component" in dims:
            self.coordinates["component"] = list(COMPONENTS)
            missing = len(COMPONENTS) - values.shape[-1]  # a plane force has no z
            if missing:
                padding = np.full((*values.shape[:-1], missing), np.nan)
                values = np.concatenate([values, padding], axis=-1)
        self.variables[name] = (dims, values, self._attributes(name))

    def add_joint_points(self, names: set[str]) -> None:
        """Add series of the points of one joint after the other, NaN for joints without them."""
        results, joints = self._results, self._results.joints
        static = {
            name: [results.static(f"joints/{joint}/{name}") for joint in joints]
            for name in ("points", "areas")
        }
        counts = [len(points) for points in static["points"]]
        self.coordinates["joint"] = ("joint_point", np.repeat(joints, counts))
        self.coordinates["area"] = (
            "joint_point",
            np.concatenate(static["areas"]),
            {"units": "m^2"},
        )
        tied = [tied_points(results, joint) for joint in joints]
        self.coordinates["tied"] = ("joint_point", np.concatenate(tied))
        self._coordinates("joint_point", "joint_", np.concatenate(static["points"]))
        self.coordinates["axis"] = list(_AXES)
        for name in sorted(names):
            parts, first = [], ""
            for joint, count in zip(joints, counts, strict=True):
                where = f"joints/{joint}/{name}"
                if where in results.streams["states"]:
                    parts.append(results.series("states", where, slice(self._rows)))
                    first = first or where
                else:
                    parts.append(np.full((self._rows, count), np.nan))
            values = np.concatenate(parts, axis=1)
            dims = ("time", "joint_point", "axis")[: values.ndim]
            self.variables[name] = (dims, values, self._attributes(first))

    def _attributes(self, name: str) -> dict[str, str]:
        unit = self._results.unit(self._stream, name)
        return {"units": unit, "long_name": self._results.description(self._stream, name)}

    def _coordinates(self, dimension: str, prefix: str, places: Any) -> None:
        for axis, values in zip(COMPONENTS, places.T, strict=True):
            self.coordinates[prefix + axis] = (dimension, values, {"units": "m"})


@checked
def to_pyvista(
    results: Results,
    *,
    time: float | None = None,
    index: int = -1,
    stage: int | str | None = None,
    groups: Collection[str] | None = None,
) -> MultiBlock:
    """Return body and joints in a recorded state.

    The block ``"body"`` has the displacement of the nodes. The block ``"joints"`` has one block per
    joint, with one polygon per joint point and its gap, traction and status. Names and units are
    the same as in `paraview.write_vtk`.

        blocks = export.to_pyvista(dj.Results("dam.h5"), time=0.5)
        body, joints = blocks["body"], blocks["joints"].combine()
        plotter = pyvista.Plotter()
        plotter.add_mesh(body.warp_by_vector("displacement [m]", factor=200.0), opacity=0.4)
        joints = joints.warp_by_vector("displacement [m]", factor=200.0)
        plotter.add_mesh(joints, scalars="opening [m]")

    Args:
        results: The run.
        time: Time [s]; the nearest state is used.
        index: Number of the state if no time is given, negative from the end.
        stage: Name or number of a static stage, instead of a time.
        groups: Names of cell groups of the body; all cells by default.

    Raises:
        ResultsError: The file has no cells, or not these groups.
        ImportError: PyVista is missing.
    """
    pyvista = _import("pyvista")
    results, number, _ = chosen_state(results, time, index, stage)
    body = _grid(pyvista, body_grid(results, groups))
    displacement = results.series("states", "displacement", number)
    body.point_data["displacement [m]"] = displacement
    if groups is not None:
        body = body.clean() if not body.n_cells else body.extract_cells(np.arange(body.n_cells))
    joints = pyvista.MultiBlock()
    for joint in results.joints:
        grid = joint_grid(results, joint)
        joints[joint] = _grid(pyvista, grid)
        joints[joint].point_data["displacement [m]"] = grid.motion @ displacement
        values = values_of(results, [joint], slice(number, number + 1), grid)
        joints[joint].cell_data.update({name: states[0] for name, states in values.items()})
    blocks = pyvista.MultiBlock()
    blocks["body"], blocks["joints"] = body, joints
    return blocks


def _grid(pyvista: Any, grid: Grid) -> Any:
    lengths = np.diff(grid.offsets)
    cells = np.insert(grid.connectivity, grid.offsets[:-1], lengths)
    result = pyvista.UnstructuredGrid(cells, grid.kinds, grid.points)
    for name, values in grid.cell_data.items():
        result.cell_data[name] = values
    return result
