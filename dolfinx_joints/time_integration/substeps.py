# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps of a given length, cut where their solve fails or is not accurate enough."""

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

# Of the ledger's scale: what rounding and the solver's tolerance may leave in a step.
LARGEST_IMBALANCE = 1e-10


@dataclass(frozen=True, kw_only=True)
@checked
class StepControl:
    """Rules by which a step of length dt is cut, down to dt / 2^max_halvings.

    A step is always cut where its solve fails, and where its energy lines do not add up although
    the scheme's do (then the solve is wrong). It is cut for accuracy as well where asked; at the
    shortest length it is accepted whatever the accuracy.

    Attributes:
        max_halvings: Halvings allowed.
        tolerance: Largest local error of a step relative to the largest displacement so far, static
            part included (2-norms over all dofs); None for no such control. Once a joint chatters
            (`joints.chatter`) steps are no longer cut for it: shorter ones chatter more.
        landing: Cut steps in which a joint point opens or closes, so that such steps are short.
            Meant for few points: where many change all the time, every step is short.
    """

    max_halvings: Annotated[int, at.Ge(0), at.Le(30)] = 6
    tolerance: Annotated[float, at.Gt(0), at.Lt(1)] | None = None
    landing: bool = False


@dataclass(kw_only=True)
class StepCounts:
    """Accepted substeps and attempts rejected for one reason each.

    Attributes:
        landed: Accepted substeps of the shortest length in which a point opened or closed.
        unbalanced: Attempts whose energy lines did not add up.
        inaccurate: Attempts with too large a local error.
        held: Attempts with too large a local error that were not cut, as joints chatter.
        crossed: Attempts in which a point opened or closed.
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
        """Rejected attempts."""
        return self.failed + self.unbalanced + self.inaccurate + self.crossed


class Stepper:
    """Takes steps of a given length, in substeps where need be.

    Substeps stay on the levels dt / 2^k, so that few matrices are factored. The ledger must have
    been started.

    Attributes:
        counts: Accepted substeps and rejected attempts.
        chatter: Which joints chatter.
    """

    def __init__(
        self, scheme: Scheme, solver: StepSolver, ledger: EnergyLedger, control: StepControl
    ) -> None:
        """Keep the parts; no step is taken."""
        self.scheme, self.solver, self.ledger = scheme, solver, ledger
        self.forces_over_steps = scheme.forces_over_steps
        self._control, self.counts = control, StepCounts()
        self._tolerance = control.tolerance or 0.0
        self.chatter, self._holds = Chatter(solver.system.contact), False
        self._largest = 0.0
        self._level = 0

    def substeps(
        self, state: DynamicState, dt: float, end: float | None = None
    ) -> Iterator[tuple[DynamicState, StepReport, EnergyRow]]:
        """Accepted substeps from ``state`` over dt [s] with their energies (collective).

        The last one ends at ``end`` [s]; the sum of both times unless given.
        """
        if self._tolerance and not self._holds:
            self._holds = bool(self.chatter.joints())
        finest = 2**self._control.max_halvings
        end = state.time + dt if end is None else end
        done = 0  # counts substeps of the shortest length
        while done < finest:
            length = finest >> self._level
            shortest, part = length == 1, dt * length / finest
            # A time has the same bits in all substeps that meet there: loads may jump at it.
            there = end if done + length == finest else state.time + part
            try:
                after, report = self._attempt(state, part, there)
            except ConvergenceError as failure:
                self.counts.failed += 1
                if shortest:
                    raise located(failure, time=there) from None
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
            if self._level and done % (finest >> (self._level - 1)) == 0 and self._calm(report):
                self._level -= 1

    def _attempt(
        self, state: DynamicState, dt: float, end: float
    ) -> tuple[DynamicState, StepReport]:
        """A step of the scheme, under the water that the state at its start leads to."""
        water = self.solver.system.water
        if water is None or state.joints is None or state.water is None:
            return self.scheme.advance(self.solver, state, dt, end)
        water.begin_step(state.water, state.joints.state.gap)
        after, report = self.scheme.advance(self.solver, state, dt, end)
        return replace(after, water=water.codes), report

    def state_dict(self) -> dict[str, Any]:
        """State that later steps depend on."""
        return {
            "largest": self._largest,
            "level": self._level,
            "chatter": self.chatter.state_dict(),
            "counts": asdict(self.counts),
        }

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Take up what another's ``state_dict`` gave."""
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
        """Whether an attempt is rejected (collective)."""
        if self.scheme.conserves(self.solver.system):
            scale = max(self.ledger.scale, row.stored, abs(row.input))
            missing = abs(row.body_imbalance - self.ledger.row.body_imbalance)
            allowed = LARGEST_IMBALANCE * scale
            if missing > allowed > 0.0 and missing > self._rounding(before, after):
                self.counts.unbalanced += 1
                if shortest:
                    raise _imbalance(self.solver.system, before, after, missing / scale)
                return True
        if not shortest and self._too_rough(after, report):
            self.counts.held += self._holds
            self.counts.inaccurate += not self._holds
            if not self._holds:
                return True
        if self._control.landing and _changes(self.solver.system, before, after):
            self.counts.landed += shortest
            self.counts.crossed += not shortest
            return not shortest
        return False

    def _rounding(self, before: DynamicState, after: DynamicState) -> float:
        """What rounding of K u may leave of a step's energies [J] (collective).

        In a body that moves far with little strain it is a difference of large forces.
        """
        size = self.solver.system.stiffness.getDiagonal()
        way = after.displacement - before.displacement
        for factor in (after.displacement, way):
            size.pointwiseMult(size, factor)
        return float(np.finfo(float).eps * size.norm(PETSc.NormType.NORM_1))

    def _too_rough(self, after: DynamicState, report: StepReport) -> bool:
        """Whether the local error is above the tolerance, this attempt's displacement included."""
        if not self._tolerance:
            return False
        moved = self.solver.system.norm(after.displacement)
        return report.local_error > self._tolerance * max(self._largest, moved)

    def _calm(self, report: StepReport) -> bool:
        """Whether a substep of twice the length would do: the local error grows with its cube."""
        tolerance = 0.0 if self._holds else self._tolerance
        return not tolerance or 8.0 * report.local_error <= tolerance * self._largest

    def _accept(self, state: DynamicState, report: StepReport, dt: float) -> None:
        self.counts.accepted += 1
        if state.joints is not None:
            self.chatter.record(state.joints, report.dt, dt)
        if self._tolerance:
            moved = self.solver.system.norm(state.displacement)
            self._largest = max(self._largest, moved)


