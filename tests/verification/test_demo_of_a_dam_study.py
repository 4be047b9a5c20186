# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Demo 07, from the table of sections to the report, as one who follows it runs it."""

from __future__ import annotations

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")
pytest.importorskip("pyvista")

from vtk_files import read_vtk

import dolfinx_joints as dj
from dolfinx_joints.postprocessing import measures
from dolfinx_joints.postprocessing.joints.resultants import stage_resultants

DEMO = Path(__file__).resolve().parents[2] / "demos/07_arch_dam_study.py"
STAGES = ["weight", "grouting", "full reservoir", "winter"]


def rows(path: Path) -> list[dict[str, str]]:
    """Rows of a table."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_from_the_sections_to_the_report(tmp_path):
    """Every file that it promises is there, and what they say agrees with mechanics and files."""
    command = [sys.executable, str(DEMO), "--steps", "40", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 0, done.stderr

    with dj.Results(tmp_path / "joints.h5") as results:
        assert results.stage_names == STAGES
        assert not results.relative
        stages = measures.static_stages(results)
        extremes = measures.joint_extremes(results, "joint_3")
        weight = stage_resultants(results, "joint_perimetral").force[0]
        moved = measures.displacement_history(results, "crown", "x", relative_to="ground")[1]
    # Single blocks give each other nothing; what they weigh stands on the rock, nothing sideways.
    assert all(stages[0].joints[f"joint_{k}"].normal_force == 0.0 for k in range(1, 6))
    np.testing.assert_allclose(weight[:2], 0.0, atol=1e-6 * weight[2])
    # Water bends the crown downstream and closes the joints; the cold takes from both.
    x = [stage.displacement["crown"][0] for stage in stages]
    assert x[1] == pytest.approx(x[0], rel=1e-12)
    assert x[2] > x[1]
    pressed = [stage.joints["joint_3"].normal_force for stage in stages]
    assert pressed[2] > pressed[3] > 0.0

    found = rows(tmp_path / "joints_tables/stages.csv")
    assert [row["stage"] for row in found] == STAGES
    column = next(name for name in found[0] if "crown" in name and name.endswith("x [m]"))
    np.testing.assert_allclose([float(row[column]) for row in found], x, rtol=1e-14)
    every = rows(tmp_path / "joints_tables/joint_extremes.csv")
    every = [row for row in every if row["joint"] == "joint_3"]
    assert max(float(row["largest opening [m]"]) for row in every) == extremes.opening.max()

    page = (tmp_path / "report.html").read_text()
    assert all(name in page for name in STAGES)
    assert f"{1e3 * np.abs(moved).max():.3g}" in page
    study = rows(tmp_path / "study.csv")
    assert [row["status"] for row in study] == ["complete"] * 4
    assert len({row["slip_mm"] for row in study}) == 4
    # Steps 0, 20 and 40; stages by number.
    steps = [0.0, 0.2, 0.4]
    for name, times in (("monolith", steps), ("joints", steps), ("joints_stages", range(1, 5))):
        assert [time for time, _ in read_vtk(tmp_path / f"{name}.vtkhdf")] == pytest.approx(times)
