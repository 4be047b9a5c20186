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
        viscous: Work against damping, without absorption [J].
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
    """Length [s], solve and works of a step.

    ``local_error`` is an estimate of the displacement error of this step, 2-norm over all dofs [m].
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
        """Whether tractions and reactions act over a step instead of at its end."""

    def conserves(self, system: MatrixSystem) -> bool:
        """Return True if the energy balance is exact, so that it can be used to check a solve."""

    def advance(
        self, solver: StepSolver, state: DynamicState, dt: float, end: float | None = None
    ) -> tuple[DynamicState, StepReport]:
        """Return the state after a step of length dt [s], and the report (collective).

        The step ends at ``end`` [s]. It may differ from the sum of start and dt by rounding, and
        must be passed if loads jump at that time.

        Raises:
            ConvergenceError: The solve failed; ``state`` is unchanged.
        """
