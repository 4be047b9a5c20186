# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh of an arch dam from a table of sections, with contraction joints and a foundation.

python3 geometry/sections_dam.py sections.csv --joints 9 --foundation 60 --perimetral --out dam.msh
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import annotated_types as at
import numpy as np

if not __package__:  # run as a script: make the package importable
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.geometry.arch import Sector
from dolfinx_joints.geometry.arch_mesh import (
    Block,
    fitted_level,
    ground_ring,
    half_elevation,
    solid_with_foundation,
)
from dolfinx_joints.geometry.meshing import gmsh_model
from dolfinx_joints.geometry.meshing.arguments import (
    MAX_JOINTS,
    Cell,
    Length,
    NumberOfLayers,
    Order,
    Share,
    argument_parser,
    mesh_path,
)
from dolfinx_joints.geometry.meshing.extrusion import BoolArray, FloatArray, PlaneMesh, extrude
from dolfinx_joints.geometry.section_table import SectionTable, read_sections

_SIDES = (1, -1)
_CLOSEST = 1e-6  # least angle between two joints, relative to the angle of the crest


@checked
def sections_dam(
    out: str | os.PathLike[str],
    table: SectionTable | str | os.PathLike[str],
    *,
    size: Length = 5.0,
    order: Order = 2,
    cell: Cell = "hex",
    layers: NumberOfLayers = 1,
    joints: int | Sequence[float] = 9,
    active_height: Share = 1.0,
    foundation: Length | None = None,
    spread: Annotated[float, at.Ge(0), at.Unit("m")] | None = None,
    perimetral: bool = False,
    gui: bool = False,
    duplicated: bool = False,
) -> Path:
    """Mesh an arch dam given by sections: x downstream, y to the left bank, z the elevation.

    The joints are vertical planes through the axis of the crest's arch. Joint k, counted from the
    right bank (-y) to the left, is the group ``joint_k``; it contains the part below the active
    height. A joint whose active part is lower than half a cell has no group.

    Further groups: volume ``concrete``; surfaces ``upstream``, ``downstream``, ``crest``, ``base``
    (the flat bottom) and ``abutments``. With a foundation, ``base`` and ``abutments`` become one
    surface, ``joint_perimetral`` or, without that joint, ``contact``. The volume ``foundation``
    is a block around a valley that continues straight upstream and downstream; its outer surface is
    ``foundation_outer`` (to be supported), its free surface ``foundation_free``. The nodes of the
    dam lie on the exact shape.

    Args:
        out: path of the .msh file.
        table: the sections, or their CSV file.
        size: cell size in elevation [m].
        order: order of the elements, 1 or 2.
        cell: "hex" or "tet".
        layers: number of elements through the thickness.
        joints: number of joints at equal arcs of the crest, or ascending angles of the joints
            [degrees], measured about the axis of the crest's arch from the crown to the left bank.
        active_height: relative height up to which the joints can open, in (0, 1].
        foundation: extent of the foundation below the base and beyond the widest part of the dam on
            both banks [m], usually at least the height of the dam; None for no foundation.
        spread: extent of the foundation upstream and downstream of the dam [m], by default equal
            to ``foundation``; 0 gives a saddle as thick as the dam (pulvino).
        perimetral: add a joint between dam and foundation.
        gui: show the mesh in Gmsh's window afterwards.
        duplicated: duplicate the joint faces: group NAME becomes NAME- and NAME+.

    Returns:
        The path written.

    Raises:
        ValueError: if an argument or the table is not allowed.
        RuntimeError: if the shape is so extreme that cells are turned inside out.
    """
    out = mesh_path(out)
    gmsh_model.check_window(gui)
    if perimetral and foundation is None:
        raise ValueError("perimetral is True, but a perimetral joint needs a foundation.")
    if spread is not None and foundation is None:
        raise ValueError(f"spread is {spread:g}, but foundation is not given.")
    if not isinstance(table, SectionTable):
        table = read_sections(table)
    sectors = {side: Sector(table.half(side)) for side in _SIDES}
    reach = foundation or 0.0 if spread is None else spread
    block = None if foundation is None else Block(sectors, foundation, reach, size)
    arcs = _joint_arcs(sectors, joints)
    plane = _elevation(sectors, size, cell, arcs, active_height)
    levels = np.linspace(0, 1, layers + 1)
    if block is None:
        solid = extrude(plane, levels, ("upstream", "downstream"))
    else:
        plane = ground_ring(plane, block, cell)
        vertices = plane.points[np.unique(plane.edges["ground"])]
        contact = "joint_perimetral" if perimetral else "contact"
        solid = solid_with_foundation(plane, levels, block, contact)

    def place(reference: FloatArray, groups: dict[str, BoolArray]) -> FloatArray:
        ground = np.zeros(len(reference), dtype=bool)
        for name in ("base", "abutments", "joint_perimetral", "contact"):
            ground |= groups.get(name, False)
        xyz = np.empty_like(reference)
        for side, sector in sectors.items():
            half = side * reference[:, 0] >= 0
            local = reference[half] * [side, 1, 1]
            part = _dam_xyz(sector, local, ground[half], groups["crest"][half], active_height, size)
            if block is not None:
                line = vertices[side * vertices[:, 0] >= 0] * [side, 1]
                part = block.place(sector, local, ground[half], line, part)
            xyz[half] = part * [1, side, 1]
        return xyz + np.array([0.0, 0.0, table.base])

    return gmsh_model.write_mesh(out, solid, order, place=place, gui=gui, duplicated=duplicated)


