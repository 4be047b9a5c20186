# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static stages read from files whose numbers can be worked out by hand."""

import csv
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from written_runs import WEIGHT, write_stages

from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.export.tables import write_csv
from dolfinx_joints.postprocessing import measures
from dolfinx_joints.results.reader import Results
from dolfinx_joints.results.writer import ResultsWriter


def test_stages_hold_what_was_written(tmp_path: Path) -> None:
    with Results(write_stages(tmp_path / "stages.h5")) as results:
        assert results.stage_names == [WEIGHT, "winter"]
        assert (results.stage_index("winter"), results.stage_index(-2)) == (1, 0)
        for stage in ("summer", 2):  # the numbers in the message are those that may be given
            with pytest.raises(
                ResultsError, match=rf"No static stage {stage!r}.*0 \({WEIGHT}\), 1"
            ):
                results.stage_index(stage)
        weight, winter = measures.static_stages(results)
    assert (weight.name, weight.load_time) == (WEIGHT, 0.0)
    np.testing.assert_array_equal(weight.displacement["crest"], [0.0, 0.0, -1e-3])
    np.testing.assert_array_equal(winter.displacement["crest"], [0.0, 0.0, -2e-3])
    np.testing.assert_array_equal(winter.reaction["base"], [0.0, 0.0, 9e6])
    assert all(np.isnan(value) for value in winter.stresses.values())
    before, after = weight.joints["joint_1"], winter.joints["joint_1"]
    # 4 m^2 of 2 MPa and 0.5 MPa, tan 45 degrees = 1; then half of it.
    assert before.normal_force == pytest.approx(8e6)
    assert before.shear_force == pytest.approx(2e6)
    assert before.sliding_safety == pytest.approx(4.0)
    assert (before.contact, after.contact) == (1.0, 0.5)
    assert (before.opening_max, after.opening_max) == (0.0, 3e-3)
    assert before.slip_max == pytest.approx(5e-6)
    assert after.normal_force == pytest.approx(4e6)
    assert after.pressure_max == 2e6
    # Files of earlier versions have neither energies nor jumps.
    assert (weight.energy, weight.jumps) == (None, ())
    # Water pushes the + side along the normal: 2 m^2 of 0.1 MPa.
    assert (before.water_force, after.water_force) == (0.0, pytest.approx(2e5))


def test_an_open_joint_has_a_pressure_of_zero_without_a_sign(tmp_path: Path) -> None:
    with Results(write_stages(tmp_path / "stages.h5", open_from=0.0)) as results:
        assert str(measures.static_stages(results)[1].joints["joint_1"].pressure_max) == "0.0"


def test_tables_of_a_file_of_stages_alone(tmp_path: Path) -> None:
    """Read back, every cell is what `static_stages` gives, in the unit of its header."""
    with Results(write_stages(tmp_path / "stages.h5")) as results:
        stages = measures.static_stages(results)
        paths = write_csv(results, tmp_path / "tables")
    assert [path.name for path in paths] == ["stages.csv", "stage_joints.csv"]
    rows, joints = (list(csv.DictReader(path.open(encoding="utf-8"))) for path in paths)
    for stage, row, of_joint in zip(stages, rows, joints, strict=True):
        assert row.pop("stage") == of_joint.pop("stage") == stage.name
        wanted = {"load time [s]": stage.load_time}
        for i, axis in enumerate("xyz"):
            moved = f"displacement of crest from the unloaded body {axis} [m]"
            wanted[moved] = stage.displacement["crest"][i]
            wanted[f"reaction of base {axis} [N]"] = stage.reaction["base"][i]
        assert {name: float(value) for name, value in row.items()} == wanted
        assert of_joint.pop("joint") == "joint_1"
        found = {name.split(" [")[0]: float(value) for name, value in of_joint.items()}
        assert found == asdict(stage.joints["joint_1"])
    assert "normal_force [N]" in joints[0]
    assert "opening_max [m]" in joints[0]


def test_a_file_without_stages_has_none(tmp_path: Path) -> None:
    with ResultsWriter(tmp_path / "run.h5", {}) as writer:
        writer.start()
    with Results(tmp_path / "run.h5") as results:
        assert results.stage_names == measures.static_stages(results) == []
