# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps of a given length, divided into substeps if the solve fails or is not accurate enough."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Annotated, Any

import annotated_types as at
import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ConvergenceError, JointsError
from dolfinx_joints.joints.chatter import Chatter
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.step_solver import StepSolver
from dolfinx_joints.time_integration.energy import EnergyLedger, EnergyRow
from dolfinx_joints.time_integration.scheme import Scheme, StepReport
from dolfinx_joints.time_integration.states import DynamicState

# Largest energy imbalance of an accurately solved step, divided by the ledger's ``scale``.
LARGEST_IMBALANCE = 1e-10


@dataclass(frozen=True, kw_only=True)
@checked
class StepControl:
    """Rules for dividing a step of length dt into substeps, the shortest dt / 2^max_halvings.

    A step is halved if its solve fails. With a scheme that conserves energy, a step is also halved
    if its energy balance does not close: the solve is then inaccurate. With ``tolerance`` steps are
    also halved for accuracy; a substep of the shortest length is accepted at any error.

    Attributes:
        max_halvings: Largest number of halvings.
        tolerance: Largest error of a single step relative to the largest displacement so far,
            static displacement included (2-norms over dofs); None to disable. Once a joint chatters
            (`joints.chatter`), the tolerance is ignored: shorter steps increase chatter.
        landing: Halve steps in which a joint point opens or closes, so that such steps are short.
            Use it for few points: if many points open and close, all steps become short.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.Joints(dj.frictionless(normal_stiffness=1e9), initial_gaps={"joint_1": 0.001})
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=[dj.Fixed(group="base")])
        >>> up = lambda t: (0.0, 0.0, 10.0)  # the ground hits the upper block [m/s^2]
        >>> control = dj.StepControl(landing=True)
        >>> outcome = dj.Simulation(model).dynamics(dt=0.001, steps=20, motion=up, control=control)
        >>> outcome.counts.accepted > outcome.steps  # steps that close the joint are cut
        True
    """

    max_halvings: Annotated[int, at.Ge(0), at.Le(30)] = 6
    tolerance: Annotated[float, at.Gt(0), at.Lt(1)] | None = None
    landing: bool = False


@dataclass(kw_only=True)
class StepCounts:
    """Number of accepted substeps, and of rejected attempts by reason.

    Attributes:
        landed: Accepted substeps of the shortest length in which a point opened or closed.
        unbalanced: Attempts rejected because of their energy imbalance.
        inaccurate: Attempts rejected because of their error.
        held: Attempts that were accepted in spite of their error, because joints chatter.
        crossed: Attempts rejected because a point opened or closed.
    """

    accepted: int = 0
    landed: int = 0
    failed: int = 0
    unbalanced: int = 0
    inaccurate: int = 0
    crossed: int = 0
    held: int = 0

    @property
    def rejected(self) -> int:
        """Number of rejected attempts."""
        return self.failed + self.unbalanced + self.inaccurate + self.crossed


