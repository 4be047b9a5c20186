# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Statics with water in joints: solves until openings and pressures agree."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.laws.law import BACKWARD_EULER

if TYPE_CHECKING:
    from petsc4py import PETSc

    from dolfinx_joints.laws.law import JointState, Response, Rule
    from dolfinx_joints.loads.water.pressures_in_joints import JointWaters
    from dolfinx_joints.solvers.effective_matrix import MatrixCoefficients
    from dolfinx_joints.solvers.step_solver import SolveReport, StepSolver

# Solves of one static load step before openings and pressures are given up.
MOST_SOLVES = 100


class JointWaterIteration:
    """Solves a static load step again until the water is that of the openings it leads to.

    It begins with the water of the last load step. Where water opens and opening lets water in,
    openings only grow on the way, and the smallest that agree are found.
    """

    def __init__(self, water: JointWaters, solver: StepSolver) -> None:
        """Take the water and the solver."""
        self._water, self._solver, self.name = water, solver, solver.name

    def solve(
        self,
        effective: MatrixCoefficients,
        b: PETSc.Vec,
        x: PETSc.Vec,
        state: JointState | None,
        rule: Rule = BACKWARD_EULER,
    ) -> tuple[Response | None, SolveReport]:
        """Solve for ``x`` and the water; ``b`` is left with its forces (collective)."""
        start, seen = x.copy(), [self._water.codes]
        while True:
            response, report = self._solver.solve(effective, b, x, state, rule)
            assert response is not None
            codes = self._water.by_opening(response.state.gap)
            toggled = self._water.toggled(codes, seen[-1])
            if not toggled.any():
                return response, report
            again = any(not self._water.toggled(codes, old).any() for old in seen)
            if again or len(seen) == MOST_SOLVES:
                worst = int(np.argmax(toggled))
                raise JointsError(
                    f"The water in the joint {self._water.joints[worst]!r} does not settle in a "
                    f"static stage: after {len(seen)} iterations "
                    f"{toggled[worst]} of its points still change between wet and dry; take more "
                    "load steps, a larger aperture, or a given Uplift."
                )
            seen.append(codes)
            self._water.change(codes, b)
            start.copy(x)
