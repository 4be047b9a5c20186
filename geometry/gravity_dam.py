# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh of a gravity dam monolith with horizontal lift joints, plane or solid.

python3 geometry/gravity_dam.py --section koyna --joint neck=66.5 --joint base=0 --out koyna.msh
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import annotated_types as at
import numpy as np

if not __package__:  # run as a script: make the package importable
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.parameters import real, shown
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
    IntArray,
    PlaneMesh,
    edges_between,
    extrude,
    grid,
)

Corners = tuple[tuple[float, float], ...]

_CLOSEST = 1e-6  # least distance of different corners or joints, relative to the height


@dataclass(frozen=True)
class GravitySection:
    """Cross-section of a gravity dam between two faces made of straight lines.

    x points downstream, z up from the base.

    Args:
        upstream: corners (z, x) of the upstream face from the base (z = 0) to the crest [m].
        downstream: corners (z, x) of the downstream face, in the same order [m].

    Raises:
        ValueError: if a face does not rise from 0, the faces do not end at the same height, or
            they meet.
    """

    upstream: Corners
    downstream: Corners

    def __post_init__(self) -> None:
        for name in ("upstream", "downstream"):
            if not _is_face(getattr(self, name)):
                raise ValueError(
                    f"{name} is {shown(getattr(self, name))}, but it must be two or more corners "
                    "(z, x) with z rising from 0."
                )
        ends = float(self.upstream[-1][0]), float(self.downstream[-1][0])
        if ends[0] != ends[1]:
            raise ValueError(
                f"The upstream face ends at z = {ends[0]:g} m and the downstream face at "
                f"{ends[1]:g} m, but both must end at the crest."
            )
        thickness = self.thickness(self.levels)
        if not thickness.min() > 0:  # also true for NaN
            raise ValueError(
                f"The least thickness of the section is {thickness.min():g} m, but the "
                "downstream face must be downstream of the upstream face everywhere."
            )

    @property
    def height(self) -> float:
        """Height of the crest above the base [m]."""
        return float(self.upstream[-1][0])

    @property
    def levels(self) -> FloatArray:
        """Heights of all corners, ascending [m]."""
        return np.unique([z for z, _ in (*self.upstream, *self.downstream)])

    @property
    def area(self) -> float:
        """Area of the section [m^2]."""
        return float(np.trapezoid(self.thickness(self.levels), self.levels))

    def face(self, name: str, z: FloatArray) -> FloatArray:
        """Return x of the ``upstream`` or ``downstream`` face at heights z [m]."""
        heights, x = np.transpose(getattr(self, name))
        return np.interp(z, heights, x)

    def thickness(self, z: FloatArray) -> FloatArray:
        """Return the horizontal distance between the faces at heights z [m]."""
        return self.face("downstream", z) - self.face("upstream", z)


def _is_face(corners: Any) -> bool:
    """Return True if ``corners`` are corners (z, x) of a face that rises from 0."""
    try:
        array = np.asarray(corners)
    except ValueError:  # rows of different lengths
        return False
    if array.ndim != 2 or array.shape[1:] != (2,) or len(array) < 2 or array.dtype.kind not in "if":
        return False
    rises = array[0, 0] == 0 and (np.diff(array[:, 0]) > _CLOSEST * array[-1, 0]).all()
    return bool(rises and np.isfinite(array).all())


