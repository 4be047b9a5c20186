# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interface of the time schemes: protocol and step report."""

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
    """Works of a step, evaluated as in the energy balance of the scheme.

    Attributes:
        loads: Work of each load by name [J].
        supports: Work of moving supports [J].
        viscous: Work against damping, without absorbing boundaries [J].
        absorbed: Work against the dashpots of absorbing boundaries, of rock and water [J].
        joints: Work of the body on each joint, and the losses of the joints [J].
    """

    loads: Mapping[str, float]
    supports: float
    viscous: float
    joints: JointWorks
    absorbed: float = 0.0


@dataclass(frozen=True, kw_only=True)
class StepReport:
    """Report of a step: length dt [s], report of the solve, and works.

    ``local_error`` estimates the displacement error of this step (33), 2-norm over all dofs [m].
    """

    dt: float
    solve: SolveReport
    work: StepWork
    local_error: float


class Scheme(Protocol):
    """Time scheme: its parameters, and the computation of one step."""

    @property
    def rule(self) -> Rule:
        """Rule by which the joint laws are evaluated."""

    @property
    def forces_over_steps(self) -> bool:
        """True if tractions and reactions act over a whole step, False if at its end."""

    def conserves(self, system: MatrixSystem) -> bool:
        """Return True if the energy balance is exact: an imbalance then shows a wrong solve."""

    def advance(
        self, solver: StepSolver, state: DynamicState, dt: float, end: float | None = None
    ) -> tuple[DynamicState, StepReport]:
        """Return the state after a step of length dt [s], and the report (collective).

        ``end`` [s] is the start time plus dt except for rounding. Pass this value if loads jump at
        the end of the step.

        Raises:
            ConvergenceError: The solve failed; ``state`` is unchanged.
        """
