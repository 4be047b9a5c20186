# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The Gmsh models: volumes, joint areas, complete groups, nodes on the exact shape, bad input."""

import inspect
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import gmsh
import numpy as np
import pytest
from mesh_groups import ELEMENTS, Groups, area, check_groups, dam_volume

from dolfinx_joints import MeshError, read_msh
from dolfinx_joints.geometry.ambiesta import ArchDam, ambiesta, mid_crest
from dolfinx_joints.geometry.arch import Sector
from dolfinx_joints.geometry.gravity_dam import (
    FOOT,
    KOYNA,
    PINE_FLAT,
    GravitySection,
    battered_section,
    gravity_dam,
)
from dolfinx_joints.geometry.jointed_wall import jointed_wall
from dolfinx_joints.geometry.meshing import extrusion, gmsh_model
from dolfinx_joints.geometry.meshing.arguments import add_flags, argument_parser
from dolfinx_joints.geometry.two_blocks import two_blocks
from dolfinx_joints.geometry.voussoir_arch import voussoir_arch

PROJECT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(("cell", "order", "element"), ELEMENTS)
@pytest.mark.parametrize("angle", [0.0, -30.0])
def test_two_blocks(tmp_path, cell, order, element, angle):
    path = two_blocks(tmp_path / "b.msh", size=0.5, angle=angle, order=order, cell=cell)
    report = gmsh_model.describe(path)
    assert report.element == element
    # The joint turns about the blocks' common centre line, so both keep 1 x 1 x 1 m^3.
    assert report.volume == pytest.approx({"lower": 1.0, "upper": 1.0}, rel=1e-12)
    groups = Groups(path)
    assert set(groups.facets) == {"base", "top", "sides", "joint_1"}
    check_groups(groups)
    x, _, z = groups.at("joint_1").T
    np.testing.assert_allclose(z, 1 + (x - 0.5) * np.tan(np.radians(angle)), atol=1e-14)
    assert area(groups, "joint_1") == pytest.approx(1 / np.cos(np.radians(angle)))
    assert np.ptp(groups.at("base")[:, 2]) == 0
    assert set(groups.at("top")[:, 2]) == {2.0}


BAD = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 1 1 1\n3 1 0 1\n1\n0 abc 0\n$EndNodes\n"


def test_a_reading_that_failed_leaves_no_trace_in_later_meshes(tmp_path):
    """Gmsh stays locked after it, and then leaves the order of elements as it is."""
    bad = tmp_path / "bad.msh"
    bad.write_text(BAD)
    with pytest.raises(MeshError, match="Gmsh cannot read"):
        read_msh(bad, MPI.COMM_SELF)
    path = two_blocks(tmp_path / "b.msh", size=0.5, order=2)
    assert gmsh_model.describe(path).element == "hex27"


def test_a_locked_gmsh_of_the_caller_is_reported(tmp_path):
    bad = tmp_path / "bad.msh"
    bad.write_text(BAD)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        with pytest.raises(Exception, match="Could not read nodes"):
            gmsh.merge(str(bad))
        with pytest.raises(RuntimeError, match=r"no elements of order 2: .* call gmsh.clear\(\)"):
            two_blocks(tmp_path / "b.msh", size=0.5, order=2)
        gmsh.clear()
        path = two_blocks(tmp_path / "b.msh", size=0.5, order=2)
    finally:
        gmsh.clear()
        gmsh.finalize()
    assert gmsh_model.describe(path).element == "hex27"


@pytest.mark.parametrize(("cell", "order", "element"), ELEMENTS)
def test_jointed_wall(tmp_path, cell, order, element):
    path = jointed_wall(tmp_path / "w.msh", divisions=(8, 1, 4), order=order, cell=cell)
    report = gmsh_model.describe(path)
    assert report.element == element
    assert report.volume == pytest.approx({"concrete": 20 * 4 * 20})
    groups = Groups(path)
    check_groups(groups)
    # 9 x 2 x 5 nodes of order 1, or (2 n + 1) along each axis; the same for tetrahedra.
    assert report.num_nodes == (9 * 2 * 5 if order == 1 else 17 * 3 * 9)
    planes = {"x_min": (0, 0), "x_max": (0, 20), "y_min": (1, 0), "y_max": (1, 4)}
    planes |= {"base": (2, 0), "crest": (2, 20)}
    planes |= {"joint_1": (0, 5), "joint_2": (0, 10), "joint_3": (0, 15)}
    assert set(groups.facets) == set(planes)
    for name, (axis, value) in planes.items():
        assert set(groups.at(name)[:, axis]) == {float(value)}
    assert [area(groups, f"joint_{k}") for k in (1, 2, 3)] == pytest.approx([80, 80, 80])


