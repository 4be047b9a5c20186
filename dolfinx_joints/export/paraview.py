# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results files as files for ParaView."""

from __future__ import annotations

from collections.abc import Sequence
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
    times = results.time("states")
    body = VtkFile(path, body_grid(results))
    for number, time in enumerate(times):
        moved = results.series("states", "displacement", number)
        body.append(time, {"displacement [m]": moved}, {})
    if results.joints:
        grid = joined({joint: joint_grid(results, joint) for joint in results.joints})
        file = VtkFile(joints_path(path), grid)
        for number, time in enumerate(times):
            moved = grid.motion @ results.series("states", "displacement", number)
            values = values_of(results, results.joints, number, grid)
            file.append(time, {"displacement [m]": moved}, values)


def joints_path(path: Path) -> Path:
    """The file of the joints beside that of the body."""
    return path.with_name(f"{path.stem}_joints{path.suffix}")


def values_of(results: Results, joints: Sequence[str], number: int, grid: Grid) -> dict[str, Any]:
    """Values of the points of joints by name with unit, one joint after the other, at a record.

    What only some of the joints have is NaN in the others.
    """
    starts = tuple(f"joints/{joint}/" for joint in joints)
    names = [name for name in results.streams["states"] if name.startswith(starts)]
    record = {name: results.series("states", name, number) for name in names}
    values = {}
    for what in dict.fromkeys(name.split("/", 2)[2] for name in names):
        parts = []
        for start in starts:
            missing = np.full(len(record[f"{start}gap"]), np.nan)
            parts.append(record.get(start + what, missing))
        values[what] = np.concatenate(parts)
    return joint_values(values, grid.cell_data, len(joints))
