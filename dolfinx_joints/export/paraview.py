# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results files as files for ParaView."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.export.grids import Grid, body_grid, joined, joint_grid, joint_values
from dolfinx_joints.export.vtk_files import VtkFile, check_free, vtk_path
from dolfinx_joints.results.arguments import StageStates
from dolfinx_joints.results.reader import Results


@checked
def write_vtk(
    results: Results, path: str | PathLike[str], *, overwrite: bool = False
) -> list[Path]:
    """Write the recorded states of a results file for ParaView, PyVista and VTK.

    ``NAME.vtkhdf`` holds the cells of the body, of the degree of the displacement, with
    ``displacement [m]`` and ``in GROUP [-]``, 1 in the cells of a group; ``NAME_joints.vtkhdf`` the
    joints, a polygon for each joint point, with ``displacement [m]``, the mean of both faces,
    ``gap [m]`` and ``traction [Pa]`` in local axes (n, s1, s2), ``opening [m]``, ``tangential gap
    [m]``, ``status [-]`` (0 open, 1 sticking, 2 sliding, 3 closed without friction, 4 tied),
    ``tied [-]``, ``mean pressure [Pa]`` of each joint and what else was recorded. Both have all
    times. Static stages are in ``NAME_stages.vtkhdf`` and ``NAME_stages_joints.vtkhdf``, with the
    stage's number as time.

    Args:
        results: The run.
        path: ``NAME.vtkhdf``, or ``NAME``.
        overwrite: Replace files of these names.

    Returns:
        The files written.

    Raises:
        ResultsError: The file holds neither states nor stages, or no cells, or files are there
            already.
    """
    found = {
        first.with_name(f"{first.stem}{ending}{first.suffix}"): part
        for first in [vtk_path(path)]
        for ending, part in (("", results), ("_stages", StageStates(results)))
        if part.streams.get("states") and part.rows("states")
    }
    if not found:
        raise ResultsError(f"{results.path} holds no states and no static stages for ParaView.")
    count = 2 if results.joints else 1
    paths = [place for first in found for place in (first, joints_path(first))[:count]]
    check_free(paths, overwrite=overwrite)
    for first, part in found.items():
        _write(part, first)
    return paths


def _write(results: Results, path: Path) -> None:
    """Write the states of body and joints."""
    times = results.time("states")
    body = VtkFile(path, body_grid(results))
    for number, time in enumerate(times):
        moved = results.series("states", "displacement", number)
        body.append(time, {"displacement [m]": moved}, {})
    if results.joints:
        grid = joined({joint: joint_grid(results, joint) for joint in results.joints})
        file = VtkFile(joints_path(path), grid)
        names = [n for n in results.streams["states"] if n.startswith("joints/")]
        for number, time in enumerate(times):
            record = {name: results.series("states", name, number) for name in names}
            moved = grid.motion @ results.series("states", "displacement", number)
            values = values_of_all(record, results.joints, grid)
            file.append(time, {"displacement [m]": moved}, values)


def joints_path(path: Path) -> Path:
    """The file of the joints beside that of the body."""
    return path.with_name(f"{path.stem}_joints{path.suffix}")


def values_of(results: Results, joint: str, number: int, grid: Grid) -> dict[str, Any]:
    """Values of a joint's points, a grid, at a record of ``states``, by name with unit."""
    start = f"joints/{joint}/"
    names = [n for n in results.streams["states"] if n.startswith(start)]
    values = {n.removeprefix(start): results.series("states", n, number) for n in names}
    return joint_values(values, grid.cell_data)


def values_of_all(record: Mapping[str, Any], joints: Sequence[str], grid: Grid) -> dict[str, Any]:
    """Values of the points of all joints by name with unit, one joint after the other.

    Args:
        record: Values of a record of ``states`` by their names in the file.
        joints: Names of the joints; what only some of them have is NaN in the others.
        grid: Grid of all joints.
    """
    known = {name.split("/", 2)[2]: each for name, each in record.items() if "/" in name}
    parts: dict[str, list[Any]] = {what: [] for what in known}
    for joint in joints:
        count = len(record[f"joints/{joint}/gap"])
        for what in known:
            parts[what].append(record.get(f"joints/{joint}/{what}", np.full(count, np.nan)))
    values = {what: np.concatenate(each) for what, each in parts.items()}
    return joint_values(values, grid.cell_data, len(joints))
