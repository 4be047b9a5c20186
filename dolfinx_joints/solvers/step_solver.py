# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interface of the solvers of a step: options, report, protocol and failure."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from petsc4py import PETSc

from dolfinx_joints.common.errors import ConvergenceError
from dolfinx_joints.common.parameters import (
    check_choice,
    check_count,
    check_kind_of,
    check_number,
    hold_floats,
)
from dolfinx_joints.joints.contact import Rule, StatusCounts
from dolfinx_joints.joints.internal_forces import InternalForces
from dolfinx_joints.laws.law import JointState, Response
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.effective_matrix import (
    LINEAR,
    MatrixCoefficients,
)

# What may be kept of the compliance at the joints.
COMPLIANCES = ("auto", "dense", "compressed", "matrix-free")

# Half as often, and nothing is left of a correction.
MOST_CUTS = 50


@dataclass(frozen=True, kw_only=True)
class SolverOptions:
    """When Newton stops, and what it may do on its way.

    Attributes:
        relative_tolerance: Residual against the largest of the forces that change in the step.
        max_iterations: Iterations before the solve is given up.
        max_cuts: Halvings of a Newton correction that the line search may try.
        linear: Solver of the bulk, ``direct``, ``mumps`` (direct, without CHOLMOD), ``iterative``,
            or ``auto``: direct where its factor is expected to fit into memory.
        compliance: What the condensed solver keeps of the compliance at the joints, see
            `Compliance`.
        linear_options: PETSc options of the direct solver of the tangent, without prefix.

    Raises:
        ValueError: A value is out of its range.
    """

    relative_tolerance: float = 1e-10
    max_iterations: int = 30
    max_cuts: int = 10
    linear: str = "auto"
    compliance: str = "auto"
    linear_options: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        """Check the values."""
        hold_floats(self)
        check_number(
            "relative_tolerance",
            self.relative_tolerance,
            lambda v: 0 < v < 1,
            "above 0 and below 1",
        )
        wanted = "it must be a whole number of at least"
        check_count("max_iterations", self.max_iterations, 1, f"{wanted} 1")
        for name, known in (("linear", LINEAR), ("compliance", COMPLIANCES)):
            check_choice(name, getattr(self, name), known)
        check_count("max_cuts", self.max_cuts, 0, f"{wanted} 0", most=MOST_CUTS)
        options = {} if self.linear_options is None else self.linear_options
        named = isinstance(options, Mapping) and all(map(_is_option, options.items()))
        check_kind_of("linear_options", options, named, "texts and numbers by name of the option")


def _is_option(named: tuple[Any, Any]) -> bool:
    """Whether PETSc can be told a name and a value."""
    name, value = named
    good = isinstance(name, str) and re.fullmatch(r"[a-z]\w*", name, re.ASCII) is not None
    words = not isinstance(value, str) or (value.isascii() and value.isprintable())
    return good and words and isinstance(value, str | int | float | None)


@dataclass(frozen=True, kw_only=True)
class SolveReport:
    """How a solve went.

    Attributes:
        iterations: Newton iterations (1 for a linear solve).
        factorizations: Matrices factored on the way.
        residual: Last residual, relative to the largest of the forces in balance.
        counts: Joint points by status, None without joints.
    """

    iterations: int
    factorizations: int
    residual: float
    counts: StatusCounts | None


class StepSolver(Protocol):
    """Solves A x + B^T (w t(g + B x)) = b for one system.

    Attributes:
        system: The system.
        name: ``linear``, ``monolithic`` or ``condensed``.
    """

    system: MatrixSystem
    name: str

    def solve(
        self,
        effective: MatrixCoefficients,
        b: PETSc.Vec,
        x: PETSc.Vec,
        state: JointState | None,
        rule: Rule = "backward_euler",
    ) -> tuple[Response | None, SolveReport]:
        """Solve for ``x`` in place; see `NewtonSolver.solve`."""

    def state_dict(self) -> dict[str, Any]:
        """What later solves depend on beyond their arguments: names to arrays and numbers."""

    def load_state_dict(self, memory: Mapping[str, Any]) -> None:
        """Take up what the ``state_dict`` of a solver of the same system gave (collective)."""


def solve_failure(
    internal_forces: InternalForces,
    response: Response,
    state: JointState,
    iteration: int,
    residual: float,
    options: SolverOptions,
) -> ConvergenceError:
    """What to raise when an iteration on joints and plastic cells did not converge (collective)."""
    return ConvergenceError(
        iteration=iteration,
        residual=residual,
        tolerance=options.relative_tolerance,
        **internal_forces.failure(response, state),
    )
