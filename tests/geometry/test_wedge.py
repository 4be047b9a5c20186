# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wedges between planes: volume and areas, names of joints, factor of safety, bad input."""

import math

from mpi4py import MPI

import numpy as np
import pytest
from mesh_groups import facet_area
from scipy.spatial import ConvexHull, HalfspaceIntersection

import dolfinx_joints as dj
from dolfinx_joints.exact import SlidingWedge, WedgePlane, plane_normal
from dolfinx_joints.geometry import wedge as script
from dolfinx_joints.geometry.meshing import gmsh_model
from dolfinx_joints.geometry.wedge import wedge

# Dip and dip direction of the planes A and B and of the slope, an example of Hoek and Bray.
A, B, FACE = (45.0, 105.0), (70.0, 235.0), (65.0, 185.0)
HEIGHT = 10.0  # from the toe of the wedge to the level ground above it [m]
TOE = (0.0, 0.0, 0.0)
CRACK = (80.0, 165.0, -4.0, 9.0, 10.0)
BOX = {"lower": (-25.0, -10.0, -5.0), "upper": (25.0, 30.0, HEIGHT)}
INSIDE = (-1.5, 3.5, 5.0)


def polyhedron(planes):
    """Return the hull of the wedge under the slope and the ground, and the area on each plane."""
    sides = [(p[:2], np.array(p[2:])) for p in planes.values()]
    rows = [[*-plane_normal(*dips), plane_normal(*dips) @ x] for dips, x in sides]
    rows += [[*plane_normal(*FACE), 0.0], [0.0, 0.0, 1.0, -HEIGHT]]
    rows = np.array(rows)
    rows *= -np.sign(rows[:, :3] @ INSIDE + rows[:, 3])[:, None]  # negative inside
    hull = ConvexHull(HalfspaceIntersection(rows, np.array(INSIDE)).intersections)
    areas = {}
    for name, (normal, x) in zip(planes, [(plane_normal(*d), x) for d, x in sides], strict=True):
        corners = hull.points[hull.simplices]
        on = np.abs((corners - x) @ normal).max(axis=1) < 1e-6
        edges = np.diff(corners[on], axis=1)
        areas[name] = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum()
    return hull, areas


@pytest.mark.parametrize("crack", [False, True])
def test_volume_and_joints_of_a_wedge(tmp_path, crack):
    planes = {"a": (*A, *TOE), "b": (*B, *TOE)} | ({"crack": CRACK} if crack else {})
    options = {"inside": INSIDE, "ground": [(*FACE, *TOE)], "size": 6.0, "joint_size": 3.0, **BOX}
    path = wedge(tmp_path / "w.msh", planes=planes, **options)
    report = gmsh_model.describe(path)
    assert set(report.num_facets) == {f"joint_{n}" for n in planes} | {
        "outer",
        "ground",
        "wedge_top",
    }
    hull, areas = polyhedron(planes)  # half-spaces, without Gmsh
    assert report.volume["wedge"] == pytest.approx(hull.volume, rel=1e-6)
    for name, exact in areas.items():
        assert facet_area(path, f"joint_{name}") == pytest.approx(exact, rel=1e-6), name
    assert dj.read_msh(path, MPI.COMM_SELF).joint_names == tuple(f"joint_{n}" for n in planes)


