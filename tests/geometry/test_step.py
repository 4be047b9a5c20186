# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""STEP files of several solids: groups, joints where they touch, and errors."""

import contextlib
import re
import sys
import warnings

from mpi4py import MPI

import gmsh
import numpy as np
import pytest
from mesh_groups import facet_area

import dolfinx_joints as dj
from dolfinx_joints.geometry import from_step as script
from dolfinx_joints.geometry.from_step import from_step
from dolfinx_joints.geometry.meshing import gmsh_model, step_file
from dolfinx_joints.mesh.dolfinx_versions import geometry_nodes

# A pier of 2 x 2 x 5 m on a rock of 4 x 2 x 3 m, and a second block of rock beside it, in mm:
# x, y, z and extents.
BOXES = {
    "rock": (0, 0, 0, 4000, 2000, 3000),
    "pier": (1000, 0, 3000, 2000, 2000, 5000),
    "side": (4000, 0, 0, 1000, 2000, 3000),
}


def write_step(path, boxes, dim=3):
    """Write boxes to a STEP file in millimetres, each called by its name."""
    with gmsh_model.gmsh_session():
        for box in boxes.values():
            if dim == 3:
                gmsh.model.occ.addBox(*box)
            else:
                gmsh.model.occ.addRectangle(*box[:5])
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    text = path.read_text()
    for number, name in enumerate(boxes, start=1):
        text = re.sub(rf"'Open CASCADE STEP translator [\d.]+ \d+\.{number}'", f"'{name}'", text)
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def step(tmp_path_factory):
    return write_step(tmp_path_factory.mktemp("step") / "pier.step", BOXES)


@pytest.mark.parametrize("order", [1, 2])
def test_solids_become_volumes_and_common_faces_joints(tmp_path, step, order):
    out = from_step(
        tmp_path / "p.msh",
        step,
        size=1.5,
        joint_size=0.7,
        order=order,
        surfaces={"base": ("z", "min"), "top": ("z", 8.0)},
    )
    report = gmsh_model.describe(out)
    assert report.element == f"tet{4 if order == 1 else 10}"
    # Millimetres in the file, metres here: the boxes' own volumes and faces.
    assert report.volume == pytest.approx({"rock": 24.0, "pier": 20.0, "side": 6.0}, rel=1e-9)
    assert set(report.num_facets) == {
        "joint_rock_pier",
        "joint_rock_side",
        "base",
        "top",
        "outside",
    }
    areas = {"joint_rock_pier": 4, "joint_rock_side": 6, "base": 10, "top": 4}
    # Of rock and side 2 x 20 round about, of the pier 4 x 10, and what it leaves of 10 on top.
    areas["outside"] = 2 * 5 * 3 + 2 * 2 * 3 + 4 * 10 + 6
    for name, exact in areas.items():
        assert facet_area(out, name) == pytest.approx(exact, rel=1e-9), name
    assert report.min_scaled_jacobian > 0.1


@pytest.mark.parametrize("duplicated", [False, True])
def test_what_is_read_from_it_is_split_at_the_joints(tmp_path, step, duplicated):
    out = from_step(tmp_path / "p.msh", step, size=2.0, order=2, duplicated=duplicated)
    jointed = dj.read_msh(out, MPI.COMM_SELF)
    assert jointed.pairs.gaps_in_geometry == duplicated
    assert ", 2 joints with " in str(gmsh_model.describe(out))  # each counted once
    assert set(jointed.joint_names) == {"joint_rock_pier", "joint_rock_side"}
    assert set(jointed.cell_groups) == {"rock", "pier", "side"}
    # The solids come apart: no node is in two of them.
    nodes = geometry_nodes(jointed.mesh)
    of = {n: set(nodes[jointed.cells(n)].ravel()) for n in BOXES}
    assert not of["rock"] & of["pier"]
    assert not of["rock"] & of["side"]
    x = jointed.mesh.geometry.x[sorted(of["pier"])]
    np.testing.assert_allclose([x.min(axis=0), x.max(axis=0)], [[1, 0, 3], [3, 2, 8]], atol=1e-6)


