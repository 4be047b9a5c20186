# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh of a circular arch of equal voussoirs with radial joints, plane or solid.

python3 geometry/voussoir_arch.py --voussoirs 15 --thickness 1.2 --out arch.msh
"""

from __future__ import annotations

import math
import operator
import os
import sys
from pathlib import Path
from typing import Annotated

import annotated_types as at
import numpy as np

if not __package__:  # run as a script: make the package importable
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from dolfinx_joints.common.declared import checked
from dolfinx_joints.geometry.meshing import gmsh_model
from dolfinx_joints.geometry.meshing.arguments import (
    MAX_JOINTS,
    Cell,
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
def voussoir_arch(
    out: str | os.PathLike[str],
    *,
    radius: Length = 10.0,
    thickness: Length = 1.2,
    half_angle: Annotated[float, at.Interval(gt=0, le=120), at.Unit("degrees")] = 90.0,
    voussoirs: Annotated[int, at.Interval(ge=1, le=MAX_JOINTS)] = 15,
    width: Length | None = None,
    divisions: Annotated[tuple[int, int, int], at.Ge(1)] = (2, 2, 1),
    size: Length | None = None,
    order: Order = 1,
    cell: Cell = "hex",
    gui: bool = False,
    duplicated: bool = False,
) -> Path:
    """Mesh an arch about the origin, crown upwards, with one cell of abutment at either end.

    The arch is a plane mesh in (x, y), y up, or with a width a solid in (x, y, z), z up and y in
    [0, width]. Joint k, counted from the left springing (x < 0), lies in the direction
    -half_angle + (k - 1) 2 half_angle/voussoirs from the crown; joints 1 and voussoirs + 1 are the
    springings.

    Groups: cells ``arch``, ``abutments``; surfaces ``intrados`` and ``extrados`` (both including
    the abutments), ``base`` (far sides of the abutments), ``joint_1``, ... A solid has also
    ``front`` (y = 0) and ``back``. Cells of order 1 have straight edges between nodes on arcs.

    Args:
        out: path of the .msh file.
        radius: radius of the centre line [m].
        thickness: thickness of the arch, below twice the radius [m].
        half_angle: angle from the crown to a springing, 90 for a semicircle, at most 120 [degrees].
        voussoirs: number of blocks; if odd, a block is at the crown.
        width: extent in y [m]; None for a plane mesh.
        divisions: number of cells along each voussoir, through the thickness, and across the
            width.
        size: cell size [m], rounded so that whole cells fit; if given, replaces ``divisions``.
        order: order of the elements, 1 or 2.
        cell: "hex" or "tet"; in a plane mesh quadrilaterals or triangles.
        gui: show the mesh in Gmsh's window afterwards.
        duplicated: duplicate the joint faces: group NAME becomes NAME- and NAME+.

    Returns:
        The path written.

    Raises:
        ValueError: if an argument is not allowed, or a cell spans more than 45 degrees.
    """
    out = mesh_path(out)
    gmsh_model.check_window(gui)
    if thickness >= 2 * radius:
        raise ValueError(
            f"thickness is {thickness:g}, but it must be below twice the radius, {2 * radius:g}."
        )
    lengths = [2 * math.radians(half_angle) * radius / voussoirs, thickness, width or 1.0]
    n_along, n_through, n_across = map(operator.index, divisions)
    if size is not None:
        n_along, n_through, n_across = (cells_along(length, size) for length in lengths)
    check_fine(n_along * voussoirs * n_through * (1 if width is None else n_across))

    step = 2 * math.radians(half_angle) / (n_along * voussoirs)
    if step > np.pi / 4:
        raise ValueError(
            f"A cell spans {np.degrees(step):.4g} degrees, but it must be at most 45: use more "
            "cells along the arch."
        )
    plane = _reference(voussoirs, n_along, n_through, cell)

    def section(p: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        angle = (p - 0.5 * n_along * voussoirs) * step
        r = radius + thickness * (q / n_through - 0.5)
        return r * np.sin(angle), r * np.cos(angle)

    if width is None:
        return gmsh_model.write_plane(
            out, plane, order, section=section, gui=gui, duplicated=duplicated
        )

    def place(reference: FloatArray, _: object) -> FloatArray:
        x, z = section(reference[:, 0], reference[:, 1])
        return np.column_stack([x, width - reference[:, 2], z])

    solid = extrude(plane, np.linspace(0, width, n_across + 1), ("back", "front"))
    return gmsh_model.write_mesh(out, solid, order, place=place, gui=gui, duplicated=duplicated)


def _reference(voussoirs: int, n_along: int, n_through: int, cell: str) -> PlaneMesh:
    """Return the mesh in p, cells from the left springing, and q, cells through the thickness."""
    length = n_along * voussoirs
    points, cells = grid(np.arange(-1.0, length + 2), np.arange(n_through + 1.0), cell)
    p, q = points.T
    middle = p[cells].mean(axis=1)
    inside = (middle > 0) & (middle < length)
    sides = {"intrados": q == 0, "extrados": q == n_through}
    edges = {name: edges_between(cells, chosen) for name, chosen in sides.items()}
    edges["base"] = np.concatenate([edges_between(cells, p == end) for end in (-1, length + 1)])
    for k in range(voussoirs + 1):
        edges[f"joint_{k + 1}"] = edges_between(cells, p == k * n_along)
    return PlaneMesh(points, {"arch": cells[inside], "abutments": cells[~inside]}, edges)


def main(argv: list[str] | None = None) -> None:
    """Run the script."""
    parser = argument_parser(voussoir_arch, "Mesh an arch of voussoirs.", "voussoir_arch.msh")
    gmsh_model.run_script(parser, voussoir_arch, argv)


if __name__ == "__main__":
    main()