@pytest.mark.parametrize(("cell", "order", "element"), ELEMENTS)
def test_voussoir_arch(tmp_path, cell, order, element):
    shape = {"radius": 5.0, "thickness": 1.0, "voussoirs": 5, "width": 2.0}
    path = voussoir_arch(
        tmp_path / "a.msh", **shape, divisions=(2, 2, 1), half_angle=75.0, order=order, cell=cell
    )
    report = gmsh_model.describe(path)
    assert report.element == element
    # Half of (5.5^2 - 4.5^2) times the angle and the width, 13.09 m^2 x 2 m; ten cells of 15
    # degrees take sin(15) for it if they have chords, and miss arcs by less than 1e-4.
    angle = np.radians(15) if order == 2 else np.sin(np.radians(15))
    volume = {"arch": 10 * angle * 5 * 2, "abutments": 2 * angle * 5 * 2}
    assert report.volume == pytest.approx(volume, rel=1e-4 if order == 2 else 1e-12)
    groups = Groups(path)
    check_groups(groups)
    names = {f"joint_{k}" for k in range(1, 7)}
    assert set(groups.facets) == names | {"base", "intrados", "extrados", "front", "back"}
    for k in range(1, 7):
        x, _, z = groups.at(f"joint_{k}").T
        np.testing.assert_allclose(np.degrees(np.arctan2(x, z)), -75 + 30 * (k - 1), atol=1e-12)
        assert area(groups, f"joint_{k}") == pytest.approx(2.0)
    for name, r in (("intrados", 4.5), ("extrados", 5.5)):
        np.testing.assert_allclose(np.hypot(*groups.at(name)[:, [0, 2]].T), r, rtol=1e-14)
    assert set(groups.at("front")[:, 1]) == {0.0}
    assert set(groups.at("back")[:, 1]) == {2.0}


@pytest.mark.parametrize(
    ("cell", "order", "vertices"), [("hex", 1, 4), ("hex", 2, 4), ("tet", 1, 3)]
)
def test_plane_voussoir_arch(tmp_path, cell, order, vertices):
    path = voussoir_arch(
        tmp_path / "a.msh", radius=5.0, thickness=1.0, voussoirs=7, size=0.5, order=order, cell=cell
    )
    groups = Groups(path)
    check_groups(groups)
    found = {name: at.shape for name, at in (groups.cells | groups.facets).items()}
    # A voussoir is pi 5/7 = 2.24 m long: 4 cells of 0.5 m, and 2 through the thickness of 1 m.
    share = 1 if cell == "hex" else 2
    assert found["arch"] == (7 * 4 * 2 * share, vertices)
    assert found["abutments"] == (2 * 2 * share, vertices)
    assert {found[f"joint_{k}"] for k in range(1, 9)} == {(2, 2)}
    assert found["base"] == (2 * 2, 2)
    assert found["intrados"] == found["extrados"] == (7 * 4 + 2, 2)
    radius = np.linalg.norm(groups.points, axis=1)
    levels = [4.5, 4.75, 5.0, 5.25, 5.5] if order == 2 else [4.5, 5.0, 5.5]
    assert np.unique(radius.round(12)) == pytest.approx(levels)


def test_jointed_wall_of_the_benchmark(tmp_path):
    report = gmsh_model.describe(jointed_wall(tmp_path / "w.msh"))
    assert (report.num_cells, report.num_nodes) == (20 * 4 * 20, 21 * 5 * 21)
    assert report.min_scaled_jacobian == pytest.approx(1.0)
    # Joint facets: 4 across the thickness, 20 up; node pairs above the base 3 x 5 x 20 = 300.
    assert {report.num_facets[f"joint_{k}"] for k in (1, 2, 3)} == {80}


