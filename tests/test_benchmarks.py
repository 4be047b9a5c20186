# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small runs of the benchmarks: that they run, print what they promise and can fail.

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

import dolfinx_joints as dj
from benchmarks import (
    agreement,
    brief,
    cluster_model,
    compliances,
    error_against_time,
    exact_modes,
    interface_integrals,
    jointed_wall,
    large,
    large_bodies,
    motion_suite,
    opensees_wall,
    per_rank,
    reservoir_waves,
    scaling,
    stability,
)
from benchmarks.shared.parts import PARTS, Clocks
from benchmarks.shared.scenes import wall
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.effective_matrix import EffectiveMatrix
from dolfinx_joints.solvers.interface.solver import InterfaceSolver

PROMISED = {"dofs", "joint_points", "steps", "linear_ms", "joints_ms", "ratio", "newton_mean"}
PROMISED |= {"ledger", "peak_mb", "linear_cpu_ms", "joints_cpu_ms", "newton_max"}


def printed(capsys):
    """The JSON object of the last line, on rank 0; None elsewhere."""
    lines = capsys.readouterr().out.splitlines()
    return json.loads(lines[-1]) if MPI.COMM_WORLD.rank == 0 else None


@pytest.mark.mpi
def test_jointed_wall(capsys):
    jointed_wall.main(["--mesh", "tiny", "--pressure", "0.3", "--steps", "4", "--json"])
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


def test_medians_over_repeats():
    row = jointed_wall.measure(wall("tiny"), 3, repeat=3)
    assert row["repeats"] == 3
    assert row["ratio_range"][0] < row["ratio"] < row["ratio_range"][1]


def test_steps_over_those_of_the_supernodal_factor(capsys):
    rows = jointed_wall.main(["--quick", "--steps", "4", "--supernodal"])
    lines = capsys.readouterr().out.rstrip().split("\n")[-2:]
    for line, run in zip(lines, ("linear", "joints"), strict=True):
        row = {name.removeprefix(run): value for name, value in rows["tiny"].items()}
        step, solve = row["_supernodal_ms"], row["_supernodal_solve_ms"]
        shown = [float(number) for number in line.split()[2:]]
        found = [step, solve, step / solve, row["_ms"] / solve]
        assert shown == pytest.approx(found, abs=5.1e-3)


def test_the_tied_peaks_are_checked(monkeypatch):
    monkeypatch.setattr(jointed_wall, "TIED_STEPS", 3)
    wrong = replace(wall("tiny"), tied_peaks_mm=(1.0, 1.0, 1.0))
    with pytest.raises(AssertionError):
        jointed_wall.measure(wrong, 3)


def test_exact_modes(capsys):
    # Ten periods at 20 steps: 10 * 2 pi (2 pi / 20)^2 / 12 of an angle with midpoint, 0.49.
    off, _, ledger = exact_modes.tied(1e2, 20, 4)
    assert off < 0.03
    assert ledger < 1e-12
    exact_modes.main(["--cost", "tiny", "--modes", "5", "--steps", "3"])
    assert "tiny, 972 dofs" in capsys.readouterr().out


def test_reservoir_waves(capsys):
    # 5 depths of a bottom that absorbs, in the time of six waves along them: 3 % at the most.
    error, _, imbalance = reservoir_waves.force("stream", 0.75, 5.0, 0.0, "radiating", 1600)
    assert error < 0.04
    assert imbalance < 1e-12
    reservoir_waves.main(["--dam", "dam tiny", "--steps", "3"])
    assert "dam tiny, dry: 636 unknowns" in capsys.readouterr().out


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


def test_the_table_of_the_readme():
    """The files and tests in the table exist, and so do the numbers that it reads from pages."""
    for row in brief.ROWS:
        assert all((brief.PROJECT / file).is_file() for file in row.files.split()), row.files
        assert row.test.startswith("make ") or (brief.PROJECT / row.test).is_file(), row.test
        assert f"| {row.feature} | [" in (brief.PROJECT / "README.md").read_text("utf-8")
    pages = [row for row in brief.ROWS if row.test.endswith(".md")]
    assert all(re.search(r"\d", row.number()) for row in pages)


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