def test_names_by_position_pairs_and_tied_solids(tmp_path, step):
    out = tmp_path / "p.msh"
    flags = ["--size", "2", "--order", "1", "--out", str(out)]
    flags += ["--solid", "tower=2,1,5", "--joint", "lift=tower,rock", "--tied", "rock,side"]
    script.main([str(step), *flags, "--surface", "base:z=min"])
    report = gmsh_model.describe(out)
    assert set(report.volume) == {"rock", "tower", "side"}
    assert set(report.num_facets) == {"joint_lift", "base", "outside"}


def test_solids_of_one_name_are_one_volume(tmp_path, step):
    points = {"rock": (4.5, 1, 1)}
    report = gmsh_model.describe(
        from_step(tmp_path / "p.msh", step, size=2, order=1, solids=points)
    )
    assert report.volume == pytest.approx({"rock": 30.0, "pier": 20.0}, rel=1e-9)
    assert {name for name in report.num_facets if "joint" in name} == {"joint_rock_pier"}


def test_planes_cut_a_wedge_out_of_a_solid(tmp_path, step):
    # The planes rise from x = 1 m, z = 2 m to the top of the rock at z = 3 m; the pier is at x > 1.
    planes = {"left": (45.0, 90.0, 1.0, 0.0, 2.0), "right": (45.0, 270.0, 1.0, 0.0, 2.0)}
    options = {"size": 1.0, "order": 1, "planes": planes, "wedge": (1.0, 1.0, 2.5)}
    out = from_step(tmp_path / "p.msh", step, surfaces={"base": ("z", "min")}, **options)
    report = gmsh_model.describe(out)
    volumes = {"wedge": 2.0, "rock": 22.0, "pier": 20.0, "side": 6.0}
    assert report.volume == pytest.approx(volumes, rel=1e-6)
    areas = {"joint_left": 2 * 2**0.5, "joint_right": 2 * 2**0.5, "joint_pier_wedge": 2.0}
    areas |= {"joint_rock_pier": 2.0, "joint_rock_side": 6.0}
    assert {n for n in report.num_facets if "joint" in n} == set(areas)
    for name, exact in areas.items():
        assert facet_area(out, name) == pytest.approx(exact, rel=1e-6), name
    with pytest.raises(ValueError, match="planes and wedge must be given together"):
        from_step(tmp_path / "p.msh", step, size=1.0, planes=planes)
    with pytest.raises(
        ValueError, match="A solid is called 'wedge', a name reserved for the wedge"
    ):
        from_step(tmp_path / "p.msh", step, solids={"wedge": (4.5, 1, 1)}, **options)


@pytest.fixture(scope="module")
def arch(tmp_path_factory):
    """Write two lifts with an arc as upstream face, and a slab on their downstream face.

    The arc has a radius of 1.25 m about (0.75, 1) and a chord of 2 m at x = 0. Lifts are 1 and 2 m
    high; the downstream face is at x = 4 m. The slab covers it from z = 1.5 to 2 m.
    """
    path = tmp_path_factory.mktemp("arch") / "arch.step"
    with gmsh_model.gmsh_session():
        occ = gmsh.model.occ
        for low, height in ((0, 1000), (1000, 2000)):
            corners = [(0, 0), (4000, 0), (4000, 2000), (0, 2000)]
            a, b, c, d = (occ.addPoint(x, y, low) for x, y in corners)
            arc = occ.addCircleArc(d, occ.addPoint(750, 1000, low), a)
            loop = occ.addCurveLoop([occ.addLine(a, b), occ.addLine(b, c), occ.addLine(c, d), arc])
            occ.extrude([(2, occ.addPlaneSurface([loop]))], 0, 0, height)
        occ.addBox(4000, 0, 1500, 1000, 2000, 500)
        occ.synchronize()
        gmsh.write(str(path))
    text = path.read_text()
    entity = dict(re.findall(r"#(\d+) = ([^;]*);", text))

    def named(face):
        surface = entity[face[3]]
        if surface.startswith("CYLINDRICAL"):
            return f"{face[1]}'under water'{face[2]}{face[3]}"
        axis = entity[re.search(r"#(\d+)", surface)[1]]
        point, normal, _ = (entity[number] for number in re.findall(r"#(\d+)", axis))
        at_end = "(4.E+03," in point and re.search(r"\(-?1\.,", normal)
        return f"{face[1]}{chr(39)}{'air' if at_end else ''}{chr(39)}{face[2]}{face[3]}"

    path.write_text(re.sub(r"(ADVANCED_FACE\()''(,\([^)]*\),#)(\d+)", named, text))
    return path


