# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Statics with water in joints: repeated solves until openings and pressures agree."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.solvers.step_solver import Solution, SolverAround, StepEquation, StepSolver

if TYPE_CHECKING:
    from dolfinx_joints.loads.water.pressures_in_joints import JointWaters

# Largest number of solves of a static load step until openings and pressures agree.
MOST_SOLVES = 100


class JointWaterIteration(SolverAround):
    """Repeats a static load step until the water pressures agree with the resulting openings.

    The first solve uses the pressures of the last load step. If water opens joints and open joints
    admit water, openings only grow, and the iteration ends at the smallest openings that agree with
    their pressures. At the end the right-hand side includes the water forces.
    """

    def __init__(self, water: JointWaters, inner: StepSolver) -> None:
        """Store the water and the inner solver."""
        super().__init__(inner)
        self._water = water

    def _solve(self, equation: StepEquation) -> Solution:
        """Solve for the displacement and the water (collective)."""
        start, seen = equation.x.copy(), [self._water.codes]
        while True:
            response, report = self.inner.solve(*equation)
            assert response is not None
            codes = self._water.by_opening(response.state.gap)
            toggled = self._water.toggled(codes, seen[-1])
            if not toggled.any():
                return response, report
            repeats = any(not self._water.toggled(codes, old).any() for old in seen)
            if repeats or len(seen) == MOST_SOLVES:
                worst = int(np.argmax(toggled))
                raise JointsError(
                    f"The iteration on water in the joint {self._water.joints[worst]!r} does not "
                    f"converge in a static stage: after {len(seen)} iterations {toggled[worst]} "
                    "joint points still change between wet and dry. Use more load steps, a larger "
                    "aperture, or a given Uplift."
                )
            seen.append(codes)
            self._water.change(codes, equation.b)
            start.copy(equation.x)