def test_jointed_wall_by_size(tmp_path):
    report = gmsh_model.describe(jointed_wall(tmp_path / "w.msh", size=2.6, joints=1))
    assert report.num_cells == 2 * 4 * 2 * 8  # round(10/2.6), round(4/2.6), round(20/2.6)


@pytest.fixture(scope="module")
def dam(tmp_path_factory):
    """The default dam, as the demos use it."""
    return ambiesta(tmp_path_factory.mktemp("dam") / "dam.msh")


def test_dam_size_and_quality(dam):
    report = gmsh_model.describe(dam)
    assert report.element == "hex27"
    assert 6000 <= 3 * report.num_nodes <= 8000
    joints = sum(n for name, n in report.num_facets.items() if name.startswith("joint"))
    assert 9 * joints > 300  # quadrature points of a 3 x 3 rule
    assert report.min_scaled_jacobian > 0.4
    # The exact volume is 27.12e3 m^3; order 2 is far better than the 0.5 % asked of it.
    assert report.volume["concrete"] == pytest.approx(dam_volume(ArchDam()), rel=5e-4)
    assert dam_volume(ArchDam()) == pytest.approx(27.1e3, rel=2e-3)


def test_dam_nodes_on_the_exact_surfaces(dam):
    groups, shape = Groups(dam), ArchDam()

    def arch(points):
        zeta = points[:, 2] / 57
        phi, r = np.radians(21.5 + 28.5 * zeta), 12 + 51.47 * zeta**0.6
        r /= np.sin(phi)
        return zeta, phi, r, r - 0.36 * 57 * zeta * (1 - 0.62 * zeta)

    zeta, _, r, centre = arch(groups.at("upstream"))
    x, y, _ = groups.at("upstream").T
    np.testing.assert_allclose(np.hypot(centre - x, y), r, rtol=1e-12)

    zeta, phi, r, centre = arch(groups.at("downstream"))
    x, y, _ = groups.at("downstream").T
    s = np.arctan2(y, centre - x) / phi
    t = (9 - 7 * zeta) * (1 + 0.3 * (1 - 0.6 * zeta) * s**2)
    np.testing.assert_allclose(np.hypot(centre - x, y), r - t, rtol=1e-12)

    for name in ("base", "abutments"):
        zeta, phi, r, centre = arch(groups.at(name))
        x, y, _ = groups.at(name).T
        s = np.arctan2(y, centre - x) / phi
        on_abutment = np.isclose(np.abs(s), 1, rtol=0, atol=1e-10)
        assert (on_abutment | (zeta == 0)).all()
        assert (np.abs(s) < 1 + 1e-10).all()
        assert zeta.max() == 1.0 if name == "abutments" else zeta.max() < 0.003
    assert set(groups.at("crest")[:, 2]) == {57.0}
    np.testing.assert_allclose(shape.point(0.0, 0.0, 1.0), mid_crest())


def test_mid_crest():
    assert mid_crest() == pytest.approx((-0.36 * 57 * 0.38, 0.0, 57.0))
    assert mid_crest(ArchDam(height=100.0, overhang=0.0)) == (0.0, 0.0, 100.0)


@pytest.mark.parametrize(("cell", "order", "element"), ELEMENTS)
@pytest.mark.parametrize(("joints", "layers"), [(0, 2), (3, 1), (6, 1)])
def test_coarse_dams(tmp_path, cell, order, element, joints, layers):
    path = ambiesta(
        tmp_path / "d.msh", size=12, order=order, cell=cell, joints=joints, layers=layers
    )
    report = gmsh_model.describe(path)
    assert report.element == element
    assert report.min_scaled_jacobian > 0.02
    assert report.volume["concrete"] == pytest.approx(dam_volume(ArchDam()), rel=0.02)
    groups = Groups(path)
    check_groups(groups)
    assert sum(name.startswith("joint") for name in groups.facets) == joints