ARC = 2.5 * np.arcsin(0.8)  # length of the arc [m]


@pytest.mark.parametrize(
    ("surfaces", "areas"),
    [
        ({"up": (-0.5, 1.0, 2.0)}, {"up": 2 * ARC}),  # a point on the upper lift
        ({"up": ("-x", 20.0)}, {"up": 3 * ARC}),
        # Of the downstream face 6 m^2 less the slab's 1; the slab's end is 1 m^2.
        ({"down": ("+x", 1.0)}, {"down": 6.0}),
        ({"down": (4.0, 1.0, 2.5), "low": (4.0, 1.0, 1.2)}, {"down": 2.0, "low": 1.0}),
        ({"up": "under water", "down": "air"}, {"up": 3 * ARC, "down": 5.0}),
        # A plane and a direction leave out faces that already have a name.
        ({"low": (4.0, 1.0, 0.5), "rest": ("x", 4.0)}, {"low": 2.0, "rest": 3.0}),
    ],
    ids=["point", "direction", "plane direction", "split face", "names", "plane"],
)
def test_outer_faces_by_point_direction_and_name(tmp_path, arch, surfaces, areas):
    out = from_step(tmp_path / "p.msh", arch, size=0.4, surfaces=surfaces)
    for name, exact in areas.items():
        # Parabolas miss the length of an arc by about a^4/2900, a = 0.32 is the angle of a cell.
        assert facet_area(out, name) == pytest.approx(exact, rel=1e-5), name
    report = gmsh_model.describe(out)
    assert {"outside", *areas} == {n for n in report.num_facets if not n.startswith("joint")}


def test_the_mean_normal_of_a_quarter_of_a_cylinder(tmp_path):
    # Its mean normal is at 45 degrees to both axes.
    path = tmp_path / "quarter.step"
    with gmsh_model.gmsh_session():
        gmsh.model.occ.addCylinder(0, 0, 0, 0, 0, 2000, 1000, angle=np.pi / 2)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    out = from_step(tmp_path / "p.msh", path, size=0.25, surfaces={"up": ("+y", 45.1)})
    assert facet_area(out, "up") == pytest.approx(np.pi, rel=1e-5)
    with pytest.raises(ValueError, match="no mean normal of an unnamed outer face"):
        from_step(tmp_path / "p.msh", path, size=0.5, surfaces={"up": ("+y", 44.9)})


@pytest.mark.parametrize(
    ("surfaces", "sentence"),
    [
        (
            {"up": (-0.8, 1.0, 2.0)},
            r"'up' is at \(-0\.8, .*, but the nearest outer face is at a distance of 0\.3 m\.",
        ),
        ({"up": (-0.5, 1.0, 1.0)}, "but 2 outer faces meet there; move it into one face"),
        (
            {"up": ("-x", 20.0), "low": (-0.5, 1.0, 0.5)},
            r"'low' is at \(-0\.5, 1\.0, 0\.5\), but this face is already 'up'\.",
        ),
        (
            {"up": "water"},
            "'up' is at 'water', but no outer face has this name; names in the file: air, under",
        ),
        (
            {"up": ("-x", "min")},
            "but it must be x, y or z at a number, 'min' or 'max'; a direction",
        ),
        ({"up": ("-x", 95.0)}, "a direction such as '-x' with an angle between 0 and 90 degrees"),
    ],
    ids=["distance", "edge", "twice", "name", "direction", "angle"],
)
def test_outer_faces_that_do_not_exist(tmp_path, arch, surfaces, sentence):
    with pytest.raises(ValueError, match=sentence) as failure:
        from_step(tmp_path / "p.msh", arch, size=1.0, surfaces=surfaces)
    one_sentence(failure)


