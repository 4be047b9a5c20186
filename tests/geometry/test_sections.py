# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arch dams from tables of sections: volumes, joints, foundation, and every malformed table."""

import warnings
from itertools import pairwise

from mpi4py import MPI

import gmsh
import numpy as np
import pytest
from mesh_groups import ELEMENTS, Groups, area, check_groups, dam_volume
from scipy.spatial import cKDTree

import dolfinx_joints as dj
from dolfinx_joints.geometry import sections_dam as script
from dolfinx_joints.geometry.arch import ArchDam
from dolfinx_joints.geometry.meshing import gmsh_model
from dolfinx_joints.geometry.section_table import SectionTable, read_sections
from dolfinx_joints.geometry.sections_dam import sections_dam

# A cylinder: radii 50 and 46 m, 40 degrees to the left and 60 to the right, 30 m high.
CYLINDER = """# a cylinder
elevation, extrados_radius, crown_thickness, left_angle, right_angle
200, 50, 4, 40, 60

230, 50, 4, 40, 60
"""
# Faces with different centres, one bank wider than the other.
ECCENTRIC = """elevation,extrados_radius,intrados_radius,crown_thickness,left_angle,right_angle,\
centre_x
200,60,48,9,15,20,70
215,68,58,7.5,28,33,70
235,80,71.5,6,38,45,71
260,95,88,4,45,52,74
"""


def write(tmp_path, text):
    path = tmp_path / "sections.csv"
    path.write_text(text)
    return path


def table_volume(table):
    """Integrate the volume of a table's dam [m^3]: (R^2 - (R - t)^2)/2 over angle and height."""
    u, weights = np.polynomial.legendre.leggauss(20)
    levels = (table.columns["elevation"] - table.base) / table.height
    volume = 0.0
    for half in (table.half(1), table.half(-1)):
        for low, high in pairwise(levels):
            zeta = low + (high - low) * (u + 1) / 2
            t, r = half.thickness(zeta[:, None], (u + 1) / 2), half.radius(zeta)[:, None]
            section = (r * t - 0.5 * t**2) @ (weights / 2) * half.half_angle(zeta)
            volume += (high - low) * table.height * section @ (weights / 2)
    return volume


@pytest.mark.parametrize(("cell", "order", "element"), ELEMENTS)
def test_volume_and_joints_of_a_cylinder(tmp_path, cell, order, element):
    path = sections_dam(
        tmp_path / "d.msh", write(tmp_path, CYLINDER), size=6, order=order, cell=cell, joints=4
    )
    report = gmsh_model.describe(path)
    assert report.element == element
    groups = Groups(path)
    check_groups(groups)
    # Four joints at equal arcs of 100 degrees: 20 degrees from bank to joint to joint; the crown
    # lies at 40 of them, on a line of nodes as well.
    x, y, _ = groups.at("crest").T
    angles = np.unique(np.degrees(np.arctan2(y, -x)).round(6))[:: 2 if order == 2 else 1]
    assert {-60.0, -40.0, -20.0, 0.0, 20.0, 40.0} <= set(angles)
    # Half of (50^2 - 46^2) times the height and the angle; with chords sin(da) stands for da.
    steps = np.radians(np.diff(angles))
    chords = np.sin(steps).sum() if order == 1 else steps.sum()
    tolerance = 1e-12 if order == 1 else 5e-6  # of parabolas through three points of an arc
    assert report.volume["concrete"] == pytest.approx(192 * 30 * chords, rel=tolerance)
    for k, angle in enumerate((-40, -20, 0, 20), start=1):
        assert area(groups, f"joint_{k}") == pytest.approx(4 * 30, rel=1e-12)
        x, y, z = groups.at(f"joint_{k}").T
        np.testing.assert_allclose(np.degrees(np.arctan2(y, -x)), angle, atol=1e-10)
        assert (z.min(), z.max()) == pytest.approx((200, 230), rel=1e-14)
    for name, radius in (("upstream", 50), ("downstream", 46)):
        np.testing.assert_allclose(np.hypot(*groups.at(name)[:, :2].T), radius, rtol=1e-12)
    assert report.min_scaled_jacobian > 0.2


