# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A block on a shaken base, whose slip turns within steps, against its exact slip.

The exact slip is `benchmarks.turning_block.exact_slip`: between two events, integrals of the load.
"""

import math

import numpy as np
import pytest

pytest.importorskip("petsc4py")

from benchmarks.turning_block import MOTIONS, error


@pytest.mark.parametrize("stiffness", [1e10, math.inf])
@pytest.mark.parametrize("name", MOTIONS)
def test_slip_at_400_steps_per_cycle(name, stiffness):
    """Without a cut step; friction that keeps one direction in a step leaves up to 1.6 %."""
    off, solves, ledger = error(MOTIONS[name], stiffness, 400)
    assert solves == 400
    assert off < 2e-3
    assert ledger < 1e-12


def test_second_order():
    """From 100 to 800 steps by more than 8^1.5, that of the first order being 8; rms of motions."""
    coarse, fine = (
        np.sqrt(np.mean([error(motion, math.inf, steps)[0] ** 2 for motion in MOTIONS.values()]))
        for steps in (100, 800)
    )
    assert coarse / fine > 8**1.5
