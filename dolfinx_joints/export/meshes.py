# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Export of results files to PyVista grids."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Any

import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.export.grids import Grid, body_grid, joint_grid
from dolfinx_joints.export.optional import import_optional
from dolfinx_joints.export.paraview import values_of
from dolfinx_joints.results.arguments import chosen_state
from dolfinx_joints.results.reader import Results

if TYPE_CHECKING:
    from pyvista import MultiBlock


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
    pyvista = import_optional("pyvista")
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