def ambiesta_table():
    """The default dam's own numbers at 41 levels, closer near the base where the valley widens."""
    dam, zeta = ArchDam(), np.linspace(0, 1, 41) ** 2
    angle = np.degrees(dam.half_angle(zeta))
    return SectionTable(
        {
            "elevation": dam.height * zeta,
            "extrados_radius": dam.radius(zeta),
            "crown_thickness": dam.thickness(zeta, 0),
            "left_thickness": dam.thickness(zeta, 1),
            "right_thickness": dam.thickness(zeta, 1),
            "left_angle": angle,
            "right_angle": angle,
            "centre_x": dam.centre(zeta),
        }
    )


def test_the_dam_like_ambiesta_comes_back_from_its_sections(tmp_path):
    path = sections_dam(
        tmp_path / "d.msh", ambiesta_table(), size=5.5, joints=11, active_height=0.75
    )
    report = gmsh_model.describe(path)
    # As far from the exact volume as the mesh of the formulas themselves may be.
    assert report.volume["concrete"] == pytest.approx(dam_volume(ArchDam()), rel=5e-4)
    assert report.min_scaled_jacobian > 0.4
    groups = Groups(path)
    check_groups(groups)
    assert {name for name in groups.facets if "joint" in name} == {
        f"joint_{k}" for k in range(2, 11)
    }
    # The crown's thickness is 9 - 7 zeta, linear, which the interpolation keeps.
    exact = 57 * (9 * 0.75 - 3.5 * 0.75**2)
    assert area(groups, "joint_6") == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("cell", ["hex", "tet"])
def test_faces_with_different_centres(tmp_path, cell):
    file = write(tmp_path, ECCENTRIC)
    table = read_sections(file)
    path = sections_dam(tmp_path / "d.msh", file, size=6, cell=cell, joints=[-30, 0, 12.5])
    groups = Groups(path)
    check_groups(groups)
    # Chords of the curved ground take or add a little.
    volume = table_volume(table)
    assert gmsh_model.describe(path).volume["concrete"] == pytest.approx(volume, rel=2e-3)
    axis = 74.0  # of the crest's arch
    for k, angle in enumerate((-30, 0, 12.5), start=1):
        x, y, _ = groups.at(f"joint_{k}").T
        np.testing.assert_allclose(np.degrees(np.arctan2(y, axis - x)), angle, atol=1e-10)
    # In the sections of the table both faces are the arcs that it says.  The intrados' centre is
    # R - r - t nearer to the crown than that of the extrados.
    at = table.columns
    levels = (at["elevation"] - 200) / 60
    for half in (table.half(1), table.half(-1)):
        s = np.linspace(0, 1, 7)
        x, y, _ = np.moveaxis(half.point(s, 1.0, levels[:, None]), -1, 0)
        e = at["extrados_radius"] - at["intrados_radius"] - at["crown_thickness"]
        distance = np.hypot(x - (at["centre_x"] - e)[:, None], y)
        np.testing.assert_allclose(distance / at["intrados_radius"][:, None], 1, rtol=1e-12)
    right = table.half(-1).half_angle(levels)
    np.testing.assert_allclose(np.degrees(right), [20, 33, 45, 52], rtol=1e-12)


@pytest.mark.parametrize(("cell", "order", "element"), ELEMENTS)
@pytest.mark.parametrize("spread", [pytest.param(None, marks=pytest.mark.slow), 0.0])
@pytest.mark.parametrize("text", [CYLINDER, ECCENTRIC], ids=["cylinder", "eccentric"])
def test_foundation(tmp_path, text, spread, cell, order, element):
    file, options = write(tmp_path, text), {"size": 10, "order": order, "cell": cell, "joints": 3}
    alone = gmsh_model.describe(sections_dam(tmp_path / "a.msh", file, **options))
    path = sections_dam(
        tmp_path / "d.msh", file, **options, foundation=20.0, spread=spread, perimetral=True
    )
    report, groups = gmsh_model.describe(path), Groups(path)
    check_groups(groups)
    assert report.element == element
    assert report.volume["concrete"] == pytest.approx(alone.volume["concrete"], rel=1e-9)
    # What base and abutments were without a foundation is the perimetral joint.
    facets = alone.num_facets["base"] + alone.num_facets["abutments"]
    assert report.num_facets["joint_perimetral"] == facets
    assert groups.at("foundation_outer")[:, 2].min() == pytest.approx(180, rel=1e-11)
    crest = groups.at("crest")[:, 2]
    assert set(crest) == {crest[0]}
    assert groups.points[:, 2].max() == crest[0]