@pytest.mark.parametrize("active_height", [0.3, 0.62, 1.0])
@pytest.mark.parametrize("crest_arch", [True, False])
def test_active_height(tmp_path, active_height, crest_arch):
    path = ambiesta(tmp_path / "d.msh", size=6, active_height=active_height, crest_arch=crest_arch)
    groups = Groups(path)
    check_groups(groups)
    top = 1.0 if crest_arch else active_height
    assert groups.points[:, 2].max() == pytest.approx(57 * top, rel=1e-14)
    volume = gmsh_model.describe(path).volume["concrete"]
    # Chords of the curved foundation add about 0.1 % to the lowest dam, three cells high.
    assert volume == pytest.approx(dam_volume(ArchDam(), top), rel=2e-3)
    names = [name for name in groups.facets if name.startswith("joint")]
    assert "joint_6" in names
    assert len(names) == 11 or (crest_arch and active_height < 1)
    shape = Sector(ArchDam(), top)
    for name in names:
        x, y, z = groups.at(name).T
        assert z.max() == pytest.approx(57 * active_height, rel=1e-14)
        theta = shape.half_angle * (int(name.split("_")[1]) / 6 - 1)
        offset = y * np.cos(theta) - (shape.axis - x) * np.sin(theta)
        np.testing.assert_allclose(offset, 0, atol=1e-10)


@pytest.mark.parametrize(
    "shape",
    [
        ArchDam(height=100.0, crest_half_chord=131.7, base_half_chord=25.0, base_thickness=22.0),
        ArchDam(height=30.0, crest_half_chord=40.0, chord_exponent=1.0),
    ],
)
def test_other_dams(tmp_path, shape):
    path = ambiesta(tmp_path / "d.msh", size=shape.height / 8, parameters=shape, joints=9)
    report = gmsh_model.describe(path)
    check_groups(Groups(path))
    assert report.min_scaled_jacobian > 0.1
    assert report.volume["concrete"] == pytest.approx(dam_volume(shape), rel=2e-3)


# Koyna: two trapezia.  Pine Flat [ft]: the crest down to the base, and a triangle at either face,
# 16.75 = 0.05 x 335 wide upstream and what is left of the base downstream.
KOYNA_AREA = 66.5 * (70 + 19.25) / 2 + 36.5 * (19.25 + 14.8) / 2
PINE_FLAT_AREA = (32 * 400 + 16.75 * 335 / 2 + 265.57 * (265.57 / 0.78) / 2) * FOOT**2


@pytest.mark.parametrize(("cell", "order", "element"), ELEMENTS)
@pytest.mark.parametrize(
    ("section", "expected"), [(KOYNA, KOYNA_AREA), (PINE_FLAT, PINE_FLAT_AREA)]
)
def test_gravity_dam(tmp_path, cell, order, element, section, expected):
    assert section.area == pytest.approx(expected, rel=1e-14)
    joints = {"base": 0.0, "lift": 41.3, "neck": 66.5}
    path = gravity_dam(
        tmp_path / "g.msh",
        section=section,
        joints=joints,
        width=15.0,
        size=9.0,
        order=order,
        cell=cell,
    )
    report = gmsh_model.describe(path)
    assert report.element == element
    base = section.thickness(0.0)
    volume = {"concrete": 15 * expected, "foundation": 15 * 9 * base}
    assert report.volume == pytest.approx(volume, rel=1e-12)
    groups = Groups(path)
    check_groups(groups)
    sides = {"upstream", "downstream", "crest", "base", "foundation_ends", "front", "back"}
    assert set(groups.facets) == sides | {"joint_base", "joint_lift", "joint_neck"}
    for name, height in joints.items():
        assert set(groups.at(f"joint_{name}")[:, 2]) == {height}
        cut = 15 * section.thickness(height)
        assert area(groups, f"joint_{name}") == pytest.approx(cut, rel=1e-12)
    assert set(groups.at("base")[:, 2]) == {-9.0}
    assert set(groups.at("crest")[:, 2]) == {section.height}
    for face in ("upstream", "downstream"):
        x, _, z = groups.at(face).T
        np.testing.assert_allclose(x, section.face(face, z), atol=1e-12)
        assert (z.min(), z.max()) == (0.0, section.height)
    assert set(groups.at("front")[:, 1]) == {0.0}
    assert set(groups.at("back")[:, 1]) == {15.0}