def test_names_of_faces_that_were_not_built(tmp_path, arch, monkeypatch):
    monkeypatch.setattr(script, "face_names", lambda _: ["air"] * 3)
    sentence = r"arch\.step describes 3 faces of solids, of which 18 were built; name surfaces by"
    with pytest.raises(ValueError, match=sentence):
        from_step(tmp_path / "p.msh", arch, size=1.0, surfaces={"down": "air"})


def test_places_on_the_command_line(tmp_path, arch):
    out = tmp_path / "p.msh"
    flags = ["--size", "0.5", "--out", str(out), "--surface", "up:-x=20"]
    script.main([str(arch), *flags, "--surface", "top:1,1,3", "--surface", "down:air"])
    # Of a segment of a circle, half of the radius times the arc, less a triangle.
    areas = {"top": 8.0 + 0.5 * 1.25 * ARC - 0.75, "down": 5.0}
    for name, exact in areas.items():
        assert facet_area(out, name) == pytest.approx(exact, rel=1e-3), name


def test_solids_without_names_are_numbered(tmp_path):
    plain = tmp_path / "plain.step"
    with gmsh_model.gmsh_session():
        gmsh.model.occ.addBox(0, 0, 0, 1000, 1000, 1000)
        gmsh.model.occ.addBox(0, 0, 1000, 1000, 1000, 1000)
        gmsh.model.occ.synchronize()
        gmsh.write(str(plain))
    report = gmsh_model.describe(from_step(tmp_path / "p.msh", plain, size=1))
    assert report.volume == pytest.approx({"solid_1": 1.0, "solid_2": 1.0}, rel=1e-9)
    assert "joint_solid_1_solid_2" in report.num_facets


def test_nodes_of_order_two_lie_on_curved_faces(tmp_path):
    round_step = tmp_path / "round.step"
    with gmsh_model.gmsh_session():
        gmsh.model.occ.addCylinder(0, 0, 0, 0, 0, 2000, 1000)
        gmsh.model.occ.synchronize()
        gmsh.write(str(round_step))
    report = gmsh_model.describe(from_step(tmp_path / "p.msh", round_step, size=0.5))
    # Parabolas miss the circle by about a**4/80 of its area with arcs of a = 0.5.
    assert sum(report.volume.values()) == pytest.approx(2 * np.pi, rel=2e-3)


def one_sentence(failure):
    text = str(failure.value)
    assert "\n" not in text
    assert text.endswith(".")
    return text


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", " is empty."),
        (b"\x89HDF\r\n", " is not a STEP file: it does not begin with 'ISO-10303-21;'."),
        (b"ISO-10303-21;\nHEADER;\n", " is truncated: it does not end with 'END-ISO-10303-21;'."),
    ],
)
def test_malformed_files(tmp_path, content, sentence):
    path = tmp_path / "bad.step"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"bad\.step") as failure:
        from_step(tmp_path / "p.msh", path, size=1)
    assert one_sentence(failure).startswith(f"{path}{sentence}")
    assert not gmsh.isInitialized()


def test_where_open_cascade_crashes_this_process_does_not(tmp_path, step, monkeypatch):
    # A type that does not exist, at which version 7.8 crashes; others may tell of it.
    path = tmp_path / "bad.step"
    path.write_text(step.read_text().replace("= FACE_BOUND(", "= FACE_BOUNDS(", 1))
    with contextlib.suppress(ValueError, RuntimeError):
        from_step(tmp_path / "p.msh", path, size=5)
    for trial, error, sentence in (
        (
            "import os; os.kill(os.getpid(), 11)",
            ValueError,
            r"crashes on it \(signal 11\)",
        ),
        (
            "import os; os.kill(os.getpid(), 9)",
            ValueError,
            r"was ended by signal 9, perhaps for lack of memory",
        ),
        ("import nowhere", RuntimeError, r"could not be read in a .*: .*No module named 'nowhere'"),
    ):
        monkeypatch.setattr(step_file, "_TRIAL", trial)
        with pytest.raises(error, match=rf"bad\.step .*{sentence}\.$"):
            from_step(tmp_path / "p.msh", path, size=5)


