# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Export of results files to xarray datasets, with coordinates and units."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.export.optional import import_optional
from dolfinx_joints.results.arguments import COMPONENTS, check_results
from dolfinx_joints.results.joint_points import tied_points
from dolfinx_joints.results.reader import Results, listing

if TYPE_CHECKING:
    from xarray import Dataset

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
    xarray = import_optional("xarray")
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