@checked
def battered_section(
    *,
    height: Length,
    base: Length,
    crest: Length,
    upstream_slope: Annotated[float, at.Ge(0)],
    upstream_break: Length,
    downstream_slope: Annotated[float, at.Gt(0)],
) -> GravitySection:
    """Return a section whose faces are each inclined below a break and vertical above.

    The downstream break follows from the other numbers.

    Args:
        height: height of the crest above the base [m].
        base: thickness at the base [m].
        crest: thickness at the crest [m].
        upstream_slope: ratio of horizontal to vertical length, below ``upstream_break``.
        upstream_break: height above which the upstream face is vertical [m].
        downstream_slope: ratio of horizontal to vertical length, below the downstream break.

    Raises:
        ValueError: if a break is not between the base and the crest.
    """
    heel = upstream_slope * upstream_break
    bend = (base - crest - heel) / downstream_slope
    for name, level in (("upstream_break", upstream_break), ("The downstream break", bend)):
        if not 0 < level < height:
            raise ValueError(f"{name} is at {level:g} m, but it must be between 0 and {height:g}.")
    return GravitySection(
        upstream=((0.0, 0.0), (upstream_break, heel), (height, heel)),
        downstream=((0.0, base), (bend, heel + crest), (height, heel + crest)),
    )


FOOT = 0.3048  # [m]

KOYNA = GravitySection(
    upstream=((0.0, 0.0), (103.0, 0.0)),
    downstream=((0.0, 70.0), (66.5, 19.25), (103.0, 14.8)),
)
"""Non-overflow monolith of Koyna dam as usually analysed, with a vertical upstream face."""

PINE_FLAT_FACES = {
    "height": 400 * FOOT,
    "base": 314.32 * FOOT,
    "crest": 32 * FOOT,
    "upstream_slope": 0.05,
    "upstream_break": 335 * FOOT,
    "downstream_slope": 0.78,
}
PINE_FLAT = battered_section(**PINE_FLAT_FACES)
"""Tallest non-overflow monolith of Pine Flat dam."""

SECTIONS = {"koyna": KOYNA, "pine_flat": PINE_FLAT}


