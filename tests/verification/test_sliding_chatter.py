# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction of an elastic block that slides, which short waves diminish unless they are damped."""

import pytest

pytest.importorskip("petsc4py")

import dolfinx_joints as dj
from benchmarks.sliding_chatter import JOINTS, slide

RIGID, CUT = JOINTS["rigid"], dj.StepControl(tolerance=1e-3, max_halvings=8)


def test_steps_cut_for_accuracy_end_where_points_chatter():
    """They would resolve the waves that friction feeds: it fell to 0.89 of its limit by 0.1 s.

    In equal steps of 1 ms it is 0.997.
    """
    cut = slide(RIGID, 100, control=CUT, end=0.1)
    assert cut.late == pytest.approx(1.0, abs=0.02)
    assert cut.chatter["joint_1"] > 0.2
    assert cut.steps < 1000


def test_damped_block_slides_at_the_limit():
    """Damping of the time of sound along a cell: 1 % of the limit, however steps are cut."""
    for steps, control in ((20, None), (20, CUT), (400, None)):
        run = slide(RIGID, steps, damping=1.0, control=control)
        assert run.late == pytest.approx(1.0, abs=0.01)
        assert not run.chatter