def ends_of_steps(start: float, dt: float, steps: int) -> NDArray[np.float64]:
    """Times from ``start`` at equal steps [s], shape (steps + 1,), to 15 digits.

    So that they read 4.5 and not 4.499999999999926, as sums of steps do.
    """
    return np.array([float(f"{start + dt * step:.15g}") for step in range(steps + 1)])


def _imbalance(
    system: MatrixSystem, before: DynamicState, after: DynamicState, missing: float
) -> JointsError:
    """Return the error of a step that lacks a share of the largest energy (collective)."""
    contact, where, stiff = system.contact, "", ""
    if contact is not None and before.joints is not None and after.joints is not None:
        change = after.joints.state.gap - before.joints.state.gap
        work = np.einsum("ij,ij->i", np.abs(after.joints.traction), np.abs(change))
        worst = contact.worst_joint(work)
        where = f" (joint {worst!r} did the largest work)" if worst else ""
        stiff = ", as for joints very much stiffer than the body"
    return JointsError(
        f"The energy lines of the step to t = {after.time:.6g} s do not add up{where}: "
        f"{missing:.1e} of the largest energy is missing, {LARGEST_IMBALANCE:g} is allowed; the "
        f"solve is not accurate enough{stiff}."
    )


def _changes(system: MatrixSystem, before: DynamicState, after: DynamicState) -> bool:
    """Whether a joint point opens or closes in a step (collective)."""
    if system.contact is None or before.joints is None or after.joints is None:
        return False
    was, now = before.joints.state.gap[:, 0] > 0.0, after.joints.state.gap[:, 0] > 0.0
    return max(system.contact.operator.comm.allgather(bool(np.any(was != now))))


def located(failure: ConvergenceError, **where: Any) -> ConvergenceError:
    """Return the same failure with stage, step or time filled in."""
    known = {name: value for name, value in vars(failure).items() if not name.startswith("_")}
    return type(failure)(**{**known, **where})
