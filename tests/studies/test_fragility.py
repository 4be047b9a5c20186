# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The fragility study: its motions, and what it prints of runs that tell and that do not."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from studies import fragility
from studies.ambiesta import ALL_STEPS, Case, make_motion


def test_motions():
    found = fragility.motions(2, [0.5, 1.0], ALL_STEPS)
    assert list(found) == ["seed1_x0.5", "seed1_x1", "seed2_x0.5", "seed2_x1"]
    # The first is that of demo 03.
    demo = make_motion(Case())
    np.testing.assert_array_equal(found["seed1_x1"].acceleration, demo.acceleration)
    np.testing.assert_allclose(found["seed1_x0.5"].acceleration, 0.5 * demo.acceleration)
    assert not np.allclose(found["seed2_x1"].acceleration, demo.acceleration)


def test_command(tmp_path, capsys):
    """The number of openings above a limit is that of the table; complete runs are kept."""
    options = ["--size", "14", "--order", "1", "--seeds", "3", "--scales", "1", "1.2"]
    options += ["--steps", "410", "--out", str(tmp_path)]
    tally = fragility.main([*options, "--limit", "1"])
    text = capsys.readouterr().out
    assert len(tally.done) == 6
    assert "0 of 6 above 1000 mm" in text
    assert text.count("exceeded in no run") == len(fragility.INTENSITIES)
    (folder,) = tmp_path.iterdir()
    lines = (folder / "fragility.csv").read_text().splitlines()
    assert not (folder / "fragility.png").exists()
    place = lines[0].split(",").index("opening [m]")
    opening = sorted(float(line.split(",")[place]) for line in lines[1:])
    # Half of six runs are above a limit between the third and the fourth.
    tally = fragility.main([*options, "--limit", f"{0.5 * (opening[2] + opening[3])}"])
    assert len(tally.skipped) == 6
    text = capsys.readouterr().out
    assert "3 of 6 above" in text
    assert "6 kept, 0 failed" in text