def test_nothing_beside_a_file_is_run(tmp_path, step, monkeypatch):
    for name in ("gmsh.py", "re.py", "sitecustomize.py"):
        (tmp_path / name).write_text("open('run', 'w').close(); raise SystemExit")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", ["", *sys.path])
    assert from_step("p.msh", step, size=5).is_file()
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("kind", ["PLANE", "CLOSED_SHELL", "ADVANCED_FACE"])
def test_a_solid_that_cannot_be_built_is_missed(tmp_path, step, kind):
    path = tmp_path / "bad.step"
    path.write_text(step.read_text().replace(f"= {kind}(", f"= {kind}X(", 1))
    with pytest.raises(ValueError, match="describes 3 solids, of which 2 were built") as failure:
        from_step(tmp_path / "p.msh", path, size=5)
    one_sentence(failure)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (rb"(CARTESIAN_POINT\('',\()[^,]+", rb"\1nan", r"has a point at \(nan,.*\); coordinates"),
        (rb"(CARTESIAN_POINT\('',\()[^,]+", rb"\1abc", r"has a point at \(abc,.*\); coordinates"),
        (rb"(CARTESIAN_POINT\('',\()[^,]+", rb"\g<1>1.E300", "coordinates must be numbers below"),
        (rb"\.METRE\.", b".SECOND.", "has no unit of length based on the metre"),
    ],
)
def test_errors_that_open_cascade_does_not_report(tmp_path, step, old, new, sentence):
    damaged, count = re.subn(old, new, step.read_bytes())
    assert count
    path = tmp_path / "bad.step"
    path.write_bytes(damaged)
    with pytest.raises(ValueError, match=sentence) as failure:
        from_step(tmp_path / "p.msh", path, size=1)
    one_sentence(failure)
    assert not gmsh.isInitialized()


@pytest.mark.parametrize(("gap", "joined"), [(1e-3, True), (1e-2, False), (1.0, False)])
def test_solids_that_nearly_touch(tmp_path, gap, joined):
    """Two piers on a rock of 2 m, a gap apart [mm]; up to 2e-3 mm, 1e-6 of 2 m, are joined."""
    left, right = (0, 0, 1000, 1000 - gap, 2000, 1000), (1000, 0, 1000, 1000, 2000, 1000)
    boxes = {"rock": (0, 0, 0, 2000, 2000, 1000), "left": left, "right": right}
    path = write_step(tmp_path / "piers.step", boxes)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        out = from_step(tmp_path / "p.msh", path, size=1, order=1)
    assert ("joint_left_right" in dj.read_msh(out, MPI.COMM_SELF).joint_names) == joined
    expected = f"'left' and 'right' are {1e-3 * gap:.3g} m apart, without a joint"
    assert [expected in str(each.message) for each in caught] == ([] if joined else [True])


