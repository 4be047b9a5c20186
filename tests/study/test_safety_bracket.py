# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Search for the factor of safety: trials fail at a limit, and in steps that are too long.

Factors of models are in `verification/test_factor_of_safety`.
"""

import pytest

pytest.importorskip("dolfinx")

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.study.factor_of_safety import LARGEST, _bracket


class Trials:
    """Stable up to a limit, if the factor is at most ``reach`` times the last stable factor."""

    def __init__(self, limit, reach):
        self.limit, self.reach, self.last, self.count = limit, reach, None, 0

    def run(self, factor, *, all_solvers):
        self.count += 1
        stable = factor <= min(self.limit, self.reach * (self.last or factor))
        self.last = factor if stable else self.last
        return stable


@pytest.mark.parametrize("limit", [0.02, 0.3, 0.9999, 1.0, 1.5, 7.3, 63.9])
@pytest.mark.parametrize("reach", [1e9, 1.2, 1.01])
def test_interval_contains_the_limit(limit, reach):
    trials = Trials(limit, reach)
    lower, upper = _bracket(trials, 1e-3)
    assert lower <= limit < upper <= lower * (1.0 + 1e-3)
    assert trials.count <= (25 if reach == 1e9 else 2500)


def test_without_a_failure_and_without_an_equilibrium():
    assert _bracket(Trials(100.0, 1e9), 1e-3) == (LARGEST, float("inf"))
    with pytest.raises(JointsError, match=r"no equilibrium at any factor from 0\.015625 to 1"):
        _bracket(Trials(1e-3, 1e9), 1e-3)
