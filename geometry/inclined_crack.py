# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh of a large body with one plane crack inside, inclined to the vertical.

python3 geometry/inclined_crack.py --angle 45 --size 0.1 --cell quad --out crack.msh
"""

from __future__ import annotations

import math
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import annotated_types as at
import numpy as np
from scipy.optimize import brentq

if not __package__:  # run as a script: make the package importable
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from dolfinx_joints.common.declared import checked
from dolfinx_joints.geometry.meshing import gmsh_model
from dolfinx_joints.geometry.meshing.arguments import (
    Length,
    Order,
    argument_parser,
    cells_along,
    check_fine,
    mesh_path,
)
from dolfinx_joints.geometry.meshing.extrusion import (
    FloatArray,
    PlaneMesh,
    edges_between,
    extrude,
    grid,
)


@checked
def inclined_crack(
    out: str | os.PathLike[str],
    *,
    half_length: Length = 1.0,
    angle: Annotated[float, at.Unit("degrees")] = 45.0,
    extent: Annotated[float, at.Interval(ge=2, le=1e4)] = 40.0,
    lean: Annotated[float, at.Interval(ge=-60, le=60), at.Unit("degrees")] = 25.0,
    size: Length = 0.1,
    growth: Annotated[float, at.Interval(ge=1.001, le=3)] = 1.5,
    order: Order = 1,
    cell: Literal["quad", "tri", "hex", "tet"] = "hex",
    gui: bool = False,
    duplicated: bool = False,
) -> Path:
    """Mesh a parallelogram about a crack through the origin, in 2-D or one cell thick in 3-D.

    The crack is at ``angle`` to the y axis; in 3-D it is parallel to the z axis. Two sides of the
    body are parallel to the crack. Cells are equal along the crack and grow with the distance from
    the crack. Columns of cells are inclined, so the mesh is not symmetric. Groups: ``body``;
    ``outer`` (the four sides), ``joint_1`` (the crack), in 3-D ``faces`` (the two planes
    z = constant).

    Args:
        out: path of the .msh file.
        half_length: half the length of the crack [m].
        angle: angle between crack and y axis [degrees].
        extent: half the length and half the height of the body, relative to ``half_length``.
        lean: inclination of the columns of cells to the normal of the crack [degrees].
        size: cell size at the crack, and thickness in 3-D [m]; rounded so that whole cells fit.
        growth: largest ratio of the sizes of neighbouring cells away from the crack.
        order: order of the elements, 1 or 2.
        cell: "quad" or "tri" in 2-D, "hex" or "tet" in 3-D.
        gui: show the mesh in Gmsh's window afterwards.
        duplicated: duplicate the joint faces: group NAME becomes NAME- and NAME+.

    Returns:
        The path written.

    Raises:
        ValueError: if an argument is not allowed.
    """
    out = mesh_path(out)
    gmsh_model.check_window(gui)
    plane_cell = {"quad": "hex", "tri": "tet"}.get(cell)
    plane = _plane_mesh(half_length, extent, size, growth, plane_cell or cell)
    points = _to_body_axes(plane.points, angle, lean)
    plane = replace(plane, points=points)
    if plane_cell:
        return gmsh_model.write_plane(out, plane, order, gui=gui, duplicated=duplicated)
    thickness = 2.0 * half_length / _cells_along(half_length, size)
    solid = extrude(plane, np.array([0.0, thickness]), ("faces", "faces"))
    return gmsh_model.write_mesh(out, solid, order, gui=gui, duplicated=duplicated)


def _cells_along(half_length: float, size: float) -> int:
    """Return the number of cells along the crack."""
    return max(3, cells_along(2.0 * half_length, size))


def _plane_mesh(
    half_length: float, extent: float, size: float, growth: float, cell: str
) -> PlaneMesh:
    """Return the mesh of the body in the axes of the crack, with columns normal to it."""
    count = _cells_along(half_length, size)
    step = 2.0 * half_length / count
    check_fine(2 * count * _number_graded(step, extent * half_length, growth))
    beyond = half_length + _graded_ends(step, (extent - 1.0) * half_length, growth)
    away = _graded_ends(step, extent * half_length, growth)
    along = np.linspace(-half_length, half_length, count + 1)
    p = np.concatenate([-beyond[::-1], along, beyond])
    q = np.concatenate([-away[::-1], [0.0], away])
    points, cells = grid(p, q, cell)
    reach = np.abs(points)
    sides = [
        edges_between(cells, points[:, a] == v[e]) for a, v in enumerate((p, q)) for e in (0, -1)
    ]
    crack = edges_between(cells, (points[:, 1] == 0.0) & (reach[:, 0] <= half_length))
    return PlaneMesh(points, {"body": cells}, {"outer": np.concatenate(sides), "joint_1": crack})


def _graded_ends(first: float, length: float, growth: float) -> FloatArray:
    """Return the ends of cells that fill a length and grow at a constant ratio from ``first``."""
    count = _number_graded(first, length, growth)

    def excess(ratio: float) -> float:
        return first * sum(ratio**k for k in range(count)) - length

    ratio = brentq(excess, 1.0, growth + 1e-9) if excess(1.0) < 0 else 1.0
    ends = np.cumsum(ratio ** np.arange(count))
    return length * ends / ends[-1]


def _number_graded(first: float, length: float, growth: float) -> int:
    """Return the number of cells that fill a length and grow from ``first`` by ``growth``."""
    return math.ceil(math.log1p(length * (growth - 1.0) / first) / math.log(growth))


def _to_body_axes(points: FloatArray, angle: float, lean: float) -> FloatArray:
    """Incline the columns of points, rotate the crack to its angle, and return the points."""
    p = points[:, 0] + points[:, 1] * np.tan(np.radians(lean))
    along, normal = crack_axes(angle)
    return p[:, None] * along + points[:, 1:] * normal


def crack_axes(angle: float) -> tuple[FloatArray, FloatArray]:
    """Return the unit vectors along and normal to a crack at an angle to the y axis [degrees]."""
    psi = np.radians(angle)
    return np.array([np.sin(psi), np.cos(psi)]), np.array([-np.cos(psi), np.sin(psi)])


def main(argv: list[str] | None = None) -> None:
    """Run the script."""
    text = "Mesh a crack in a large body."
    parser = argument_parser(inclined_crack, text, "inclined_crack.msh")
    gmsh_model.run_script(parser, inclined_crack, argv)


if __name__ == "__main__":
    main()