@pytest.mark.parametrize(
    ("cell", "order", "corners"), [("hex", 1, 4), ("hex", 2, 4), ("tet", 2, 3)]
)
def test_plane_gravity_dam(tmp_path, cell, order, corners):
    path = gravity_dam(tmp_path / "g.msh", joints={"neck": 66.5}, size=7, order=order, cell=cell)
    groups = Groups(path)
    check_groups(groups)
    assert groups.cells["concrete"].shape[1] == corners
    x, y, _ = groups.at("joint_neck").T
    assert len(x) == order * len(groups.facets["joint_neck"]) + 1
    assert set(y) == {66.5}
    assert (x.min(), x.max()) == (0.0, 19.25)
    # Without a joint at height 0 there is no foundation, and the dam stands on the base itself.
    assert set(groups.facets) == {"upstream", "downstream", "crest", "base", "joint_neck"}
    assert area(groups, "concrete") == pytest.approx(KOYNA_AREA, rel=1e-12)


@pytest.mark.parametrize(
    ("upstream", "downstream", "sentence"),
    [
        (((0, 0),), ((0, 9), (9, 5)), "upstream is .* two or more corners .z, x. with z rising"),
        (((1, 0), (9, 0)), ((0, 9), (9, 5)), "upstream is .* with z rising from 0"),
        (((0, 0), (9, 0)), ((0, 9), (5, 7), (5, 5)), "downstream is .* with z rising from 0"),
        (((0, 0), (9, 0)), ((0, 9), (8, 5)), "ends at z = 9 m and the downstream face at 8 m"),
        (((0, 0), (9, 0)), ((0, 9), (9, 0)), "The least thickness of the section is 0 m"),
    ],
)
def test_bad_gravity_section(upstream, downstream, sentence):
    with pytest.raises(ValueError, match=sentence):
        GravitySection(upstream=upstream, downstream=downstream)


def test_bad_battered_section():
    faces = {"height": 10.0, "crest": 1.0, "upstream_slope": 0.1, "downstream_slope": 0.8}
    with pytest.raises(ValueError, match="upstream_break is at 12 m, but it must be between 0 and"):
        battered_section(base=8.0, upstream_break=12.0, **faces)
    with pytest.raises(ValueError, match="The downstream break is at 10.625 m"):
        battered_section(base=10.0, upstream_break=5.0, **faces)


@pytest.mark.parametrize(
    ("model", "options", "sentence"),
    [
        (two_blocks, {"angle": 70}, "angle is 70, but it must be between -63.43 and 63.43 degrees"),
        (jointed_wall, {"divisions": (6, 1, 1)}, "the first a multiple of 4"),
        (voussoir_arch, {"thickness": 20}, "thickness is 20, but it must be below twice the"),
        (voussoir_arch, {"voussoirs": 1}, "A cell spans 90 degrees, but it must be at most 45"),
        (gravity_dam, {"joints": {"a": 103.0}}, "Joint 'a' is at height 103.0, but it must be at"),
        (gravity_dam, {"joints": {"a+": 5}}, "called 'a.', but names may have only letters"),
        (gravity_dam, {"joints": {"a": 5, "b": 5.0}}, "but their heights must differ"),
    ],
)
def test_bad_input(tmp_path, model, options, sentence):
    with pytest.raises(ValueError, match=sentence):
        model(tmp_path / "m.msh", **options)
    assert not (tmp_path / "m.msh").exists()
    assert not gmsh.isInitialized()


def test_bad_shape():
    with pytest.raises(ValueError, match="crest_half_chord is 5.0, but it must be above"):
        ArchDam(crest_half_chord=5.0)


def test_bad_file(tmp_path):
    with pytest.raises(ValueError, match=r"its name must end in '\.msh'"):
        two_blocks(tmp_path / "blocks.vtk")
    with pytest.raises(ValueError, match="the folder .* is missing"):
        two_blocks(tmp_path / "nowhere" / "blocks.msh")


