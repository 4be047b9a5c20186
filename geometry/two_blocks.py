# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh of two elastic blocks with a horizontal or inclined joint between them.

python3 geometry/two_blocks.py --angle 20 --size 0.25 --out blocks.msh
"""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

if not __package__:  # run as a script: make the package importable
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from dolfinx_joints.common.declared import checked
from dolfinx_joints.geometry.meshing import gmsh_model
from dolfinx_joints.geometry.meshing.arguments import (
    Cell,
    Length,
    Order,
    argument_parser,
    cells_along,
    mesh_path,
)
from dolfinx_joints.geometry.meshing.extrusion import PlaneMesh, edges_between, extrude, grid


@checked
def two_blocks(
    out: str | os.PathLike[str],
    *,
    length: Length = 1.0,
    width: Length = 1.0,
    lower_height: Length = 1.0,
    upper_height: Length = 1.0,
    angle: float = 0.0,
    size: Length = 0.25,
    order: Order = 1,
    cell: Cell = "hex",
    gui: bool = False,
    duplicated: bool = False,
) -> Path:
    """Mesh two blocks, x in [0, length], y in [0, width], z in [0, lower + upper height].

    The joint is the plane z = lower_height + (x - length/2) tan(angle).  Groups: volumes
    ``lower`` and ``upper``; surfaces ``base`` (z = 0), ``top``, ``sides`` (the other four) and
    ``joint_1``.

    Args:
        out: path of the .msh file.
        length: extent in x [m].
        width: extent in y [m].
        lower_height: height of the lower block in the middle [m].
        upper_height: height of the upper block in the middle [m].
        angle: inclination of the joint, positive if it rises with x [degrees].
        size: cell size [m]; rounded so that whole cells fit.
        order: order of the elements, 1 or 2.
        cell: "hex" or "tet".
        gui: show the mesh in Gmsh's window afterwards.
        duplicated: duplicate the joint faces: group NAME becomes NAME- and NAME+.

    Returns:
        The path written.

    Raises:
        ValueError: if an argument is not allowed, or the joint would cut the base or the top.
    """
    out = mesh_path(out)
    gmsh_model.check_window(gui)
    n_x, n_y, n_lower, n_upper = (
        cells_along(h, size) for h in (length, width, lower_height, upper_height)
    )
    limit = float(np.degrees(np.arctan(2 * min(lower_height, upper_height) / length)))
    if not abs(angle) < limit:
        raise ValueError(
            f"angle is {angle:g}, but it must be between -{limit:.4g} and {limit:.4g} degrees, "
            "so that the joint ends at the sides."
        )
    # Reference coordinates (p, q, r) = (z, x, y), with p in [0, 1] below the joint, [1, 2] above.
    p = np.concatenate([np.linspace(0, 1, n_lower + 1), np.linspace(1, 2, n_upper + 1)[1:]])
    points, cells = grid(p, np.linspace(0, length, n_x + 1), cell)
    below = points[cells, 0].mean(axis=1) < 1
    at_ends = [edges_between(cells, points[:, 1] == x) for x in (0, length)]
    plane = PlaneMesh(
        points,
        {"lower": cells[below], "upper": cells[~below]},
        {
            "base": edges_between(cells, points[:, 0] == 0),
            "top": edges_between(cells, points[:, 0] == 2),
            "sides": np.concatenate(at_ends),
            "joint_1": edges_between(cells, points[:, 0] == 1),
        },
    )
    solid = extrude(plane, np.linspace(0, width, n_y + 1), ("sides", "sides"))
    p, x, y = solid.points.T
    joint = lower_height + (x - length / 2) * np.tan(np.radians(angle))
    above = joint + (p - 1) * (lower_height + upper_height - joint)
    xyz = np.column_stack([x, y, np.where(p <= 1, p * joint, above)])
    return gmsh_model.write_mesh(
        out, replace(solid, points=xyz), order, gui=gui, duplicated=duplicated
    )


def main(argv: list[str] | None = None) -> None:
    """Run the script."""
    text = "Mesh two blocks with a joint between them."
    gmsh_model.run_script(argument_parser(two_blocks, text, "two_blocks.msh"), two_blocks, argv)


if __name__ == "__main__":
    main()
