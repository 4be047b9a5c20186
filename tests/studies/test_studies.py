# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The case of the paper and the studies on it: numbers in, meshes, runs and tables out.

Expected: the numbers put in, geometry by hand, exact sequences.
"""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from mpi4py import MPI

import dolfinx_joints as dj
from dolfinx_joints.study import read_table
from studies import convergence, follow_ups, paper
from studies.ambiesta import Case, build, make_mesh, make_motion, parameters, run, study_row

COARSE = {"size": 14.0, "order": 1, "steps": 4}


def shared_folder(tmp_path_factory):
    """The same folder on all ranks."""
    return MPI.COMM_WORLD.bcast(tmp_path_factory.mktemp("case"))


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"height": 0.0}, "height is 0.0 m; it must be positive."),
        ({"crest_length": -1.0}, "crest_length is -1.0 m; it must be positive."),
        ({"scheme": "euler"}, "scheme is 'euler'; it must be 'ec' or 'newmark'."),
        ({"order": 3}, "order is 3; it must be 1 or 2."),
        ({"joints": 0}, "joints is 0; it must be at least 1."),
        ({"active_height": 1.2}, r"active_height is 1.2; it must be in \(0, 1\]."),
        ({"gap": -1e-3}, "gap is -0.001 m; it must be zero or more."),
        ({"friction_angle_deg": 90.0}, "friction_angle_deg is 90.0 degrees; it must be"),
        ({"normal_stiffness": 0.0}, "normal_stiffness is 0.0 Pa/m; it must be positive"),
        ({"record_name": "TMZ"}, "record_name is 'TMZ'; it must be given with a record_folder."),
        ({"crest_length": 20.0}, "crest_half_chord is .* but it must be above base_half_chord"),
    ],
)
def test_refusals(numbers, message):
    with pytest.raises(ValueError, match=message):
        Case(**numbers)


def test_dam_of_other_numbers():
    dam = Case(height=100.0, crest_length=300.0, base_width=40.0, crest_thickness=4.0).dam()
    assert dam.crest_length == pytest.approx(300.0, rel=1e-14)
    assert (dam.height, dam.base_half_chord, dam.crest_thickness) == (100.0, 20.0, 4.0)
    # Chord of the crest over 2 R is the sine of the half-angle, 50 degrees.
    left, right = dam.point(1.0, 0.0, 1.0), dam.point(-1.0, 0.0, 1.0)
    chord = np.linalg.norm(left - right)
    assert chord / 2 / dam.radius(1.0) == pytest.approx(np.sin(np.radians(50.0)), rel=1e-14)


def test_points():
    places = Case().points()
    assert [places[name][2] for name in places] == pytest.approx([57.0, 57.0, 57.0, 0.75 * 57.0])
    assert places["left-quarter"][1] > 0.0 > places["right-quarter"][1]  # y grows to the left
    cut = Case(crest_arch=False).points()
    assert cut["mid-crest"] == cut["crown-75"] == pytest.approx(places["crown-75"])


def test_motion():
    case = Case(scale=0.5, time_step=0.01)
    full = dj.synthetic_motion()
    motion = make_motion(case)
    assert motion.dt == 0.01
    assert motion.duration == pytest.approx(full.duration, abs=0.01)
    np.testing.assert_allclose(motion.peak, 0.5 * full.peak, rtol=0.1)


@pytest.mark.mpi
def test_model_has_the_numbers_of_the_case(tmp_path_factory):
    case = Case(**COARSE, gap=2e-3, shear_ratio=0.7, crest_arch=False)
    mesh = make_mesh(case, shared_folder(tmp_path_factory) / "new")
    model = build(case, "joints", mesh)
    assert case.law().shear_stiffness == 0.7 * 1e11
    assert (model.contact.initial_gap[:, 0] == 2e-3).all()
    top = model.jointed.mesh.geometry.x[:, 2].max(initial=0.0)
    assert MPI.COMM_WORLD.allreduce(top, MPI.MAX) == pytest.approx(0.75 * 57.0)
    assert build(case, "linear", mesh).contact is None
    with pytest.raises(ValueError, match="which is 'both'; it must be linear or joints."):
        build(case, "both", mesh)


@pytest.mark.mpi
def test_run_says_what_it_was(tmp_path_factory):
    case = Case(**COARSE, scheme="newmark", scale=0.5)
    path = run(case, "joints", shared_folder(tmp_path_factory))
    if MPI.COMM_WORLD.rank:
        return
    with dj.Results(path) as results:
        facts, summary = results.metadata, results.summary
        assert results.complete
        assert results.rows("histories") == 5
        assert results.time("histories")[-1] == pytest.approx(4 * 0.00488)
    assert facts.items() >= {"case": "ambiesta", "run": "joints", "scheme": "newmark"}.items()
    assert facts.items() >= {"size": 14.0, "order": 1, "scale": 0.5, "rotate": 0.0}.items()
    assert facts["record"] == "synthetic motion 1"
    assert facts["dofs"] > 0
    assert facts["cells"] > 0
    assert facts["joint_points"] > 0
    assert summary["peak_mb"] > 50.0


def test_row_of_a_study(tmp_path):
    row = study_row(tmp_path, **parameters(Case(**COARSE), "linear", keep=False))
    assert not (tmp_path / "linear.h5").exists()
    assert row["joints/opening_max"] == 0.0
    assert row["mid-crest/x/peak_strong"] > 0.0
    assert "steps" not in row  # a parameter


@pytest.mark.parametrize("order", [1.0, 2.0, 3.5])
def test_extrapolation_of_an_exact_sequence(order):
    # 5 + 0.3 h^order at halved h.
    values = 5.0 + 0.3 * 0.5 ** (order * np.arange(4))
    found = convergence.extrapolated(values, 2.0)
    assert found.order == pytest.approx(order, rel=1e-9)
    assert found.limit == pytest.approx(5.0, rel=1e-12)
    np.testing.assert_allclose(found.error, values - 5.0, rtol=1e-9)


def test_scatter_where_nothing_converges():
    found = convergence.extrapolated(np.array([4.0, 1.0, 1.2, 1.1]), 2.0)
    assert np.isnan(found.order)
    assert found.limit == 1.1
    np.testing.assert_allclose(found.error, [2.9, 0.2, 0.2, 0.2])
    with pytest.raises(ValueError, match="Extrapolation needs three values or more, got 2."):
        convergence.extrapolated(np.array([1.0, 2.0]), 2.0)


def test_grid_of_convergence():
    cases = convergence.grid(Case())
    assert len(cases) == 2 * (5 + 4 - 1)  # the base belongs to both
    assert all(
        case.steps * case.time_step == pytest.approx(2288 * 0.00488) for case, _ in cases.values()
    )


def test_grid_of_follow_ups():
    base = Case(record_folder="anywhere")
    entries = follow_ups.grid(base)
    assert len(entries) >= 40
    assert len({(e.case, e.run_as) for e in entries.values()}) == len(entries)
    assert entries["gap=0.005"].case == replace(base, gap=0.005)
    assert entries["crest_joints_scale=2"].case == replace(base, active_height=1.0, scale=2.0)
    assert entries["no_crest_arch_linear"].case == replace(base, crest_arch=False)
    assert entries["record=synthetic"].case.record_folder is None


def test_strongest_direction():
    # All motion at 30 degrees from x towards y.
    wave = np.sin(np.arange(50.0))
    acceleration = np.outer(wave, [np.cos(np.pi / 6), np.sin(np.pi / 6), 0.0])
    assert follow_ups.strongest_direction(dj.Motion(acceleration=acceleration, dt=0.01)) == 30.0


def test_follow_ups_are_listed(capsys):
    follow_ups.main(["--list", "--only", "gap"])
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["gap=0.0005", "joints,", "gap", "0.0005"]
    assert lines[-1] == "6 cases"
    with pytest.raises(ValueError, match="No case starts with nonsense; --list prints all names"):
        follow_ups.main(["--list", "--only", "nonsense"])


@pytest.mark.slow
def test_follow_ups_run(tmp_path, capsys):
    short = ["--steps", "40", "--size", "14", "--out", str(tmp_path), "--only", "paper", "gap=0.00"]
    follow_ups.main(short)
    assert "8 cases run, 0 already complete, 0 failed" in capsys.readouterr().out
    table = read_table(tmp_path)
    assert table["case"].tolist()[:2] == ["paper_linear", "paper"]
    # The gaps only open farther.
    assert (np.diff(table["joints/opening_max"][1:]) > 0.0).all()
    assert (tmp_path / "sweep_gap.png").stat().st_size > 10_000
    follow_ups.main(short)
    assert "0 cases run, 8 already complete, 0 failed" in capsys.readouterr().out


@pytest.mark.slow
def test_paper_in_one_command(tmp_path, capsys, monkeypatch):
    pytest.importorskip("pyvista")
    pytest.importorskip("plotly")
    monkeypatch.setattr(paper, "QUICK", {"size": 14.0, "steps": 60})
    paper.main(["--quick", "--out", str(tmp_path)])
    numbers = {path.name[7:9] for path in tmp_path.glob("figure_*.png")}
    assert numbers == {f"{n:02d}" for n in range(3, 20)}
    assert (tmp_path / "report.html").stat().st_size > 100_000
    errors = read_table(tmp_path / "runs")
    assert (errors["energy_error"][errors["scheme"] == "ec"] < 1e-8).all()
    capsys.readouterr()
    paper.main(["--quick", "--out", str(tmp_path)])
    assert (
        f"kept from earlier runs in {tmp_path / 'runs'}: paper_joints, paper_linear"
        in capsys.readouterr().out
    )


@pytest.mark.slow
def test_a_dam_of_other_dimensions_by_numbers_alone(tmp_path):
    case = Case(
        height=100.0,
        crest_length=300.0,
        base_width=50.0,
        base_thickness=16.0,
        crest_thickness=4.0,
        joints=20,
        size=12.0,
        steps=410,
    )
    assert case.steps * case.time_step > 2.0
    with dj.Results(run(case, "joints", tmp_path)) as results:
        assert results.complete
        assert results.summary["energy_error"] < 1e-8
        names = {f"joint_{k}" for k in range(1, 21)}
        assert set(results.joints) <= names
        assert len(results.joints) >= 12  # the outer ones leave through the abutments
        nodes = results.static("mesh/nodes")
        assert nodes[:, 2].max() == pytest.approx(100.0)
        assert np.ptp(nodes[:, 1]) == pytest.approx(
            300.0 / np.radians(100.0) * 2 * np.sin(np.radians(50.0)), rel=1e-3
        )