@pytest.mark.parametrize(
    ("boxes", "dim", "sentence"),
    [
        ({"a": BOXES["rock"]}, 2, r"has no solids, only 1 other shapes; solids are needed\."),
        (
            {"a": (0, 0, 0, 2000, 2000, 2000), "b": (0, 0, 1500, 2000, 2000, 2000)},
            3,
            r"the solids 'a' and 'b' overlap by 2 m\^3, but solids may only touch\.",
        ),
        (
            {"a": (0, 0, 0, 2000, 2000, 2000), "b": (0, 0, 2010, 2000, 2000, 2000)},
            3,
            "the solid 'a' shares no face with another solid; 'b' is 0.01 m away",
        ),
        (
            {"a": (0, 0, 0, 900, 900, 900)},
            3,
            r"size is 1 m, but the body in .* is 0.9 m long; check its unit of length "
            r"\(Gmsh .* option Geometry.OCCTargetUnit to 'M' before the export",
        ),
    ],
    ids=["faces only", "overlap", "gap", "size"],
)
def test_solids_that_do_not_fit(tmp_path, boxes, dim, sentence):
    path = write_step(tmp_path / "bad.step", boxes, dim)
    with pytest.raises(ValueError, match=sentence) as failure:
        from_step(tmp_path / "p.msh", path, size=1)
    one_sentence(failure)
    if "overlap" in sentence:
        with pytest.raises(ValueError, match="the solids 'pier' and 'b' overlap"):
            from_step(tmp_path / "p.msh", path, size=1, solids={"pier": (1, 1, 1)})
    assert not (tmp_path / "p.msh").exists()


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"tied": ("pier", "rock")}, "A tied pair is 'pier', but it must be a pair of names"),
        ({"solids": {"a b": (2, 1, 1)}}, "A solid is called 'a b', but names may have only"),
        (
            {"solids": {"a": (2, 1)}},
            r"The solid 'a' is at \(2, 1\), but the point must be \(x, y, z\)",
        ),
        ({"solids": {"a": (9, 9, 9)}}, r"0 solids contain the point \(9, 9, 9\) of 'a', but"),
        (
            {"joints": {"a": ("pier", "side")}},
            "'a' is between pier and side, which do not touch; touching pairs: rock and pier, rock "
            "and side",
        ),
        (
            {"joints": {"a": ("pier", "rock")}, "tied": [("rock", "pier")]},
            "A tied pair is between rock and pier, which are given twice",
        ),
        (
            {"joints": {"a": ("pier", "rock"), "b": ("rock", "pier")}},
            "'b' is between rock and pier, which are given twice",
        ),
        (
            {"surfaces": {"a": ("z", 4.0)}},
            r"'a' is at z=4\.0, but no unnamed outer face .* the body reaches from z = 0 to 8 m",
        ),
        (
            {"surfaces": {"a": ("w", 4.0)}},
            r"'a' is at \('w', 4\.0\), but it must be x, y or z at a",
        ),
    ],
)
def test_bad_options(tmp_path, step, options, sentence):
    with pytest.raises(ValueError, match=sentence) as failure:
        from_step(tmp_path / "p.msh", step, **({"size": 2} | options))
    one_sentence(failure)
    assert not (tmp_path / "p.msh").exists()


def test_errors_of_the_script(tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        script.main([str(tmp_path / "none.step"), "--size", "1"])
    assert stop.value.code == 2
    assert capsys.readouterr().err.endswith("none.step' does not exist.\n")
    with pytest.raises(SystemExit) as stop:
        script.main(["none.step", "--size", "1", "--surface", "base:z=low"])
    assert stop.value.code == 2
    assert "'base:z=low' is not NAME:AXIS=VALUE" in capsys.readouterr().err


def test_gmsh_exports_metres_with_the_option_of_the_message(tmp_path):
    """Boxes of 2 m: without the option, Gmsh would declare 2 mm."""
    path = tmp_path / "metres.step"
    with gmsh_model.gmsh_session():
        unit = gmsh.option.getString("Geometry.OCCTargetUnit")
        gmsh.option.setString("Geometry.OCCTargetUnit", "M")
        for z in (0, 2):
            gmsh.model.occ.addBox(0, 0, z, 2, 2, 2)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
        gmsh.option.setString("Geometry.OCCTargetUnit", unit)
    from_step(tmp_path / "metres.msh", path, size=2)
    with gmsh_model.gmsh_session():
        gmsh.open(str(tmp_path / "metres.msh"))
        nodes = gmsh.model.mesh.getNodes()[1].reshape(-1, 3)
    np.testing.assert_allclose(nodes.max(axis=0), [2.0, 2.0, 4.0], atol=1e-9)
