# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What objects show of themselves in text and in notebooks, against what they hold."""

import re

import numpy as np
import pytest
from written_runs import write_run

from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.motions.motion import Motion
from dolfinx_joints.postprocessing import plots
from dolfinx_joints.results.reader import Results
from dolfinx_joints.study import Study


def facts(shown: object) -> dict[str, str]:
    """Rows of an object's text; its HTML has the same."""
    title, *lines = repr(shown).splitlines()
    assert title == type(shown).__name__
    assert len(lines) < 20
    rows = dict(re.split(r"  +", line.strip(), maxsplit=1) for line in lines)
    html = shown._repr_html_()
    cells = re.findall(r"<th[^>]*>(.*?)</th><td[^>]*>(.*?)</td>", html)
    assert dict(cells) == rows
    return rows


def test_a_motion():
    acceleration = np.array([[0.0, 0.0, 0.0], [3.0, -4.0, 1.0], [0.0, 2.0, 0.0]])
    rows = facts(Motion(acceleration=acceleration, dt=0.005, name="test"))
    assert rows["duration"] == "0.01 s in steps of 0.005 s"
    for axis, peak in zip("xyz", (3.0, 4.0, 1.0), strict=True):
        assert rows[f"peak {axis}"] == f"{peak:g} m/s², {peak / STANDARD_GRAVITY:.3g} g"


def test_results(tmp_path):
    with Results(write_run(tmp_path / "r.h5")) as results:
        rows = facts(results)
        assert rows["file"] == f"{tmp_path / 'r.h5'}, complete"
        assert rows["joints"] == "joint_1"
        assert rows["points"] == "mid-crest"
        records, span, _ = re.split(r", |: ", rows["histories"], maxsplit=2)
        assert records == f"{results.rows('histories')} records"
        assert span == "0 to {:g} s".format(results.time("histories")[-1])
    assert facts(results)["file"].endswith("closed")


def case(folder):
    return {}


def test_a_study(tmp_path):
    rows = facts(Study(tmp_path, case, {"a": {}, "b": {}}))
    assert rows["cases"] == "2: a, b"
    assert rows["finished"] == "0, 0 failed"


@pytest.mark.mpi
def test_mesh_model_and_stages(comm, wall_file, read):
    """Every rank can show what it has by itself, and all show the same."""
    dj = pytest.importorskip("dolfinx_joints")
    pytest.importorskip("dolfinx")
    from shaken_wall import DT, shaking, wall

    model = wall(read(wall_file()))
    simulation = dj.Simulation(model)
    static = simulation.statics()
    outcome = simulation.dynamics(dt=DT, steps=2, motion=shaking)
    shown = [facts(each) for each in (model.jointed, model, static, outcome, outcome.state)]
    mesh, of_model, of_static, of_outcome, of_state = shown
    # 4 x 1 x 3 hexahedra, 3 joints of 1 x 3 facets; 5 x 2 x 4 nodes and 2 x 4 on each joint.
    assert mesh["cells"].startswith("12, hexahedron")
    assert mesh["nodes"].startswith(f"{5 * 2 * 4 + 3 * 2 * 4} in 3 dimensions")
    assert mesh["joint facets"] == "9"
    assert of_model["unknowns"].startswith(f"{3 * (40 + 24)} displacements")
    assert of_model["joint points"] == f"{3 * 8} of FrictionNoTension"
    assert of_model["supports"] == "Fixed (base)"
    counts = static.reports[-1].counts
    assert of_static["joint points"].startswith(f"24: {100 * counts.open / 24:.1f} % open")
    assert of_outcome["end"] == f"{2 * DT:g} s, 2 steps"
    error = float(of_outcome["energy error"].split()[0])
    assert error == pytest.approx(100.0 * outcome.energy_error, rel=1e-2)
    assert of_state["time"] == f"{2 * DT:g} s"
    del mesh["ranks" if comm.size > 1 else "cells"]
    assert len({str(each) for each in comm.allgather(shown[1:4])}) == 1


def test_figures_and_axes_show_themselves(tmp_path):
    with Results(write_run(tmp_path / "r.h5")) as results:
        ax = plots.energies(results)
        panels = plots.joint_histories(results)
    for shown in (ax, ax.figure, panels[0].figure):
        picture = shown._repr_png_()
        assert picture[:8] == b"\x89PNG\r\n\x1a\n"
        assert len(picture) > 10_000
