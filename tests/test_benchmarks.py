# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small runs of the benchmarks: that they run, print what they promise and can fail.

Expected: facts of the meshes counted by hand, and bounds that the programs assert themselves.
"""

import json

import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from mpi4py import MPI

from benchmarks import jointed_wall
from benchmarks._scenes import wall

pytestmark = pytest.mark.mpi

PROMISED = {"dofs", "joint_points", "steps", "linear_ms", "joints_ms", "ratio", "newton_mean"}
PROMISED |= {"ledger", "peak_mb", "linear_cpu_ms", "joints_cpu_ms", "newton_max"}


def printed(capsys):
    """The JSON object of the last line, on rank 0; None elsewhere."""
    lines = capsys.readouterr().out.splitlines()
    return json.loads(lines[-1]) if MPI.COMM_WORLD.rank == 0 else None


def test_jointed_wall(capsys):
    jointed_wall.main(
        ["--mesh", "tiny", "--pressure", "0.3", "--steps", "5", "--repeat", "2", "--json"]
    )
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
        assert row["accepted"] == row["steps"] == 5
        assert row["ledger"] < 1e-9
        assert row["linear_ms"] > 0.0
        assert row["ratio_range"][0] <= row["ratio"] <= row["ratio_range"][1]


def test_the_tied_peaks_are_checked():
    from dataclasses import replace

    wrong = replace(wall("tiny"), tied_peaks_mm=(1.0, 1.0, 1.0))
    with pytest.raises(AssertionError):
        jointed_wall.measure(wrong, 200)