def test_factor_of_safety_by_the_formula_of_hoek_and_bray(tmp_path):
    planes = {"a": (*A, *TOE), "b": (*B, *TOE)}
    hull, areas = polyhedron(planes)
    weight, water = 25e3, 9.81e3  # [N/m^3]
    pressure = water * HEIGHT / 6  # mean of a pyramid of water with the greatest at mid-height
    strength = {"a": (20.0, 24e3), "b": (30.0, 48e3)}
    block = SlidingWedge(
        planes=[
            WedgePlane(
                dip=planes[n][0],
                dip_direction=planes[n][1],
                friction_angle_deg=phi,
                cohesion=c,
                area=areas[n],
                pressure=pressure,
            )
            for n, (phi, c) in strength.items()
        ],
        force=(0.0, 0.0, -weight * hull.volume),
    )
    # Lines: 1 and 2 of A and B with the slope, 3 and 4 with the ground, 5 of A with B.
    a, b, face, up = plane_normal(*A), plane_normal(*B), plane_normal(*FACE), np.array([0, 0, 1.0])
    one, two, three, four, five = (
        v / np.linalg.norm(v) for v in map(np.cross, (a, b, a, b, a), (face, face, up, up, b))
    )

    def cos(u, v):
        return abs(u @ v)

    def sin(u, v):
        return math.sqrt(1.0 - (u @ v) ** 2)

    plunge = abs(five[2])
    x = sin(two, four) / (sin(four, five) * cos(two, a))
    y = sin(one, three) / (sin(three, five) * cos(one, b))
    factor_a = (a[2] - b[2] * (a @ b)) / (plunge * sin(a, b) ** 2)
    factor_b = (b[2] - a[2] * (a @ b)) / (plunge * sin(a, b) ** 2)
    bond = 3.0 / (weight * HEIGHT) * (strength["a"][1] * x + strength["b"][1] * y)
    friction = sum(
        (factor - water / (2.0 * weight) * arm) * math.tan(math.radians(phi))
        for factor, arm, (phi, _) in zip(
            (factor_a, factor_b), (x, y), strength.values(), strict=True
        )
    )
    assert block.factor_of_safety == pytest.approx(bond + friction, rel=1e-9)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"planes": {"a": (95.0, 105.0, *TOE)}}, "dip from 0 to 90"),
        ({"planes": {"a": (45.0, 105.0)}}, "must be .dip, dip direction, x, y, z"),
        (
            {"planes": {"far": (45.0, 105.0, 90.0, 0.0, 0.0)}},
            "'far' .* does not bound",
        ),
        ({"planes": {}}, "planes is {}; it must be planes by name, at least one"),
        ({"planes": [(*A, *TOE)]}, "planes is .*; it must be planes by name"),
        ({"planes": {"a": (*A, *TOE), "c": (*A, *TOE)}}, "'c' is given twice or does not bound"),
        ({"ground": (*FACE, *TOE)}, "'ground_1' is 65.0, but it must be .dip, dip direction"),
        ({"ground": [(*FACE, *TOE)], "inside": (-1.5, -3.5, 5.0)}, "is not below the plane"),
        ({"inside": TOE}, "lies on the plane"),
        ({"inside": (0.0, 0.0, 40.0)}, "not inside the rock"),
        ({"lower": (0.0, 0.0, 40.0)}, "x, y and z must increase"),
    ],
)
def test_bad_wedges_are_refused(tmp_path, changed, message):
    options = {"planes": {"a": (*A, *TOE)}, "inside": INSIDE, "size": 10.0, **BOX}
    with pytest.raises(ValueError, match=message):
        wedge(tmp_path / "w.msh", **(options | changed))


def test_script(tmp_path, capsys):
    out = str(tmp_path / "w.msh")
    sides = ["--plane", "left=45,135,0,0,12", "--plane", "right=45,225,0,0,12"]
    box = ["--lower=-30,-20,-5", "--upper", "30,20,20", "--inside=0,-5,12"]
    options = [*sides, "--ground", "65,180,0,-15,0", *box, "--size", "8", "--out", out]
    script.main(options)
    assert ", 2 joints with " in capsys.readouterr().out
    for wrong, message in (
        (["--plane", "left=45,125,0,0,12"], "two of the planes have the same name"),
        (["--plane", "foo"], "'foo' is not NAME=DIP,DIRECTION,X,Y,Z"),
        (["--inside", "foo"], "'foo' is not numbers such as 1,2,3"),
    ):
        with pytest.raises(SystemExit):
            script.main([*options, *wrong])
        assert message in capsys.readouterr().err
