# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A run as one row of a table."""

from pathlib import Path

import numpy as np
import pytest

from studies.summary import all_joints, summary_row
from tests.postprocessing.test_measures import along_x, write, write_joint


def test_summary_row_without_joints(tmp_path: Path) -> None:
    wave = along_x(lambda t: 0.02 * np.sin(2 * np.pi * 5.0 * t))
    results = write(tmp_path / "r.h5", wave, ground=along_x(np.ones_like))
    row = summary_row(results)
    assert all(isinstance(value, float) for value in row.values())
    assert row["strong_until"] == pytest.approx(9.5, abs=0.01)
    assert row["crest/x/peak_strong"] == pytest.approx(0.02)
    assert row["crest/x/frequency"] == pytest.approx(5.0, abs=0.05)
    assert row["crest/x/acceleration, low-passed at 25 Hz"] == pytest.approx(
        1.0
    )  # the ground's, as relative is 0
    assert row["base/z/peak_strong"] == 0.0
    assert row["joints/opening_max"] == row["joints/share_open"] == 0.0
    assert np.isnan(row["stress/arch_max"])
    assert np.isnan(row["energy_error"])  # not in the file's summary
    assert (row["steps"], row["seconds"]) == (2000.0, 4.0)


def test_summary_row_of_a_run_whose_ground_rests(tmp_path: Path) -> None:
    results = write(tmp_path / "r.h5", along_x(lambda t: 0.01 * t))
    row = summary_row(results)
    assert row["strong_until"] == pytest.approx(10.0)  # the end of the run
    assert row["crest/x/peak_strong"] == pytest.approx(0.1)
    assert np.isnan(row["crest/x/peak_later"])


def test_all_joints_together(tmp_path: Path) -> None:
    together = all_joints(write_joint(tmp_path / "r.h5"))
    assert together["opening_max"] == pytest.approx(3e-3)
    # joint_2 has twice the area of joint_1 and is never open.
    assert together["share_open"] == pytest.approx(6 / 40 / 3)
