# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh of a wall on a rigid base, cut into equal blocks by vertical plane joints.

python3 geometry/jointed_wall.py --divisions 40 8 40 --out wall.msh
"""

from __future__ import annotations

import operator
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import annotated_types as at
import numpy as np

if not __package__:  # run as a script: make the package importable
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from dolfinx_joints.common.declared import checked
from dolfinx_joints.geometry.meshing import gmsh_model
from dolfinx_joints.geometry.meshing.arguments import (
    Cell,
    Length,
    NumberOfJoints,
    Order,
    argument_parser,
    cells_along,
    check_fine,
    mesh_path,
)
from dolfinx_joints.geometry.meshing.extrusion import PlaneMesh, edges_between, extrude, grid


@checked
def jointed_wall(
    out: str | os.PathLike[str],
    *,
    length: Length = 20.0,
    thickness: Length = 4.0,
    height: Length = 20.0,
    joints: NumberOfJoints = 3,
    divisions: Annotated[tuple[int, int, int], at.Ge(1)] = (20, 4, 20),
    size: Length | None = None,
    order: Order = 1,
    cell: Cell = "hex",
    gui: bool = False,
    duplicated: bool = False,
) -> Path:
    """Mesh the box x in [0, length], y in [0, thickness], z in [0, height], with joints.

    Joint k is the plane x = k length/(joints + 1).  Groups: volume ``concrete``; surfaces ``base``
    (z = 0), ``crest`` (z = height), ``x_min``, ``x_max``, ``y_min``, ``y_max``, and ``joint_1``,
    ``joint_2``, ... in the order of x. Cells are equal boxes, or equal boxes cut into tetrahedra.

    Args:
        out: path of the .msh file.
        length: extent in x [m].
        thickness: extent in y [m].
        height: extent in z [m].
        joints: number of joints, 0 for a monolithic wall.
        divisions: number of cells along x, y and z; the first is a multiple of joints + 1.
        size: cell size [m], rounded so that whole cells fit; if given, replaces ``divisions``.
        order: order of the elements, 1 or 2.
        cell: "hex" or "tet".
        gui: show the mesh in Gmsh's window afterwards.
        duplicated: duplicate the joint faces: group NAME becomes NAME- and NAME+.

    Returns:
        The path written.

    Raises:
        ValueError: if an argument is not allowed.
    """
    out = mesh_path(out)
    gmsh_model.check_window(gui)
    blocks = joints + 1
    n_x, n_y, n_z = map(operator.index, divisions)
    if size is not None:
        n_x = blocks * cells_along(length / blocks, size)
        n_y, n_z = (cells_along(h, size) for h in (thickness, height))
    if n_x % blocks:
        raise ValueError(
            f"divisions is {(n_x, n_y, n_z)}, but it must be three whole numbers, the first a "
            f"multiple of {blocks} (joints + 1)."
        )
    check_fine(n_x * n_y * n_z)

    # Reference coordinates (p, q, r) = (x, y, z); p counts cells, so it is exact at the joints.
    points, cells = grid(np.arange(n_x + 1.0), np.linspace(0, thickness, n_y + 1), cell)
    lines = {"x_min": (0, 0), "x_max": (0, n_x), "y_min": (1, 0), "y_max": (1, thickness)}
    lines |= {f"joint_{k}": (0, k * n_x // blocks) for k in range(1, blocks)}
    edges = {name: edges_between(cells, points[:, a] == v) for name, (a, v) in lines.items()}
    plane = PlaneMesh(points, {"concrete": cells}, edges)
    solid = extrude(plane, np.linspace(0, height, n_z + 1), ("base", "crest"))
    solid = replace(solid, points=solid.points * [length / n_x, 1.0, 1.0])
    return gmsh_model.write_mesh(out, solid, order, gui=gui, duplicated=duplicated)


def main(argv: list[str] | None = None) -> None:
    """Run the script."""
    parser = argument_parser(jointed_wall, "Mesh a jointed wall.", "jointed_wall.msh")
    gmsh_model.run_script(parser, jointed_wall, argv)


if __name__ == "__main__":
    main()
