# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The study of joints that winter opens: what follows from how it is set up."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

import dolfinx_joints as dj
from studies import thermal_opening
from studies.ambiesta import Case

COARSE = {"size": 14.0, "order": 1, "steps": 10, "self_weight": "grouted"}


def test_openings(tmp_path):
    """Grouted joints are closed, free bodies shrink in proportion, and shaking opens more."""
    found = {}
    for cooling in (0.0, 8.0, 16.0):
        thermal_opening.run(Case(**COARSE), cooling, tmp_path / f"{cooling:g}")
    with dj.Results(tmp_path / "0" / "joints.h5") as warm:
        for cooling in (0.0, 8.0, 16.0):
            with dj.Results(tmp_path / f"{cooling:g}" / "joints.h5") as results:
                found[cooling] = thermal_opening.openings(results, warm).values
    assert np.abs(found[0.0][:, :2]).max() < 1e-10
    # Where the dam touches nothing twice the cold opens twice as far; contact only bounds it.
    cold, colder = (found[c][:, 1].max() for c in (8.0, 16.0))
    assert 1e-4 < cold < 1e-2
    assert colder == pytest.approx(2.0 * cold, rel=0.05)
    for values in found.values():
        assert np.all(values[:, 2] >= values[:, 1])


def test_command(tmp_path, capsys):
    """Two tables, a figure, and one sentence for what cannot be."""
    options = ["--size", "14", "--steps", "5", "--out", str(tmp_path)]
    thermal_opening.main(options)
    text = capsys.readouterr().out
    assert "cooled by 8 K after grouting" in text
    assert "not cooled" in text
    assert text.count("largest opening [mm]") == 2
    assert (tmp_path / "thermal_opening.png").stat().st_size > 10_000
    with pytest.raises(ValueError, match="cooling is -1.0 K; it must be positive"):
        thermal_opening.main([*options, "--cooling", "-1"])
