# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction of an elastic block that slides, which short waves diminish unless they are damped."""

import pytest

pytest.importorskip("petsc4py")

import dolfinx_joints as dj
from benchmarks.sliding_chatter import JOINTS, slide

RIGID, CUT = JOINTS["rigid"], dj.StepControl(tolerance=1e-3, max_halvings=8)


def test_undamped_block_chatters_and_is_reported():
    """Steps cut for accuracy resolve the waves that friction feeds; mean friction falls by 5 %."""
    cut = slide(RIGID, 20, control=CUT)
    assert cut.late < 0.97
    assert cut.chatter["joint_1"] > 0.3


def test_damped_block_slides_at_the_limit():
    """Damping of the time of sound along a cell: 1 % of the limit, however steps are cut."""
    for steps, control in ((20, None), (20, CUT), (400, None)):
        run = slide(RIGID, steps, damping=1.0, control=control)
        assert run.late == pytest.approx(1.0, abs=0.01)
        assert not run.chatter
