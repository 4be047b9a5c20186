# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Export of results files to ParaView."""

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

_BLOCK_BYTES = 1 << 22  # displacements of the states that are in memory together


@checked
def write_vtk(
    results: Results, path: str | PathLike[str], *, overwrite: bool = False
) -> list[Path]:
    """Write the recorded states of a results file for ParaView, PyVista and VTK.

    ``NAME.vtkhdf`` contains the body in cells of the degree of the displacement. Its data are
    ``displacement [m]`` from the unloaded body, and ``in GROUP [-]``, 1 in the cells of a group.

    ``NAME_joints.vtkhdf`` contains the joints, one polygon per joint point. Its data are
    ``displacement [m]`` (mean of both faces), ``gap [m]`` and ``traction [Pa]`` in local axes
    (n, s1, s2), ``opening [m]``, ``tangential gap [m]``, ``mean pressure [Pa]`` of each joint,
    ``tied [-]``, ``status [-]`` (0 open, 1 sticking, 2 sliding, 3 closed without friction, 4 tied)
    and all other recorded quantities. Static stages are in ``NAME_stages.vtkhdf`` and
    ``NAME_stages_joints.vtkhdf``, with the number of the stage as time.

    Args:
        results: The run.
        path: ``NAME.vtkhdf``, or ``NAME``.
        overwrite: True to replace existing files.

    Returns:
        Paths of the files.

    Raises:
        ResultsError: The file has neither states nor stages, or no cells, or an output file exists.
    """
    sources = {
        first.with_name(f"{first.stem}{ending}{first.suffix}"): part
        for first in [vtk_path(path)]
        for ending, part in (("", results), ("_stages", StageStates(results)))
        if part.streams.get("states") and part.rows("states")
    }
    if not sources:
        raise ResultsError(f"{results.path} has neither states nor static stages to export.")
    count = 2 if results.joints else 1
    paths = [place for first in sources for place in (first, joints_path(first))[:count]]
    check_free(paths, overwrite=overwrite)
    for first, part in sources.items():
        _write(part, first)
    return paths


def _write(results: Results, path: Path) -> None:
    names, times, grid = results.joints, results.time("states"), body_grid(results)
    body = VtkFile(path, grid)
    if names:
        surfaces = joined({name: joint_grid(results, name) for name in names})
        joints = VtkFile(joints_path(path), surfaces)
    count = max(1, _BLOCK_BYTES // grid.points.nbytes)
    for first in range(0, len(times), count):
        block = slice(first, first + count)
        moved = results.series("states", "displacement", block)
        body.append(times[block], {"displacement [m]": np.concatenate(moved)}, {})
        if names:
            values = values_of(results, names, block, surfaces)
            of_joints = np.concatenate([surfaces.motion @ nodes for nodes in moved])
            joints.append(
                times[block],
                {"displacement [m]": of_joints},
                {name: np.concatenate(states) for name, states in values.items()},
            )


def joints_path(path: Path) -> Path:
    """Return the path of the file of the joints, given the path of the file of the body."""
    return path.with_name(f"{path.stem}_joints{path.suffix}")


def values_of(results: Results, joints: Sequence[str], block: slice, grid: Grid) -> dict[str, Any]:
    """Return the values of records at the points of all given joints, by name with unit.

    The shape is (records, points, ...). Quantities that a joint does not have are NaN.
    """
    starts = tuple(f"joints/{joint}/" for joint in joints)
    names = [name for name in results.streams["states"] if name.startswith(starts)]
    records = {name: results.series("states", name, block) for name in names}
    values = {}
    for quantity in dict.fromkeys(name.split("/", 2)[2] for name in names):
        parts = []
        for start in starts:
            missing = np.full(records[f"{start}gap"].shape[:2], np.nan)
            parts.append(records.get(start + quantity, missing))
        values[quantity] = np.concatenate(parts, axis=1)
    return joint_values(values, grid.cell_data, len(joints))