def test_volume_of_a_saddle_under_a_cylinder(tmp_path):
    path = sections_dam(
        tmp_path / "d.msh", write(tmp_path, CYLINDER), size=3, foundation=15.0, spread=0.0
    )
    # The saddle is enlarged by (30 + 15)/30 about the crest's middle and goes from radius 50 to 46:
    # (50^2 - 46^2)/2 times the angles and the heights, less the valley.
    arcs = np.radians(100)
    exact = (50**2 - 46**2) / 2 * (1.5 * arcs * 45 - arcs * 30)
    report = gmsh_model.describe(path)
    assert report.volume["foundation"] == pytest.approx(exact, rel=1e-5)
    assert "contact" in report.num_facets
    assert not any("perimetral" in name for name in report.num_facets)


def columns_table(rows):
    """Return a table of rows: elevation, radius, crown thickness, angles left and right, centre."""
    names = ("elevation", "extrados_radius", "crown_thickness", "left_angle", "right_angle")
    columns = np.array(rows, dtype=float).T
    return SectionTable(dict(zip((*names, "centre_x"), columns, strict=True)))


VALLEYS = {
    # The crest's chord is 0.9 heights.
    "narrow V": columns_table(
        [
            (0, 52, 18, 22, 22, 52),
            (40, 60, 14, 32, 32, 58),
            (80, 68, 10, 41, 41, 65),
            (120, 76, 5, 48, 48, 74),
        ]
    ),
    # The crest's chord is four heights, the base's three.
    "wide U": columns_table(
        [(0, 150, 18, 38, 38, 150), (20, 155, 13, 42, 42, 155), (60, 165, 5, 46, 46, 165)]
    ),
    # A radius of 0.6 heights, 140 degrees from bank to bank.
    "strongly curved": columns_table(
        [
            (0, 40, 14, 35, 35, 40),
            (30, 48, 11, 50, 50, 48),
            (60, 55, 8, 62, 62, 55),
            (100, 60, 4, 70, 70, 60),
        ]
    ),
    "asymmetric": columns_table(
        [
            (200, 60, 9, 15, 25, 70),
            (215, 68, 7.5, 20, 40, 70),
            (235, 80, 6, 26, 52, 71),
            (280, 110, 4, 32, 60, 76),
        ]
    ),
    "cylinder": columns_table([(200, 50, 4, 40, 60, 0), (230, 50, 4, 40, 60, 0)]),
}


def rock_volume(table, depth):
    """Integrate the rock volume [m^3]: the block less the valley and the dam.

    The block's cross-section is the rectangle of the dam's height and width with a strip of
    ``depth`` on three sides and quarter circles at the corners.
    """
    s, zeta = np.linspace(0, 1, 401), np.linspace(0, 1, 401)[:, None]
    faces = [[half.point(s, ta, zeta) for ta in (0.0, 1.0)] for half in map(table.half, (1, -1))]
    x, y, _ = np.moveaxis(np.array(faces), -1, 0)
    start, end, width = x.min() - depth, x.max() + depth, y.max(axis=(1, 2, 3)).sum()
    section = (width + 2 * depth) * table.height + width * depth + np.pi * depth**2 / 2
    upstream, downstream = np.abs(x - np.array([start, end])[:, None, None]).swapaxes(0, 1)
    y_up, y_down = y.swapaxes(0, 1)
    areas = np.trapezoid(upstream, y_up) + np.trapezoid(downstream, y_down)
    valley = np.trapezoid(areas.sum(axis=0), table.height * zeta[:, 0])
    return section * (end - start) - valley - table_volume(table)