class Stepper:
    """Computes steps of a given length, in substeps if necessary.

    The substep lengths are dt / 2^k only, so that few matrices are factored. Start the ledger
    before the first step.

    Attributes:
        counts: Accepted substeps and rejected attempts.
        chatter: Detection of chattering joints.
    """

    def __init__(
        self, scheme: Scheme, solver: StepSolver, ledger: EnergyLedger, control: StepControl
    ) -> None:
        """Store the arguments; no step is computed."""
        self.scheme, self.solver, self.ledger = scheme, solver, ledger
        self.forces_over_steps = scheme.forces_over_steps
        self._control, self.counts = control, StepCounts()
        self._tolerance = control.tolerance or 0.0
        self.chatter, self._ignores_tolerance = Chatter(solver.system.contact), False
        self._largest = 0.0
        self._level = 0

    def substeps(
        self, state: DynamicState, dt: float, end: float | None = None
    ) -> Iterator[tuple[DynamicState, StepReport, EnergyRow]]:
        """Yield the accepted substeps of a step from ``state`` with energies (collective).

        The step has the length dt [s] and ends at ``end`` [s], by default ``state.time`` plus dt.
        """
        if self._tolerance and not self._ignores_tolerance:
            self._ignores_tolerance = bool(self.chatter.joints())
        finest = 2**self._control.max_halvings
        end = state.time + dt if end is None else end
        done = 0  # completed part of the step, in units of the shortest substep
        while done < finest:
            length = finest >> self._level
            shortest, substep = length == 1, dt * length / finest
            # End the last substep exactly at ``end``, without rounding: loads may jump there.
            substep_end = end if done + length == finest else state.time + substep
            try:
                after, report = self._attempt(state, substep, substep_end)
            except ConvergenceError as failure:
                self.counts.failed += 1
                if shortest:
                    raise locate(failure, time=substep_end) from None
                self._level += 1
                continue
            row = self.ledger.after(after, report)
            if self._rejects(state, after, report, row, shortest=shortest):
                self._level += 1
                continue
            done += length
            state = after
            self._accept(state, report, dt)
            yield state, report, row
            if self._level and done % (finest >> (self._level - 1)) == 0 and self._can_grow(report):
                self._level -= 1

    def _attempt(
        self, state: DynamicState, dt: float, end: float
    ) -> tuple[DynamicState, StepReport]:
        """Compute a step, with joint water that follows from the state at the start."""
        water = self.solver.system.water
        if water is None or state.joints is None or state.water is None:
            return self.scheme.advance(self.solver, state, dt, end)
        water.begin_step(state.water, state.joints.state.gap)
        after, report = self.scheme.advance(self.solver, state, dt, end)
        return replace(after, water=water.codes), report

    def state_dict(self) -> dict[str, Any]:
        """Return the state that later steps depend on, for a restart."""
        return {
            "largest": self._largest,
            "level": self._level,
            "chatter": self.chatter.state_dict(),
            "counts": asdict(self.counts),
        }

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Restore the state from ``state_dict``."""
        self._largest, self._level = state_dict["largest"], state_dict["level"]
        self.chatter.load_state_dict(state_dict["chatter"])
        self.counts = StepCounts(**state_dict["counts"])

    def _rejects(
        self,
        before: DynamicState,
        after: DynamicState,
        report: StepReport,
        row: EnergyRow,
        *,
        shortest: bool,
    ) -> bool:
        """Return True if the attempt must be repeated in shorter substeps (collective)."""
        if self.scheme.conserves(self.solver.system):
            scale = max(self.ledger.scale, row.stored, abs(row.input))
            missing = abs(row.body_imbalance - self.ledger.row.body_imbalance)
            allowed = LARGEST_IMBALANCE * scale
            if missing > allowed > 0.0 and missing > self._rounding_error(before, after):
                self.counts.unbalanced += 1
                if shortest:
                    raise _balance_error(self.solver.system, before, after, missing / scale)
                return True
        if not shortest and self._exceeds_tolerance(after, report):
            self.counts.held += self._ignores_tolerance
            self.counts.inaccurate += not self._ignores_tolerance
            if not self._ignores_tolerance:
                return True
        if self._control.landing and _contact_changes(self.solver.system, before, after):
            self.counts.landed += shortest
            self.counts.crossed += not shortest
            return not shortest
        return False

    def _rounding_error(self, before: DynamicState, after: DynamicState) -> float:
        """Return the rounding error of K u in the energies of a step [J] (collective).

        If a body moves far with small strain, K u is a small difference of large forces.
        """
        size = self.solver.system.stiffness.getDiagonal()
        increment = after.displacement - before.displacement
        for factor in (after.displacement, increment):
            size.pointwiseMult(size, factor)
        return float(np.finfo(float).eps * size.norm(PETSc.NormType.NORM_1))

    def _exceeds_tolerance(self, after: DynamicState, report: StepReport) -> bool:
        """Return True if the local error exceeds the tolerance times the largest displacement."""
        if not self._tolerance:
            return False
        displacement = self.solver.system.norm(after.displacement)
        return report.local_error > self._tolerance * max(self._largest, displacement)

    def _can_grow(self, report: StepReport) -> bool:
        """Return True if a substep of twice the length, with 8 times the error, is accurate."""
        tolerance = 0.0 if self._ignores_tolerance else self._tolerance
        return not tolerance or 8.0 * report.local_error <= tolerance * self._largest

    def _accept(self, state: DynamicState, report: StepReport, dt: float) -> None:
        self.counts.accepted += 1
        if state.joints is not None:
            self.chatter.record(state.joints, report.dt, dt)
        if self._tolerance:
            displacement = self.solver.system.norm(state.displacement)
            self._largest = max(self._largest, displacement)


def ends_of_steps(start: float, dt: float, steps: int) -> NDArray[np.float64]:
    """Return start and end times of equal steps [s], shape (steps + 1,), rounded to 15 digits.

    Adding up the steps would give 4.499999999999926 instead of 4.5.
    """
    return np.array([float(f"{start + dt * step:.15g}") for step in range(steps + 1)])


def _balance_error(
    system: MatrixSystem, before: DynamicState, after: DynamicState, missing: float
) -> JointsError:
    """Return the error for a step whose energy balance does not close (collective)."""
    contact, where, stiff = system.contact, "", ""
    if contact is not None and before.joints is not None and after.joints is not None:
        change = after.joints.state.gap - before.joints.state.gap
        work = np.einsum("ij,ij->i", np.abs(after.joints.traction), np.abs(change))
        worst = contact.worst_joint(work)
        where = f" (joint {worst!r} has the largest |traction| |gap change|)" if worst else ""
        stiff = ", for example because joints are much stiffer than the body: use softer joints"
    return JointsError(
        f"The energy balance of the step to t = {after.time:.6g} s does not close{where}: the "
        f"imbalance is {missing:.1e} of the largest energy; the limit is {LARGEST_IMBALANCE:g}. "
        f"The solve is not accurate enough{stiff}. Try a smaller SolverOptions(relative_tolerance)."
    )


def _contact_changes(system: MatrixSystem, before: DynamicState, after: DynamicState) -> bool:
    """Return True if a joint point opens or closes in a step (collective)."""
    if system.contact is None or before.joints is None or after.joints is None:
        return False
    was_open, is_open = before.joints.state.gap[:, 0] > 0.0, after.joints.state.gap[:, 0] > 0.0
    return max(system.contact.operator.comm.allgather(bool(np.any(was_open != is_open))))


def locate(failure: ConvergenceError, **where: Any) -> ConvergenceError:
    """Return a copy of the failure with stage, step or time filled in."""
    values = {name: value for name, value in vars(failure).items() if not name.startswith("_")}
    return type(failure)(**{**values, **where})
