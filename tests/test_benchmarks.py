# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small runs of the benchmarks: each once in its smallest form, its numbers read back.

Expected: facts of the meshes counted by hand, and bounds that the programs assert themselves.
"""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from mpi4py import MPI

from benchmarks import (
    brief,
    bulk_materials,
    error_against_time,
    error_bars,
    exact_modes,
    gradient_cost,
    jointed_wall,
    large_bodies,
    opensees_wall,
    reservoir_waves,
    scaling,
    stability,
    work_precision,
)
from benchmarks.shared.scenes import wall

PROMISED = {"dofs", "joint_points", "steps", "linear_ms", "joints_ms", "ratio", "newton_mean"}
PROMISED |= {"ledger", "joints_peak_mb", "linear_cpu_ms", "joints_cpu_ms", "newton_max"}


def printed(capsys):
    """The JSON object of the last line, on rank 0; None elsewhere."""
    lines = capsys.readouterr().out.splitlines()
    return json.loads(lines[-1]) if MPI.COMM_WORLD.rank == 0 else None


@pytest.mark.mpi
def test_jointed_wall(capsys):
    walls = ["--mesh", "tiny", "--pressure", "0.3", "--supernodal"]
    jointed_wall.main([*walls, "--steps", "4", "--json"])
    rows = printed(capsys)
    if rows is None:
        return
    assert list(rows) == ["tiny", "tiny 0.3 MPa"]
    for row in rows.values():
        assert row.keys() >= PROMISED
        # 8 x 2 x 8 cells; each of 3 joints doubles its 3 x 9 nodes.
        assert row["dofs_tied"] == 3 * 9 * 3 * 9
        assert row["dofs"] == row["dofs_tied"] + 3 * row["joint_points"]
        assert row["joint_points"] == 3 * 3 * 9
        assert row["open"] + row["stick"] + row["slip"] == pytest.approx(1.0)
        assert row["accepted"] == row["steps"] == 4
        assert row["ledger"] < 1e-9
        assert row["linear_ms"] > 0.0
        assert 0.0 < row["joints_iteration_ms"] < row["joints_ms"]


@pytest.mark.mpi
@pytest.mark.filterwarnings("ignore:The estimated error of a single step")
def test_bulk_materials():
    """A linear material is the same on all paths; at 1e-13 the solver leaves less than 1e-10."""
    rows = bulk_materials.rows(0.5, 3)
    assert len(rows) == 5
    assert max(row.difference for row in rows) < 1e-10
    assert max(row.imbalance for row in rows) < 1e-10


@pytest.mark.mpi
def test_gradient_cost(capsys):
    gradient_cost.main(["--quick"])
    lines = capsys.readouterr().out.splitlines()
    # Four parameters at 3 x 3 x 9 points (see above), once for each scheme.
    assert [line.split()[1] for line in lines] == ["324"] * 2 * (MPI.COMM_WORLD.rank == 0)
    assert all(float(line.split()[-1]) > 0.0 for line in lines)


@pytest.mark.mpi
def test_scaling(capsys):
    scaling.main(["--quick", "--steps", "3", "--series", "points", "--json"])
    found = printed(capsys)
    if found is None:
        return
    few, many = found["points"]["cases"].values()
    # A joint of 2 x 8 cells doubles 3 x 9 nodes; there are one and three of them.
    assert (few["joint_points"], many["joint_points"]) == (27, 81)
    for row in (few, many):
        assert 0.0 < row["joints_solve_ms"] < row["joints_ms"]
    exponent = found["points"]["growth"]["jointed"]
    assert many["joints_ms"] / few["joints_ms"] == pytest.approx(3.0**exponent)


@pytest.mark.mpi
@pytest.mark.slow
def test_large_bodies(capsys):
    assert large_bodies.main(["--quick", "--solver", "monolithic", "--json"]) == 0
    rows = printed(capsys)
    if rows is None:
        return
    # 8 x 2 x 8 and 12 x 3 x 12 cells; the joint doubles 3 x 9 and 4 x 13 nodes.
    dofs = [3 * 9 * 3 * 9, 3 * (9 + 1) * 3 * 9, 3 * 13 * 4 * 13, 3 * (13 + 1) * 4 * 13]
    assert [row["dofs"] for row in rows] == dofs
    assert all(row["iterations"] >= row["solves"] >= 1.0 for row in rows)
    tied, *_ = rows
    assert not large_bodies.passed([tied, {**tied, "iterations": 1.3 * tied["iterations"]}])


def test_exact_modes(capsys):
    # Ten periods at 20 steps: 10 * 2 pi (2 pi / 20)^2 / 12 of an angle with midpoint, 0.49.
    off, _, ledger = exact_modes.tied(1e2, 20, 4)
    assert off < 0.03
    assert ledger < 1e-12
    exact_modes.main(["--cost", "tiny", "--modes", "5", "--steps", "3"])
    assert "tiny, 972 dofs" in capsys.readouterr().out


def test_the_bar_that_strikes_six_times():
    # The right motion is no march: one with all modes exact comes to it with the square of steps.
    right, strikes = exact_modes.right_bar()
    finer, _ = exact_modes.right_bar(scan=5e-5)
    assert strikes == 6
    np.testing.assert_allclose(right, finer, atol=1e-12)
    size = np.linalg.norm(right)
    off = [np.linalg.norm(exact_modes.striking_bar(40, n) - right) / size for n in (400, 800)]
    assert off[1] < 2e-3
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.2)


def test_fewest_steps_for_an_error():
    # Error 1/n, but for one run that is right by chance.
    steps = [10, 20, 40, 80]
    assert exact_modes.steps_for(1 / 30, steps, [0.1, 0.05, 0.025, 0.0125]) == pytest.approx(30.0)
    assert exact_modes.steps_for(1 / 60, steps, [0.1, 0.001, 0.025, 0.0125]) == pytest.approx(60.0)
    assert exact_modes.steps_for(0.2, steps, [0.1, 0.05, 0.025, 0.0125]) == 10.0
    assert exact_modes.steps_for(0.01, steps, [0.1, 0.05, 0.025, 0.0125]) == math.inf


def test_error_against_time(tmp_path):
    """Central differences, another method in other code, give the motion of the default scheme."""
    runs = error_against_time.Runs(0.04, 1, tmp_path)
    right = runs.take("energy-consistent (default)", 8.0, 12.0)
    explicit = runs.take("central differences", 1.0, 12.0)
    assert explicit["dt"] < 1e-4
    off = error_against_time.errors(explicit, right)
    # What is left under shorter steps is the lumped mass on these coarse cells.
    assert max(off[name] for name in ("crest", "opening", "slip")) < 6e-3
    coarse = error_against_time.errors(runs.take("Newmark", 0.5, 12.0), right)
    assert coarse["crest"] > 5.0 * off["crest"]
    # Found again, not run again.
    assert runs.take("central differences", 1.0, 12.0)["cpu"] == explicit["cpu"]


def test_work_precision(capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["", "--quick", "--only", "impact_1e0", "--json"])
    work_precision.main()
    found = printed(capsys)
    assert found["ec_failed"] == 0
    assert found["ledger_max"] < 1e-12
    few, many = (row for row in found["problems"]["impact_1e0"][:2])
    # Ten times the steps: a hundredth of the error of a scheme of second order.
    assert few["error_displacement"] / many["error_displacement"] == pytest.approx(100.0, rel=0.3)


def test_reservoir_waves(capsys):
    reservoir_waves.main(["--dam", "dam tiny", "--steps", "3"])
    assert "| dry joints | 636 |" in capsys.readouterr().out


def test_stability(capsys, monkeypatch):
    # Energies of completed runs balance to rounding, some 1e-16 of each of a thousand operations.
    rows = {"gap": stability.cases(stiffness=(1e6, stability.RIGID), gap=(True,))}
    rows["wall"] = [stability.Case(scene="wall", steps=5)]
    rows["mass"] = [stability.Case(scene="mass", dt=math.pi / 500.0, steps=200)]
    # With the average acceleration, impacts on stiff joints add energy (docs/theory/energy.md).
    rows["Newmark"] = stability.cases(stiffness=(1e14,), dt=(1e-4,), scheme=("Newmark",))
    monkeypatch.setattr(stability, "ROWS", rows)
    stability.main(["--json"])
    *_, last = capsys.readouterr().out.splitlines()
    found = {line["row"]: line for line in json.loads(last)}
    assert [line["runs"] for line in found.values()] == [2, 1, 1, 1]
    assert [line["failed"] for line in found.values()] == [0, 0, 0, 1]
    assert max(found[name]["imbalance"] for name in ("gap", "wall", "mass")) < 1e-11


def test_the_page_of_stability_has_all_rows():
    page = (stability.DOCS / "stability.md").read_text(encoding="utf-8")
    rows = page.split(stability.MARKS[0])[1].split(stability.MARKS[1])[0].strip().splitlines()[2:]
    shown = [(cells[1].strip(), int(cells[2])) for cells in (row.split("|") for row in rows)]
    assert shown == [(name, len(cases)) for name, cases in stability.ROWS.items()]


def test_the_table_of_the_readme():
    """The files and tests in the table exist, and so do the numbers that it reads from pages."""
    for row in brief.ROWS:
        assert all((brief.PROJECT / file).is_file() for file in row.files.split()), row.files
        assert row.test.startswith("make ") or (brief.PROJECT / row.test).is_file(), row.test
        assert f"| {row.feature} | [" in (brief.PROJECT / "README.md").read_text("utf-8")
    pages = [row for row in brief.ROWS if row.test.endswith(".md")]
    assert all(re.search(r"\d", row.number()) for row in pages)


def test_the_wall_for_opensees():
    scene = wall("tiny")
    with scene.mesh_file() as mesh:
        model = scene.model(scene.read(mesh), scene.law())
    found = opensees_wall.arrays(scene, model)
    # 3 joints of 3 x 9 points and 4 x 20 m; the + node is the one in the block at larger x.
    minus, plus = found["pairs"].T
    nodes, cells = found["nodes"], found["cells"]
    assert found["areas"].sum() == pytest.approx(3 * 4.0 * 20.0)
    np.testing.assert_allclose(nodes[minus], nodes[plus], atol=1e-12)
    middle = np.zeros(len(nodes))
    middle[cells.ravel()] = np.repeat(nodes[cells].mean(axis=1)[:, 0], 8)
    side = np.sign(found["normals"][:, 0])
    assert len(np.unique(found["pairs"])) == 2 * 3 * 3 * 9
    assert np.all(side * (middle[plus] - middle[minus]) > 0.0)
    # Corners 0, 1, 2, 3 go round the bottom, 4 is above 0; cells of 2.5 x 2 x 2.5 m.
    edges = nodes[cells[:, [1, 3, 4]]] - nodes[cells[:, :1]]
    np.testing.assert_allclose(np.linalg.det(edges), 2.5 * 2.0 * 2.5)
    across = nodes[cells[:, 2]] - nodes[cells[:, 0]]
    np.testing.assert_allclose(across, edges[:, 0] + edges[:, 1], atol=1e-12)


def test_opensees_wall(capsys):
    if reason := opensees_wall.missing():
        pytest.skip(reason)
    assert opensees_wall.main(["--quick", "--json"]) == 0  # its bounds hold
    linear, jointed, _ = printed(capsys)
    assert linear["static_difference"] < 1e-9
    assert jointed["static_difference"] < 1e-6


@pytest.mark.slow
def test_error_bars(tmp_path, monkeypatch, capsys):
    """Two rows per scene; estimates beyond 0.5 and 2 are among those with an order or a bound."""
    scene = replace(error_bars.SCENES["koyna"], size=16.0, dt=0.02)
    monkeypatch.setitem(error_bars.SCENES, "koyna", scene)
    error_bars.main(["--scenes", "koyna", "--out", str(tmp_path)])
    text = capsys.readouterr().out
    (cost,) = re.findall(r"cost of the call: ([\d.]+) runs", text)
    assert float(cost) > 1.0
    rows = [line.strip("| ").split(" | ") for line in text.splitlines()[-2:]]
    for direction, row in zip(("step", "cell"), rows, strict=True):
        assert row[:2] == ["koyna", direction]
        ordered, _, bounded, _, low, high = map(float, row[2:])
        assert 0 < low + high <= ordered + bounded <= 22  # values of the run
