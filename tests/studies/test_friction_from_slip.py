# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Study of friction from residual slip: Newmark's closed form, the damped block, the command."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from dolfinx_joints.common.constants import STANDARD_GRAVITY
from studies import friction_from_slip as study

BLOCK = "block, damping of 50 % at 100 Hz"


def test_rigid_block():
    """Compare with s = C (1 / mu - 1 / mu_0): the prediction is h / (mu + h) off."""
    test = study.newmark_1965()
    slope = 0.5 * (8.0 * 0.1 / 0.5) ** 2 / STANDARD_GRAVITY
    assert test.linear / study.CHANGE == pytest.approx(slope)
    steps = test.sizes * study.CHANGE
    errors = test.remainders / (steps * slope)
    assert errors == pytest.approx(steps / (0.5 + steps), rel=1e-5)
    assert test.linear_range * study.CHANGE == pytest.approx(0.05)  # 10 % of the friction


def test_command(tmp_path, capsys):
    """The damped block is near the rigid one; chattering joints have no useful slope."""
    study.main(["--quick", "--out", str(tmp_path)])
    slopes, searches = capsys.readouterr().out.strip().split("\n\n")
    by_name = {line[:34].strip(): line[34:].split() for line in slopes.splitlines()[1:]}
    assert len(by_name) == 7
    rigid = float(by_name["rigid block, Newmark (1965)"][0])
    assert rigid == pytest.approx(130.5, abs=0.1)
    assert float(by_name[BLOCK][0]) == pytest.approx(rigid, rel=0.05)
    assert by_name[BLOCK][1:] == ["10", "%"]
    assert by_name["the same with Newmark"][1:] == ["none"]
    assert len(searches.splitlines()) == 1 + len(study.METHODS)


def test_search():
    """The friction of a rigid block is found from its slip by all methods."""

    class Rigid:
        def slip_and_slope(self, friction, *, slope):
            return 1.0 / friction - 0.5, -1.0 / friction**2 if slope else np.nan

    for method in study.METHODS:
        found = study.search(Rigid(), 1.0 / 0.42 - 0.5, method)
        assert found.friction == pytest.approx(0.42, abs=2.0 * study.ERROR)
        assert 2 < found.runs < 10
