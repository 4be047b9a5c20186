# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two solvers of the same steps, the second asked where the first does not converge."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from petsc4py import PETSc

from dolfinx_joints.common.errors import ConvergenceError
from dolfinx_joints.laws.law import BACKWARD_EULER, JointState, Response, Rule
from dolfinx_joints.solvers.effective_matrix import MatrixCoefficients
from dolfinx_joints.solvers.step_solver import SolveReport, StepSolver


class FirstThatWorks:
    """Takes each step by one solver and, where that does not converge, by another.

    Args:
        first: Asked first.
        make_second: Makes the other one, when first needed.
    """

    def __init__(self, first: StepSolver, make_second: Callable[[], StepSolver]) -> None:
        """Make nothing yet."""
        self.system, self.name, self.options = first.system, first.name, first.options
        self._first, self._make = first, make_second
        self._second: StepSolver | None = None

    def solve(
        self,
        effective: MatrixCoefficients,
        b: PETSc.Vec,
        x: PETSc.Vec,
        state: JointState | None,
        rule: Rule = BACKWARD_EULER,
    ) -> tuple[Response | None, SolveReport]:
        """Solve for ``x`` in place; see `NewtonSolver.solve` (collective).

        Raises:
            ConvergenceError: Neither converged; what is said is of the nearer one.
        """
        start = x.copy()
        try:
            return self._first.solve(effective, b, x, state, rule)
        except ConvergenceError as failure:
            if failure.law is not None:
                raise
            known = failure
        start.copy(x)
        self._second = self._second or self._make()
        try:
            return self._second.solve(effective, b, x, state, rule)
        except ConvergenceError as failure:
            raise min(known, failure, key=_distance) from None

    def state_dict(self) -> dict[str, Any]:
        """That of the first solver; the second keeps nothing."""
        return self._first.state_dict()

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Take up what another's ``state_dict`` gave."""
        self._first.load_state_dict(state_dict)


def _distance(failure: ConvergenceError) -> float:
    """The residual, infinite where there is none."""
    residual = failure.residual
    return residual if residual is not None and residual < float("inf") else float("inf")
