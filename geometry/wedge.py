# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh of a rock mass with a wedge between planes of given dip and dip direction.

python3 geometry/wedge.py --plane left=45,135,0,0,12 --plane right=45,225,0,0,12 \
    --ground 65,180,0,-15,0 --inside 0,-8,12 --lower=-30,-20,-5 --upper 30,20,20 --size 3
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gmsh

if not __package__:  # run as a script: make the package importable
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from dolfinx_joints.common.declared import checked
from dolfinx_joints.geometry.meshing import gmsh_model
from dolfinx_joints.geometry.meshing.arguments import Length, Order, argument_parser, mesh_path
from dolfinx_joints.geometry.meshing.planes import (
    Plane,
    add_groups,
    bounded,
    check_planes,
    cut_wedge,
    faces_of,
    faces_on_planes,
    mesh_solids,
    sides_of,
)
from dolfinx_joints.geometry.meshing.step_file import PLANE_FORM, by_name, named_plane, numbers


@checked
def wedge(
    out: str | os.PathLike[str],
    *,
    planes: Mapping[str, Plane],
    inside: Sequence[float],
    lower: Sequence[float],
    upper: Sequence[float],
    ground: Sequence[Plane] = (),
    size: Length,
    joint_size: Length | None = None,
    order: Order = 1,
    gui: bool = False,
    duplicated: bool = False,
) -> Path:
    """Mesh a box of rock with a wedge, with tetrahedra.

    All planes bound the wedge, which contains the point ``inside``. Its face on the plane NAME is
    ``joint_NAME``. Groups: volumes ``rock`` and ``wedge``; surfaces ``outer`` (sides and bottom of
    the rock), ``ground`` (other outer faces of the rock), ``wedge_top`` (outer faces of the wedge).

    Args:
        out: path of the .msh file.
        planes: planes by name, (dip, dip direction, x, y, z): the angle to the horizontal, the
            azimuth of the steepest descent, clockwise from +y as seen from above [degrees], and a
            point of the plane [m].
        inside: point in the wedge [m].
        lower: smallest coordinates of the box [m].
        upper: largest coordinates of the box [m].
        ground: planes such as a slope; the rock above them is removed.
        size: largest cell size [m].
        joint_size: largest cell size at the joints [m]; ``size`` by default.
        order: order of the tetrahedra, 1 or 2.
        gui: show the mesh in Gmsh's window afterwards.
        duplicated: duplicate the joint faces: group NAME becomes NAME- and NAME+.

    Returns:
        The path written.

    Raises:
        ValueError: if an argument is not allowed, the point is not in the rock, or a plane does not
            bound the wedge or is given twice.
        RuntimeError: if Gmsh fails to mesh the solids.
    """
    path = mesh_path(out)
    gmsh_model.check_window(gui)
    slopes = {f"ground_{number}": plane for number, plane in enumerate(ground, start=1)}
    check_planes(planes)
    check_planes({**planes, **slopes})
    extents = [high - low for low, high in zip(lower, upper, strict=False)]
    if not (len(lower) == len(upper) == 3 and all(extent > 0 for extent in extents)):
        raise ValueError(f"lower is {lower} and upper {upper}, but x, y and z must increase.")
    with gmsh_model.gmsh_session():
        box = gmsh.model.occ.addBox(*lower, *extents)
        gmsh.model.occ.synchronize()
        part, remaining = cut_wedge(bounded(box, slopes, inside, below=True), planes, inside)
        if remaining:
            gmsh.model.occ.fragment([(3, part)], [(3, tag) for tag in remaining])
            gmsh.model.occ.synchronize()
        faces = faces_on_planes([part], planes)
        outer = [face for tag in remaining for face in faces_of(tag) if len(sides_of(face)) == 1]
        at_box = [face for face in outer if _on_box(face, lower, upper)]
        faces |= {"outer": at_box, "ground": [face for face in outer if face not in at_box]}
        faces["wedge_top"] = [face for face in faces_of(part) if len(sides_of(face)) == 1]
        add_groups(3, {"rock": remaining, "wedge": [part]})
        add_groups(2, {name: tags for name, tags in faces.items() if tags})
        mesh_solids(size, joint_size, faces, order)
        gmsh_model.save(path, gui, duplicated)
    return path


def _on_box(face: int, lower: Sequence[float], upper: Sequence[float]) -> bool:
    """Return True if a face is on a side or on the bottom of the box."""
    low, high = gmsh.model.getBoundingBox(2, face)[:3], gmsh.model.getBoundingBox(2, face)[3:]
    near = 1e-6 * max(b - a for a, b in zip(lower, upper, strict=True))
    flat = [k for k in range(3) if high[k] - low[k] < near]
    return any(
        abs(low[k] - lower[k]) < near or (k < 2 and abs(high[k] - upper[k]) < near) for k in flat
    )


def main(argv: list[str] | None = None) -> None:
    """Run the script."""
    parser = argument_parser(wedge, "Mesh a wedge of rock.", "wedge.msh")
    parser.add_argument(
        "--plane", dest="planes", type=named_plane, action="append", default=[], metavar=PLANE_FORM
    )
    form = PLANE_FORM.removeprefix("NAME=")
    parser.add_argument("--ground", type=numbers, action="append", default=[], metavar=form)
    for flag in ("inside", "lower", "upper"):
        parser.add_argument(f"--{flag}", type=numbers, required=True, metavar="X,Y,Z")

    def model(out: Path, **options: Any) -> Path:
        return wedge(out, **(options | {"planes": by_name("planes", options["planes"])}))

    gmsh_model.run_script(parser, model, argv)


if __name__ == "__main__":
    main()
