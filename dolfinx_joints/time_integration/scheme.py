# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interface of the time schemes: protocol and report of a step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from dolfinx_joints.laws.law import Rule
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.step_solver import SolveReport, StepSolver
from dolfinx_joints.time_integration.products import JointWorks
from dolfinx_joints.time_integration.states import DynamicState


@dataclass(frozen=True, kw_only=True)
class StepWork:
    """Works of a step as the scheme itself balances them.

    Attributes:
        loads: Of each load by name [J].
        supports: Of moving supports [J].
        viscous: Against the damping, absorption apart [J].
        absorbed: Against the dashpots that take waves out, of rock and water [J].
        joints: Of the body on each joint, and what of it is lost [J].
    """

    loads: Mapping[str, float]
    supports: float
    viscous: float
    joints: JointWorks
    absorbed: float = 0.0


@dataclass(frozen=True, kw_only=True)
class StepReport:
    """Length [s], solve and works of a step.

    ``local_error`` estimates the displacement error made in it, 2-norm over all dofs [m].
    """

    dt: float
    solve: SolveReport
    work: StepWork
    local_error: float


class Scheme(Protocol):
    """A time scheme: parameters, and one step."""

    @property
    def rule(self) -> Rule:
        """Response that it asks the laws for."""

    @property
    def forces_over_steps(self) -> bool:
        """Whether tractions and reactions are those that act over a step, not those at its end."""

    def conserves(self, system: MatrixSystem) -> bool:
        """Whether its balance is exact for a system, so that a solve may be judged by it."""

    def advance(
        self, solver: StepSolver, state: DynamicState, dt: float, end: float | None = None
    ) -> tuple[DynamicState, StepReport]:
        """The state a step of length dt [s] later (collective).

        It ends at ``end`` [s], which is the sum of its start and dt but for rounding: loads may
        jump there.

        Raises:
            ConvergenceError: The solve failed; ``state`` is as it was.
        """