def _joint_arcs(sectors: dict[int, Sector], joints: int | Sequence[float]) -> dict[str, float]:
    """Return the coordinate a of each joint by name [m]."""
    left, right = (np.degrees(sectors[side].half_angle) for side in _SIDES)
    if isinstance(joints, int):
        if not 0 <= joints <= MAX_JOINTS:
            raise ValueError(f"joints is {joints}, but there must be 0 to {MAX_JOINTS}.")
        angles = -right + (left + right) * np.arange(1, joints + 1) / (joints + 1)
    else:
        angles = np.asarray(joints, dtype=float)
        rising = np.diff([-right, *angles, left]) > _CLOSEST * (left + right)
        if not rising.all() or len(angles) > MAX_JOINTS:
            raise ValueError(
                f"joints is {shown(joints)}, but the angles must rise and lie between "
                f"-{right:.4g} and {left:.4g} degrees, the ends of the crest."
            )
    angles = np.where(np.abs(angles) < 1e-9 * (left + right), 0.0, angles)
    radius = sectors[1].radius
    return {f"joint_{k}": radius * float(np.radians(a)) for k, a in enumerate(angles, start=1)}


def _elevation(
    sectors: dict[int, Sector], size: float, cell: str, arcs: dict[str, float], active: float
) -> PlaneMesh:
    """Return the mesh halfway between the faces in a (to the left bank) and z from the base."""
    halves = {}
    for side, sector in sectors.items():
        own = {name: side * a for name, a in arcs.items() if side * a > 0 or (a == 0 and side > 0)}
        halves[side] = half_elevation(sector, size, cell, own, active)
    plus, minus = halves[1], halves[-1]
    points = np.concatenate([plus.points, minus.points * [-1, 1] + 0.0])
    points, number = np.unique(points, axis=0, return_inverse=True)
    number = number.reshape(-1)
    shift = len(plus.points)
    cells = [number[plus.cells["concrete"]], number[minus.cells["concrete"] + shift][:, ::-1]]
    edges = {}
    for name in ("crest", "base", "abutments", *arcs):
        parts = [plus.edges.get(name), minus.edges.get(name)]
        numbered = [number[p + i * shift] for i, p in enumerate(parts) if p is not None]
        if numbered:
            edges[name] = np.concatenate(numbered)
    return PlaneMesh(points, {"concrete": np.concatenate(cells)}, edges)


def _dam_xyz(
    sector: Sector,
    reference: FloatArray,
    ground: BoolArray,
    crest: BoolArray,
    active: float,
    size: float,
) -> FloatArray:
    """Return (x, y, z) of dam nodes at (a, z, ta), z from the base, shape (num_nodes, 3)."""
    theta, zeta, ta = reference.T / [[sector.radius], [sector.dam.height], [1.0]]
    ta = np.clip(ta, 0, 1)
    if not sector.upright:
        fitted = fitted_level(sector, theta, ta, zeta, active, 0.5 * size / sector.dam.height)
        zeta = np.where(ground, sector.foundation(theta, ta), fitted)
    zeta = np.clip(np.where(crest, 1.0, zeta), 0, 1)
    return sector.dam.point(sector.across(theta, ta, zeta), ta, zeta)


def main(argv: list[str] | None = None) -> None:
    """Run the script."""
    parser = argument_parser(sections_dam, "Mesh an arch dam given by sections.", "dam.msh")
    parser.add_argument("table", type=Path, help="CSV file of the sections")
    angles = "joint angles [degrees], instead of --joints"
    parser.add_argument("--joint-angles", dest="joints", type=float, nargs="+", help=angles)
    gmsh_model.run_script(parser, sections_dam, argv)


if __name__ == "__main__":
    main()
