# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh of an arch dam like Ambiesta dam, with vertical joints that are radial at the crest.

python3 geometry/ambiesta.py --size 5.5 --order 2 --active-height 0.75 --duplicated --out dam.msh

``arch`` defines the shape; other parameters make another dam.
"""

from __future__ import annotations

import os
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np

if not __package__:  # run as a script: make the package importable
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from dolfinx_joints.common.declared import checked
from dolfinx_joints.geometry.arch import ArchDam, Sector, mid_crest
from dolfinx_joints.geometry.arch_mesh import fitted_level, half_elevation
from dolfinx_joints.geometry.meshing import gmsh_model
from dolfinx_joints.geometry.meshing.arguments import (
    Cell,
    Length,
    NumberOfJoints,
    NumberOfLayers,
    Order,
    Share,
    add_flags,
    argument_parser,
    mesh_path,
)
from dolfinx_joints.geometry.meshing.extrusion import (
    BoolArray,
    FloatArray,
    PlaneMesh,
    extrude,
    mirror,
)

__all__ = ["ArchDam", "ambiesta", "main", "mid_crest"]


@checked
def ambiesta(
    out: str | os.PathLike[str],
    *,
    size: Length = 5.5,
    order: Order = 2,
    cell: Cell = "hex",
    joints: NumberOfJoints = 11,
    active_height: Share = 0.75,
    crest_arch: bool = True,
    layers: NumberOfLayers = 1,
    parameters: ArchDam | None = None,
    gui: bool = False,
    duplicated: bool = False,
) -> Path:
    """Mesh an arch dam with its contraction joints: x downstream, y across the valley, z up.

    The joints are vertical planes through the axis of the crest's arch, at equal arcs of the
    crest. Joint k, counted from -y to +y, is the group ``joint_k``; it contains the part below the
    active height. A joint whose active part is lower than half a cell has no group, so numbers may
    be missing at both ends.

    Further groups: volume ``concrete``; surfaces ``upstream``, ``downstream``, ``crest``, ``base``
    (the flat bottom) and ``abutments``. All nodes lie on the exact shape. The edge between base
    and abutments follows the nearest element edges. The mesh is symmetric about y = 0.

    Args:
        out: path of the .msh file.
        size: cell size in elevation [m].
        order: order of the elements, 1 or 2.
        cell: "hex" or "tet".
        joints: number of joints, 0 for a monolithic dam.
        active_height: relative height up to which the joints can open, in (0, 1].
        crest_arch: continue the dam without joints above the active height. Otherwise the dam ends
            at the active height, and the joints are radial at this level.
        layers: number of elements through the thickness.
        parameters: shape of the dam; None for the default.
        gui: show the mesh in Gmsh's window afterwards.
        duplicated: duplicate the joint faces: group NAME becomes NAME- and NAME+. `read_msh`
            makes the same split mesh from both files; runs without joints need a conforming file.

    Returns:
        The path written.

    Raises:
        ValueError: if an argument is not allowed.
        RuntimeError: if the shape is so extreme that cells are turned inside out.
    """
    out = mesh_path(out)
    gmsh_model.check_window(gui)
    dam = parameters or ArchDam()
    sector = Sector(dam, 1.0 if crest_arch else active_height)
    plane = _elevation(sector, size, cell, joints, active_height)
    solid = extrude(plane, np.linspace(0, 1, layers + 1), ("upstream", "downstream"))
    depth = 0.5 * size / dam.height

    def place(reference: FloatArray, groups: dict[str, BoolArray]) -> FloatArray:
        theta, ta = reference[:, 0] / sector.radius, reference[:, 2]
        foundation = groups["base"] | groups["abutments"]
        zeta = fitted_level(sector, theta, ta, reference[:, 1] / dam.height, active_height, depth)
        zeta = np.where(foundation, sector.foundation(theta, ta), zeta)
        zeta = np.where(groups["crest"], sector.top, zeta)
        s = sector.across(theta, ta, zeta)
        if not np.abs(s).max() < 1 + 1e-6:
            raise RuntimeError(
                "the abutments fold back as seen from the axis of the crest's arch, but the "
                "valley must widen steadily up to the crest: choose a less extreme shape."
            )
        return dam.point(s, ta, zeta)

    return gmsh_model.write_mesh(out, solid, order, place=place, gui=gui, duplicated=duplicated)


def _elevation(sector: Sector, size: float, cell: str, joints: int, active: float) -> PlaneMesh:
    """Return the mesh of the surface halfway between the faces, developed about the axis.

    The coordinates are a = (radius of the top's upstream edge) theta and z [m].

    Args:
        sector: the body and the axis of its top arch.
        size: cell size [m].
        cell: "hex" or "tet".
        joints: number of joints.
        active: relative height up to which the joints are active.
    """
    end = sector.radius * sector.half_angle
    arcs = end * (2 * np.arange(1, joints + 1) / (joints + 1) - 1)
    one_side = {f"joint_{k}": max(a, 0.0) for k, a in enumerate(arcs, start=1) if 2 * k > joints}
    half = half_elevation(sector, size, cell, one_side, active)
    twins = {f"joint_{k}": f"joint_{joints + 1 - k}" for k in range(1, joints + 1)}
    full = mirror(half, twins)
    names = [name for name in half.edges if not name.startswith("joint")]
    names += [f"joint_{k}" for k in range(1, joints + 1) if f"joint_{k}" in full.edges]
    return PlaneMesh(full.points, full.cells, {name: full.edges[name] for name in names})


def main(argv: list[str] | None = None) -> None:
    """Run the script."""
    text = "Mesh an arch dam with contraction joints."
    parser = argument_parser(ambiesta, text, "ambiesta.msh")
    add_flags(parser, ArchDam)
    shape = [field.name for field in fields(ArchDam)]

    def model(out: Path, **options: object) -> Path:
        dam = ArchDam(**{name: options.pop(name) for name in shape})  # type: ignore[arg-type]
        return ambiesta(out, parameters=dam, **options)  # type: ignore[arg-type]

    gmsh_model.run_script(parser, model, argv)


if __name__ == "__main__":
    main()
