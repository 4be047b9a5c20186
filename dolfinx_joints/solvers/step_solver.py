# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interface of the solvers of a step: options, equation, report, base classes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple

import annotated_types as at
from petsc4py import PETSc

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ConvergenceError
from dolfinx_joints.common.parameters import check_kind_of
from dolfinx_joints.laws.law import BACKWARD_EULER, JointState, Response, Rule, StatusCounts
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.effective_matrix import LinearSolver, MatrixCoefficients

# How the compliance of the joints is stored.
ComplianceKind = Literal["auto", "dense", "compressed", "matrix-free"]


@dataclass(frozen=True, kw_only=True)
@checked
class SolverOptions:
    """Tolerances and limits of the solvers.

    Attributes:
        relative_tolerance: Accepted residual divided by the largest force that changes in the step.
            The condensed solver aims at a hundredth of this value. Both solvers also accept a
            larger residual within rounding error, see `limits`.
        max_iterations: Iterations after which the solve fails.
        max_cuts: Largest number of halvings of a Newton correction by the line search.
        linear: Solver of the bulk, ``direct``, ``mumps`` (direct, without CHOLMOD), ``iterative``,
            or ``auto``: direct if the factor is expected to fit into memory.
        compliance: How the condensed solver stores the compliance of the joints, see `Compliance`.
        linear_options: PETSc options of the direct solver of the tangent, without prefix.
    """

    relative_tolerance: Annotated[float, at.Gt(0), at.Lt(1)] = 1e-10
    max_iterations: Annotated[int, at.Ge(1)] = 30
    max_cuts: Annotated[int, at.Ge(0), at.Le(50)] = 10
    linear: LinearSolver = "auto"
    compliance: ComplianceKind = "auto"
    linear_options: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        given = {} if self.linear_options is None else self.linear_options
        has_names = isinstance(given, Mapping) and all(isinstance(name, str) for name in given)
        check_kind_of("linear_options", given, has_names, "values by option name")


@dataclass(frozen=True, kw_only=True)
class SolveReport:
    """Iterations, factorizations and residual of a solve.

    Attributes:
        iterations: Newton iterations (1 for a linear solve).
        factorizations: Number of matrices factored in the solve.
        residual: Last residual, relative to the largest force of the equilibrium.
        counts: Number of joint points by status, None without joints.
        residuals: Residual at the start and after each iteration of the monolithic solver, also
            relative to the largest force; empty for other solvers.
        solver: Name of the solver, see `StepSolver`.
    """

    iterations: int
    factorizations: int
    residual: float = 0.0
    counts: StatusCounts | None = None
    residuals: tuple[float, ...] = ()
    solver: str = ""


class StepEquation(NamedTuple):
    """Equation of a step, A x + B^T (w t(g + B x)) = b (13).

    Attributes:
        effective: Coefficients of A.
        b: Right-hand side [N].
        x: Change of the displacement [m]: start of the iteration, then the solution; constrained
            dofs contain their prescribed values.
        state: Joint state at the start of the step, None without joints and nonlinear cells.
        rule: Rule by which the laws are evaluated.
    """

    effective: MatrixCoefficients
    b: PETSc.Vec
    x: PETSc.Vec
    state: JointState | None
    rule: Rule = BACKWARD_EULER


# The response of the joints, None without joints and nonlinear cells, and the report of the solve.
Solution = tuple[Response | None, SolveReport]


class StepSolver(ABC):
    """Solver of the equations of the steps of one system.

    Attributes:
        system: The system.
        name: ``linear``, ``monolithic``, ``forms`` or ``condensed``.
        options: Tolerances and limits.
        follows_path: True if static solves start only from the accepted state, by the elastic
            predictor. Otherwise they start from open joints or, in the condensed solver, from the
            last joint forces, and may find another branch of equilibria.
    """

    system: MatrixSystem
    name: str
    options: SolverOptions
    follows_path = True

    def solve(
        self,
        effective: MatrixCoefficients,
        b: PETSc.Vec,
        x: PETSc.Vec,
        state: JointState | None,
        rule: Rule = BACKWARD_EULER,
    ) -> Solution:
        """Solve a `StepEquation` for ``x`` in place, starting from its values (collective).

        Raises:
            ConvergenceError: No solution was found.
        """
        return self._solve(StepEquation(effective, b, x, state, rule))

    @abstractmethod
    def _solve(self, equation: StepEquation) -> Solution:
        """Solve the equation of a step (collective)."""

    def failure(
        self, response: Response | None, state: JointState | None, iterations: int, residual: float
    ) -> ConvergenceError:
        """Return the error of an iteration that did not converge (collective)."""
        assert self.system.internal_forces is not None
        return ConvergenceError(
            iteration=iterations,
            residual=residual,
            tolerance=self.options.relative_tolerance,
            **self.system.internal_forces.failure(response, state),
        )

    def state_dict(self) -> dict[str, Any]:
        """Return the arrays and numbers, by name, that affect later solves (collective)."""
        return {}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:  # noqa: B027
        """Restore the ``state_dict`` of another solver of the same system (collective)."""


class SolverAround(StepSolver):
    """Base class of solvers that wrap another one.

    Args:
        inner: The wrapped solver.

    Attributes:
        inner: The wrapped solver.
    """

    def __init__(self, inner: StepSolver) -> None:
        self.inner = inner
        self.system, self.name, self.options = inner.system, inner.name, inner.options

    def state_dict(self) -> dict[str, Any]:
        """Return the state of the wrapped solver (collective)."""
        return self.inner.state_dict()

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Restore the state of the wrapped solver (collective)."""
        self.inner.load_state_dict(state_dict)