@checked
def gravity_dam(
    out: str | os.PathLike[str],
    *,
    section: GravitySection = KOYNA,
    joints: Mapping[str, float] | None = None,
    width: Length | None = None,
    size: Length = 4.0,
    order: Order = 2,
    cell: Cell = "hex",
    gui: bool = False,
    duplicated: bool = False,
) -> Path:
    """Mesh a monolith with horizontal joints: x downstream, y up, or a solid with z up.

    A joint called NAME is the group ``joint_NAME``, through the whole section. A joint at height 0
    is the base joint. It lies between the dam and a row of foundation cells, the group
    ``foundation``, whose ends are ``foundation_ends``.

    Further groups: cells ``concrete``; surfaces ``base`` (bottom of the foundation, or of the dam
    without a foundation), ``upstream``, ``downstream`` and ``crest``. A solid, y in [0, width], has
    also ``front`` (y = 0) and ``back``. All nodes lie on the exact shape.

    Args:
        out: path of the .msh file.
        section: the cross-section.
        joints: heights of the joints above the base by name, each below the crest [m].
        width: extent in y [m]; None for a plane mesh.
        size: height of the cells, and their mean width [m]; rounded so that whole cells fit.
        order: order of the elements, 1 or 2.
        cell: "hex" or "tet"; in a plane mesh quadrilaterals or triangles.
        gui: show the mesh in Gmsh's window afterwards.
        duplicated: duplicate the joint faces: group NAME becomes NAME- and NAME+.

    Returns:
        The path written.

    Raises:
        ValueError: if an argument is not allowed.
    """
    out = mesh_path(out)
    gmsh_model.check_window(gui)
    heights = _checked_heights(joints or {}, section)
    plane = _reference(section, heights, size, cell)
    across = round(float(plane.points[:, 0].max()))

    def place(p: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        upstream, downstream = section.face("upstream", z), section.face("downstream", z)
        return upstream + p / across * (downstream - upstream), z

    if width is None:
        return gmsh_model.write_plane(
            out, plane, order, section=place, gui=gui, duplicated=duplicated
        )

    def place_solid(reference: FloatArray, _: object) -> FloatArray:
        x, z = place(reference[:, 0], reference[:, 1])
        return np.column_stack([x, width - reference[:, 2], z])

    layers = np.linspace(0, width, cells_along(width, size) + 1)
    solid = extrude(plane, layers, ("back", "front"))
    return gmsh_model.write_mesh(
        out, solid, order, place=place_solid, gui=gui, duplicated=duplicated
    )


def _checked_heights(joints: Mapping[str, float], section: GravitySection) -> dict[str, float]:
    """Return the heights of the joints after checking them."""
    for name, height in joints.items():
        if not re.fullmatch(r"\w+", name):
            raise ValueError(
                f"A joint is called {shown(name)}, but names may have only letters, digits and '_'."
            )
        if not 0 <= real(height) < section.height:
            raise ValueError(
                f"Joint {shown(name)} is at height {shown(height)}, but it must be at least 0 and "
                f"below the crest at {section.height:g} [m]."
            )
    if len(set(joints.values())) < len(joints):
        raise ValueError(f"joints is {shown(dict(joints))}, but their heights must differ.")
    levels = np.unique([*section.levels, *joints.values()]).astype(float)
    spacing = _CLOSEST * section.height
    if (np.diff(levels) < spacing).any() or len(joints) > MAX_JOINTS:
        raise ValueError(
            f"joints is {shown(dict(joints))}, but there must be at most {MAX_JOINTS}, and joints "
            f"and corners of the section must be at one height or at least {spacing:g} m apart."
        )
    return {name: float(height) for name, height in joints.items()}


def _reference(
    section: GravitySection, joints: Mapping[str, float], size: float, cell: str
) -> PlaneMesh:
    """Return the mesh in p, the number of cells from the upstream face, and the height z."""
    fixed = np.unique([*section.levels, *joints.values()])
    across = cells_along(section.area / section.height, size)
    check_fine(across * section.height / size)
    rows = [np.linspace(a, b, cells_along(b - a, size) + 1)[1:] for a, b in pairwise(fixed)]
    z = np.concatenate([[0.0], *rows])
    grounded = 0.0 in joints.values()
    if grounded:
        z = np.concatenate([[-size], z])
    points, cells = grid(np.arange(across + 1.0), z, cell)
    p, height = points.T
    inside = height[cells].mean(axis=1) > 0
    groups = {"concrete": cells[inside]}
    edges: dict[str, IntArray] = {"base": edges_between(cells, height == z[0])}
    if grounded:
        groups["foundation"] = cells[~inside]
        edges["foundation_ends"] = np.concatenate(
            [edges_between(cells[~inside], p == end) for end in (0, across)]
        )
    edges["upstream"] = edges_between(cells[inside], p == 0)
    edges["downstream"] = edges_between(cells[inside], p == across)
    edges["crest"] = edges_between(cells, height == section.height)
    for name, level in joints.items():
        edges[f"joint_{name}"] = edges_between(cells, height == level)
    return PlaneMesh(points, groups, edges)


def _named_height(text: str) -> tuple[str, float]:
    """Return the name and the height of the text NAME=HEIGHT."""
    name, _, height = text.partition("=")
    try:
        return name, float(height)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=HEIGHT") from None


def main(argv: list[str] | None = None) -> None:
    """Run the script."""
    text = "Mesh a monolith of a gravity dam."
    parser = argument_parser(gravity_dam, text, "gravity_dam.msh")
    parser.add_argument("--section", choices=SECTIONS, default="koyna", help="cross-section")
    parser.add_argument(
        "--joint",
        type=_named_height,
        action="append",
        dest="joints",
        default=[],
        metavar="NAME=HEIGHT",
        help="horizontal joint at a height above the base [m]; base=0 is the base joint",
    )

    def model(out: Path, *, section: str, joints: list[tuple[str, float]], **options: Any) -> Path:
        if len(dict(joints)) < len(joints):
            raise ValueError("two joints have the same name, but names must differ.")
        return gravity_dam(out, section=SECTIONS[section], joints=dict(joints), **options)

    gmsh_model.run_script(parser, model, argv)


if __name__ == "__main__":
    main()
