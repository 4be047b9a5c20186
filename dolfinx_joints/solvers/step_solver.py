# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interface of the solvers of a step: options, report, protocol and failure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Protocol

import annotated_types as at
from petsc4py import PETSc

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ConvergenceError
from dolfinx_joints.common.parameters import check_kind_of
from dolfinx_joints.joints.internal_forces import InternalForces
from dolfinx_joints.laws.law import BACKWARD_EULER, JointState, Response, Rule, StatusCounts
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.effective_matrix import LinearSolver, MatrixCoefficients

# Parts of the compliance at the joints that may be kept.
ComplianceKind = Literal["auto", "dense", "compressed", "matrix-free"]


@dataclass(frozen=True, kw_only=True)
@checked
class SolverOptions:
    """Tolerances and limits of the solvers.

    Attributes:
        relative_tolerance: Residual against the largest of the forces that change in the step.
        max_iterations: Iterations before the solve is given up.
        max_cuts: Halvings of a Newton correction that the line search may try.
        linear: Solver of the bulk, ``direct``, ``mumps`` (direct, without CHOLMOD), ``iterative``,
            or ``auto``: direct where its factor is expected to fit into memory.
        compliance: Part of the compliance at the joints that the condensed solver keeps, see
            `Compliance`.
        linear_options: PETSc options of the direct solver of the tangent, without prefix.
    """

    relative_tolerance: Annotated[float, at.Gt(0), at.Lt(1)] = 1e-10
    max_iterations: Annotated[int, at.Ge(1)] = 30
    max_cuts: Annotated[int, at.Ge(0), at.Le(50)] = 10
    linear: LinearSolver = "auto"
    compliance: ComplianceKind = "auto"
    linear_options: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        """Check the names of the options."""
        given = {} if self.linear_options is None else self.linear_options
        named = isinstance(given, Mapping) and all(isinstance(name, str) for name in given)
        check_kind_of("linear_options", given, named, "values by name of the option")


@dataclass(frozen=True, kw_only=True)
class SolveReport:
    """How a solve went.

    Attributes:
        iterations: Newton iterations (1 for a linear solve).
        factorizations: Matrices factored on the way.
        residual: Last residual, relative to the largest of the forces in balance.
        counts: Joint points by status, None without joints.
        residuals: The residual at the start and after each iteration of the monolithic solver,
            empty of others, relative to the same.
        solver: Name of the solver, see `StepSolver`.
    """

    iterations: int
    factorizations: int
    residual: float
    counts: StatusCounts | None
    residuals: tuple[float, ...] = ()
    solver: str = ""


class StepSolver(Protocol):
    """Solves A x + B^T (w t(g + B x)) = b for one system.

    Attributes:
        system: The system.
        name: ``linear``, ``monolithic``, ``forms`` or ``condensed``.
        options: Its tolerances and limits.
    """

    system: MatrixSystem
    name: str
    options: SolverOptions

    def solve(
        self,
        effective: MatrixCoefficients,
        b: PETSc.Vec,
        x: PETSc.Vec,
        state: JointState | None,
        rule: Rule = BACKWARD_EULER,
    ) -> tuple[Response | None, SolveReport]:
        """Solve for ``x`` in place; see `NewtonSolver.solve`."""

    def state_dict(self) -> dict[str, Any]:
        """State that later solves depend on beyond their arguments: names to arrays and numbers."""

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Take up what the ``state_dict`` of a solver of the same system gave (collective)."""


def solve_failure(
    internal_forces: InternalForces,
    response: Response,
    state: JointState,
    iteration: int,
    residual: float,
    options: SolverOptions,
) -> ConvergenceError:
    """Exception for an iteration on joints and plastic cells that did not converge (collective)."""
    return ConvergenceError(
        iteration=iteration,
        residual=residual,
        tolerance=options.relative_tolerance,
        **internal_forces.failure(response, state),
    )
