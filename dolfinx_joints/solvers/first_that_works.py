# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solver wrappers: fall back to another solver, or repeat a step after releasing broken bonds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from dolfinx_joints.common.errors import ConvergenceError, JointsError
from dolfinx_joints.laws.law import Response
from dolfinx_joints.solvers.step_solver import Solution, SolverAround, StepEquation, StepSolver


class StaticSolver(SolverAround):
    """Solver of static increments that tries other solvers only as a last resort.

    The first solver follows the branch of equilibria of the accepted state. The other solvers may
    find another branch, to which the structure then jumps.

    Args:
        first: Solver of all increments.
        others: Functions that make the other solvers on first use, each from the previous solver.

    Attributes:
        last_resort: True if the other solvers are tried when the first one does not converge.
    """

    def __init__(self, first: StepSolver, *others: Callable[[StepSolver], StepSolver]) -> None:
        """Store the solver; the others are made on first use."""
        super().__init__(first)
        self._solvers, self._others, self.last_resort = [first], others, False

    def _solve(self, equation: StepEquation) -> Solution:
        """Solve the equation of a step (collective).

        Raises:
            ConvergenceError: No solver converged. The error describes the attempt with the smallest
                residual. The last solver is excluded: its residual may be relative to the forces of
                blocks that have moved far.
        """
        start = equation.x.copy()
        failures: list[ConvergenceError] = []
        for i in range(1 + len(self._others) * self.last_resort):
            if i == len(self._solvers):
                self._solvers.append(self._others[i - 1](self._solvers[-1]))
            start.copy(equation.x)
            try:
                return self._solvers[i].solve(*equation)
            except ConvergenceError as failure:
                if failure.law is not None:
                    raise
                if i < len(self._others) or not failures:
                    failures.append(failure)
            except JointsError:
                if not failures:
                    raise
        raise min(failures, key=_distance) from None

    def continue_from(self, response: Response | None) -> None:
        """Start the next solves from the tractions of an accepted response."""
        from dolfinx_joints.solvers.interface.solver import InterfaceSolver

        first = self._solvers[0]
        if isinstance(first, InterfaceSolver) and response is not None:
            first.carried = response.traction


class OtherStarts(SolverAround):
    """Wrapper whose static increments do not start from the accepted state (`follows_path`).

    Args:
        inner: The solver.
    """

    def _solve(self, equation: StepEquation) -> Solution:
        """Solve the equation of a step (collective)."""
        self.inner.follows_path = False
        try:
            return self.inner.solve(*equation)
        finally:
            self.inner.follows_path = True


class BondReleaseSolver(SolverAround):
    """Wrapper that solves a step with intact bonds, then again without the most overloaded ones.

    A step often has one solution with intact bonds and another with broken bonds. A bond breaks
    only if a converged solution overloads it; an overload in an iterate does not break the bond.
    The solution with intact bonds is therefore preferred.

    Args:
        inner: Solver of a step whose bonds do not change.
    """

    def _solve(self, equation: StepEquation) -> Solution:
        """Solve the equation of a step (collective)."""
        assert equation.state is not None
        assert self.system.contact is not None
        bonds, iterations, factorizations = self.system.contact.bonds(equation.state), 0, 0
        while True:
            response, report = self.inner.solve(*equation._replace(state=bonds.start()))
            iterations += report.iterations
            factorizations += report.factorizations
            assert response is not None
            if not bonds.release(response.state):
                return response, replace(
                    report, iterations=iterations, factorizations=factorizations
                )


def _distance(failure: ConvergenceError) -> float:
    """Return the residual of a failed solve, infinity if it has none."""
    residual = failure.residual
    return residual if residual is not None and residual < float("inf") else float("inf")