def test_cells_turned_inside_out(tmp_path):
    points, cells = extrusion.grid(np.arange(3.0), np.arange(2.0), "hex")
    plane = extrusion.PlaneMesh(points, {"body": cells}, {})
    solid = extrusion.extrude(plane, np.array([0.0, 1.0]), ("below", "above"))
    with pytest.raises(RuntimeError, match="smallest scaled Jacobian of the mesh is -1"):
        gmsh_model.write_mesh(tmp_path / "m.msh", solid, 2, place=lambda x, _: x * [1, 1, -1])
    assert not gmsh.isInitialized()
    assert not (tmp_path / "m.msh").exists()


def test_cells_without_volume(tmp_path):
    """Their scaled Jacobian is 0/0, in the second group read, beside good cells."""
    points, cells = extrusion.grid(np.arange(3.0), np.arange(2.0), "hex")
    plane = extrusion.PlaneMesh(points, {"good": cells[:1], "flat": cells[1:]}, {})
    solid = extrusion.extrude(plane, np.array([0.0, 1.0]), ("below", "above"))
    with pytest.raises(RuntimeError, match="smallest scaled Jacobian of the mesh is nan"):
        gmsh_model.write_mesh(
            tmp_path / "m.msh", solid, 1, place=lambda x, _: np.minimum(x, [1, 9, 9])
        )
    assert list(tmp_path.iterdir()) == []


def test_a_session_of_the_caller_is_left_alone(tmp_path):
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.ElementOrder", 2)
        gmsh.model.add("mine")
        gmsh.model.add("another")
        gmsh.model.setCurrent("mine")
        two_blocks(tmp_path / "b.msh", size=1.0)
        assert gmsh.model.getCurrent() == "mine"
        assert "dolfinx_joints_geometry" not in gmsh.model.list()
        assert gmsh.option.getNumber("Mesh.ElementOrder") == 2
        assert gmsh.option.getNumber("Mesh.Binary") == 0
    finally:
        gmsh.finalize()


def test_script_runs_directly(tmp_path):
    flags = ["--size", "12", "--order", "1", "--height", "50", "--out", str(tmp_path / "d.msh")]
    done = subprocess.run(
        [sys.executable, PROJECT / "geometry" / "ambiesta.py", *flags],
        capture_output=True,
        text=True,
        env={},
        check=True,
    )
    assert "hex8 cells" in done.stdout
    assert Groups(tmp_path / "d.msh").points[:, 2].max() == 50


def test_errors_of_the_script(tmp_path, capsys):
    from dolfinx_joints.geometry import jointed_wall as script

    with pytest.raises(SystemExit) as stop:
        script.main(["--cell", "prism", "--out", str(tmp_path / "w.msh")])
    assert stop.value.code == 2
    assert capsys.readouterr().err.endswith("cell is 'prism'; it must be one of hex, tet.\n")


def test_flags_are_the_parameters_of_the_model(capsys):
    parser = argument_parser(voussoir_arch, "An arch.", "arch.msh")
    given = vars(parser.parse_args(["--half-angle", "60", "--divisions", "3", "2", "1", "--gui"]))
    parameters = inspect.signature(voussoir_arch).parameters.values()
    expected = {p.name: p.default for p in parameters} | {"out": Path("arch.msh")}
    assert given == expected | {"half_angle": 60.0, "divisions": [3, 2, 1], "gui": True}
    for wrong in (["--half-angle", "wide"], ["--divisions", "3"], ["--voussoirs", "1.5"], ["--no"]):
        with pytest.raises(SystemExit) as stop:
            parser.parse_args(wrong)
        assert stop.value.code == 2
    add_flags(parser, ArchDam)
    assert parser.parse_args([]).overhang == ArchDam().overhang
    with pytest.raises(SystemExit):
        parser.parse_args(["--help"])
    assert "overhang of the crown relative to the height (default: 0.36)" in " ".join(
        capsys.readouterr().out.split()
    )