def test_a_run_that_fails_is_shown(capsys):
    # Blocks 5 um thick in steps of 1 ms: M / dt^2 is 1e-12 of K, below what the factor resolves.
    line = stability.measure("flat", [stability.Case(aspect=1e5)])
    assert line == {"row": "flat", "runs": 1, "failed": 1, "imbalance": None}
    assert "singular" in capsys.readouterr().err


def test_the_page_of_stability_has_all_rows():
    page = (stability.DOCS / "stability.md").read_text(encoding="utf-8")
    rows = page.split(stability.MARKS[0])[1].split(stability.MARKS[1])[0].strip().splitlines()[2:]
    shown = [(cells[1].strip(), int(cells[2])) for cells in (row.split("|") for row in rows)]
    assert shown == [(name, len(cases)) for name, cases in stability.ROWS.items()]


def test_motion_suite(capsys):
    motion_suite.main(["--quick", "--json"])
    (row,) = printed(capsys)
    assert (row["motions"], row["steps"]) == (3, 20)
    assert row["ratio"] == pytest.approx(row["together_s"] / row["alone_s"])
    assert row["difference"] < 1e-9


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


def test_without_opensees(capsys, monkeypatch):
    monkeypatch.setattr(opensees_wall, "missing", lambda: "no such module")
    assert opensees_wall.main(["--quick"]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert line == "OpenSees is left out (no such module); make bench-peers brings it."


@pytest.mark.slow
def test_compliances(capsys):
    assert (
        compliances.main(["--quick", "--kinds", "dense", "compressed", "matrix-free", "--json"])
        == 0
    )
    rows = printed(capsys)
    assert [row["kind"] for row in rows] == ["dense", "compressed", "matrix-free"]
    for row in rows:
        # 16 x 4 x 16 cells, 7 joints; the nodes of the clamped base count as well.
        assert row["unknowns"] == 3 * 7 * 5 * 17
        assert row["dense_mb"] == 8 * row["unknowns"] ** 2 / 2**20
        assert row["ledger"] < 1e-9
    dense, compressed, free = (row["kept_mb"] for row in rows)
    assert dense == rows[0]["dense_mb"]
    assert 0.0 < compressed < dense
    assert free == 0.0


@pytest.mark.slow
def test_compliances_that_differ_are_shown(monkeypatch, capsys):
    monkeypatch.setattr(compliances, "LARGEST_DIFFERENCE", -1.0)
    assert compliances.main(["--quick", "--kinds", "dense"]) == 1


def test_agreement(capsys):
    status = agreement.main(["--scenes", "tiny", "--steps", "5", "--history", "5", "--json"])
    assert status == 0
    found = printed(capsys)
    assert found["tiny"]["by_step"]["unsolved"] == 0
    assert 0.0 < found["tiny"]["by_step"]["joint_force"] <= agreement.BOUNDS["steps"]
    assert 0.0 < found["tiny"]["history"]["displacement"] <= agreement.BOUNDS["histories"]


def test_a_disagreement_is_seen(monkeypatch):
    # A reference that stops at 1e-2 of the forces is not equal to nine digits.
    monkeypatch.setattr(agreement, "REFERENCE", dj.SolverOptions(relative_tolerance=1e-2))
    assert agreement.main(["--scenes", "tiny", "--steps", "5", "--history", "5"]) == 1


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
        assert all(row["parts_ms"][part] > 0.0 for part in PARTS)
        if row["ranks"] == 1:
            assert sum(row["parts_ms"].values()) == pytest.approx(row["joints_mean_ms"])
    exponent = found["points"]["growth"]["jointed"]
    assert many["joints_ms"] / few["joints_ms"] == pytest.approx(3.0**exponent)


def test_scaling_leaves_the_package_as_it_was():
    def methods():
        return MatrixSystem.multiply, InterfaceSolver.solve, EffectiveMatrix.solver

    before = methods()
    with Clocks().watching():
        assert all(a is not b for a, b in zip(methods(), before, strict=True))
    assert methods() == before


@pytest.mark.mpi
def test_interface_integrals(capsys):
    assert interface_integrals.main(["--quick", "--parts", "wall", "law", "--json"]) == 0
    found = printed(capsys)
    if found is None:
        return
    # Newton's method, quadratic where no point changes from one branch of the law to another.
    *_, before, after, _, _ = found["wall"]["forms"]["residuals"]
    assert after < 1e2 * before**1.5
    assert 0.0 < found["law"]["left"] <= interface_integrals.BOUNDS["energy"]


def test_forms_that_differ_are_shown(monkeypatch):
    # Sums in another order differ by rounding.
    monkeypatch.setattr(interface_integrals, "BOUNDS", {"operator": 0.0})
    monkeypatch.setattr(interface_integrals, "SHAPES", interface_integrals.SHAPES[:1])
    assert interface_integrals.main(["--quick", "--parts", "operator"]) == 1


def test_efficiency_of_ranks():
    def run(ms):
        row = dict.fromkeys(scaling.STEPS.values(), ms)
        row |= {"setup_s": {"mesh": 1.0, "compliance": 0.0}, "parts_ms": {}, "bandwidth": 1e10}
        return {"dofs": {"cases": {"a": row}}}

    # 6 ms on one rank and 4 ms on two: 1.5 times as fast on twice as many.
    found = scaling.efficiencies(run(6.0), run(4.0), 2.0)["a"]
    assert found["jointed"] == pytest.approx(0.75)
    assert found["mesh"] == pytest.approx(0.5)
    assert "compliance" not in found


@pytest.mark.slow
def test_paths_agree_on_ranks():
    arguments = ["--paths", "--ranks", "1", "2", "--steps", "3", "--divisions", "4", "2", "4"]
    assert per_rank.main(arguments) == 0


def test_constants_of_a_cluster_are_found_again(tmp_path, capsys):
    # Rows that follow from constants; 100 bytes of (1000 / 8)^(2/3) = 25 to each of 7 neighbours.
    def row(ranks, dofs, points, newton):
        seconds = 1e-7 * (20.0 * dofs + 3.0 * newton * points)
        return {
            "ranks": ranks,
            "dofs": dofs,
            "joint_points": points,
            "iterations": 20.0,
            "newton": [0, newton],
            "step_cpu_s": seconds,
            "peak_mb": 300.0 + 0.01 * dofs + 0.02 * points,
            "messages": 7.0 * 20.0 * 5.0,
            "bytes": 7.0 * 20.0 * 100.0 * 25.0,
        }

    rows = [row(1, 1000, 0, 1), row(1, 1000, 100, 8), row(1, 3000, 50, 4), row(8, 1000, 0, 1)]
    file = tmp_path / "rows.txt"
    file.write_text("a table\n" + json.dumps(rows))
    one_rank_a_node = ["--node-ranks", "1", "--node-bandwidth", "17e9", "--network", "1e9"]
    body = ["--dofs", "8e6", "--points", "1e5", "--newton", "10", "--latency", "1e-5"]
    cluster_model.main([str(file), "--ranks", "8", *one_rank_a_node, *body])
    *_, printed_row = capsys.readouterr().out.splitlines()
    ranks, linear, waiting, _, jointed, *_, held, _ = printed_row.split()
    # 20 iterations of 1e6 dofs a rank; 7 * 5 messages and 3 of a sum; 7 * 100 bytes of 1e6^(2/3).
    wire = 20 * (38 * 1e-5 + 7 * 100 * 1e4 / 1e9)
    assert float(linear) == pytest.approx(2.0 + wire, abs=1e-3)
    assert float(waiting) == pytest.approx(100 * wire / (2.0 + wire), abs=1)
    # 50 iterations, and 10 corrections of 1e5 points.
    expected = 2.5 * (2.0 + wire) + 3e-7 * 10 * 1e5 / 8
    assert float(jointed) == pytest.approx(expected, abs=2e-3)
    assert (int(ranks), int(held)) == (8, round(300 + (8e4 + 2e3) / 8))


@pytest.mark.slow
@pytest.mark.parametrize("linear", ["iterative", "direct"])
def test_large(capsys, linear):
    assert large.main(["--quick", "--linear", linear, "--json"]) == 0
    tied, split = printed(capsys)
    # 16 x 4 x 16 cells; the joint doubles its 5 x 17 nodes.
    assert tied["dofs"] == 3 * 17 * 5 * 17
    assert split["dofs"] == tied["dofs"] + 3 * 5 * 17
    assert split["opened"] > 0.0
    assert not large.passed({**split, "opened": 0.0})


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