@pytest.mark.parametrize(
    ("cell", "order"), [("hex", 1), ("hex", 2), pytest.param("tet", 2, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("valley", VALLEYS)
def test_foundations_extend_by_the_height_in_all_directions(tmp_path, valley, cell, order):
    table = VALLEYS[valley]
    height = table.height
    options = {"size": height / 6, "order": order, "cell": cell, "joints": 3}
    path = sections_dam(tmp_path / "d.msh", table, **options, foundation=height, perimetral=True)
    report, groups = gmsh_model.describe(path), Groups(path)
    check_groups(groups)
    assert report.min_scaled_jacobian > (0.01 if cell == "tet" else 0.25)
    dam, outer = groups.at("concrete"), groups.at("foundation_outer")
    # Upstream, right bank and base; downstream and left bank.
    below, above = dam.min(axis=0) - outer.min(axis=0), (outer.max(axis=0) - dam.max(axis=0))[:2]
    np.testing.assert_allclose([*below, *above], height, rtol=1e-3)
    assert cKDTree(dam).query(outer)[0].min() > (1 - 1e-4) * height
    exact = rock_volume(table, height)
    assert report.volume["foundation"] == pytest.approx(exact, rel=1e-3 if order == 2 else 0.02)
    if order == 1:  # no cells overlap: the middle of each is in one cell only
        with gmsh_model.gmsh_session():
            gmsh.merge(str(path))
            kind = gmsh.model.mesh.getElementTypes(3)[0]
            for point in gmsh.model.mesh.getBarycenters(kind, -1, False, True).reshape(-1, 3):
                assert len(gmsh.model.mesh.getElementsByCoordinates(*point, 3, True)) == 1


def test_a_foundation_smaller_than_the_dam_is_implausible(tmp_path):
    options = {"size": 10, "order": 1, "joints": 0}
    sentence = r"extends 20 m beyond the dam, but usually by at least its height of 30 m"
    with pytest.warns(dj.PlausibilityWarning, match=sentence):
        sections_dam(tmp_path / "d.msh", write(tmp_path, CYLINDER), **options, foundation=20.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for small in ({"foundation": 30.0}, {"foundation": 5.0, "spread": 0.0}):
            sections_dam(tmp_path / "d.msh", VALLEYS["cylinder"], **options, **small)


def test_the_joints_of_such_a_dam_open_where_they_meet(tmp_path):
    path = sections_dam(
        tmp_path / "d.msh",
        write(tmp_path, CYLINDER),
        size=10,
        order=1,
        joints=2,
        foundation=10.0,
        perimetral=True,
    )
    groups = Groups(path)
    jointed = dj.read_msh(path, MPI.COMM_SELF)
    assert jointed.joint_names == ("joint_1", "joint_2", "joint_perimetral")
    # Every node of a joint is doubled, and once more where a vertical one meets the perimetral.
    nodes = [set(groups.nodes[name]) for name in jointed.joint_names]
    extra = len(nodes[2]) + sum(len(n) for n in nodes[:2])
    assert jointed.mesh.geometry.x.shape[0] == len(groups.points) + extra


HEADER = "elevation,extrados_radius,crown_thickness,left_angle,right_angle\n"
ROWS = "0,50,4,40,60\n30,50,4,40,60\n"
BAD_TABLES = {
    "empty": ("", "FILE is empty."),
    "no section": (HEADER, "FILE has 0 sections, but at least 2 are needed."),
    "missing column": (
        "elevation,crown_thickness,left_angle,right_angle\n0,4,40,60\n",
        "FILE, line 1: the column 'extrados_radius' is missing.",
    ),
    "no header": (ROWS, "FILE, line 1: '0' is not a column of a table of sections: elevation, "),
    "column given twice": (
        HEADER.replace("left", "right") + ROWS,
        "FILE, line 1: the column 'right_angle' is given 2 times.",
    ),
    "no thickness": (
        "elevation,extrados_radius,left_angle,right_angle\n0,50,40,60\n",
        "FILE, line 1: the thickness is given by no column, but it must be given by one of: ",
    ),
    "truncated": (HEADER + ROWS[:-6], "FILE, line 3: 4 values for 5 columns."),
    "text in numbers": (
        HEADER + "0,50,four,40,60\n",
        "FILE, line 2: crown_thickness is 'four', which is not a finite number.",
    ),
    "falling elevations": (
        HEADER + "30,50,4,40,60\n0,50,4,40,60\n",
        "FILE, section 2: elevation is 0, but it must be above the previous section.",
    ),
    "thickness of zero": (
        HEADER + ROWS.replace("30,50,4", "30,50,0"),
        "FILE, section 2: crown_thickness is 0, but it must be positive [m].",
    ),
    "thicker than the radius": (
        HEADER + ROWS.replace("50,4", "50,60"),
        "FILE, section 1: crown_thickness is 60, but it must be below extrados_radius.",
    ),
    "angle of 90 degrees": (
        HEADER + ROWS.replace("40,60", "90,60"),
        "FILE, section 1: left_angle is 90, but it must be in (0, 90) [degrees].",
    ),
    "angles in radians": (
        HEADER + ROWS.replace("40,60", "0.7,1.05"),
        "FILE has no angle above 1.05, but angles must be in degrees.",
    ),
    "elevations in millimetres": (
        HEADER + ROWS.replace("30,", "30000,"),
        "FILE gives a dam 30000 m high, but elevations must be in metres and within 1000 m.",
    ),
    "downstream face too short": (
        HEADER.replace("crown", "intrados_radius,crown")
        + "0,50,50.5,4,40,60\n30,50,50.5,4,40,60\n".replace("50.5", "20"),
        "FILE: at elevation 0 m the downstream face does not reach the right abutment",
    ),
    "abutment that turns back": (
        HEADER + "0,50,4,40,60\n10,50,4,50,60\n30,50,4,45,60\n",
        "FILE: at elevation 10.125 m the left abutment does not move away from the crown",
    ),
}


@pytest.mark.parametrize("kind", BAD_TABLES)
def test_malformed_tables(tmp_path, kind):
    text, sentence = BAD_TABLES[kind]
    file = write(tmp_path, text)
    with pytest.raises(ValueError, match=".") as failure:
        sections_dam(tmp_path / "d.msh", file)
    assert str(failure.value).replace(str(file), "FILE").startswith(sentence)
    assert str(failure.value).endswith((".", "centre_x."))
    assert not (tmp_path / "d.msh").exists()


def test_files_that_are_no_table(tmp_path):
    with pytest.raises(ValueError, match=r"The table of sections '.*none\.csv' does not exist\."):
        read_sections(tmp_path / "none.csv")
    (tmp_path / "b.csv").write_bytes(b"\x89HDF\r\n\x1a\n")
    with pytest.raises(ValueError, match=r"b\.csv is not a text file: its byte 1 is not UTF-8\."):
        read_sections(tmp_path / "b.csv")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"joints": -1}, "joints is -1, but there must be 0 to 1000"),
        ({"joints": [10, 5]}, r"joints is \[10, 5\], but the angles must rise and lie between"),
        ({"joints": [40]}, r"lie between -60 and 40 degrees, the ends of the crest\."),
        ({"perimetral": True}, "perimetral is True, but a perimetral joint needs"),
        ({"spread": 3.0}, r"spread is 3, but foundation is not given"),
        (
            {"foundation": 60.0, "spread": 0.0},
            r"foundation is 60\.0, but .* be at most 55 m; otherwise its ends",
        ),
    ],
)
def test_bad_options(tmp_path, options, sentence):
    with pytest.raises(ValueError, match=sentence):
        sections_dam(tmp_path / "d.msh", write(tmp_path, CYLINDER), **options)
    assert not (tmp_path / "d.msh").exists()
    assert not gmsh.isInitialized()


def test_script(tmp_path, capsys):
    file, out = write(tmp_path, CYLINDER), tmp_path / "d.msh"
    flags = ["--size", "10", "--order", "1", "--out", str(out)]
    script.main([str(file), *flags, "--joint-angles", "-20", "0", "--foundation", "10"])
    assert "hex8 cells" in capsys.readouterr().out
    assert {"joint_1", "joint_2", "contact"} <= set(Groups(out).facets)
    with pytest.raises(SystemExit) as stop:
        script.main([str(tmp_path / "none.csv"), *flags])
    assert stop.value.code == 2
    assert capsys.readouterr().err.endswith("none.csv' does not exist.\n")
