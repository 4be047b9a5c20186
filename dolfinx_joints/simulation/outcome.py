# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results of stages, as returned to the caller."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from petsc4py import PETSc

from dolfinx_joints.common.summary import Rows, Summarised, names, number
from dolfinx_joints.laws.law import Response, StatusCounts
from dolfinx_joints.model.model import Model
from dolfinx_joints.simulation.static_energy import Jump, StaticEnergy
from dolfinx_joints.solvers.step_solver import SolveReport
from dolfinx_joints.time_integration.energy import EnergyRow
from dolfinx_joints.time_integration.states import DynamicState
from dolfinx_joints.time_integration.substeps import StepCounts


def shares(counts: StatusCounts) -> str:
    """Return percentages of open, sticking and sliding points, and the tied points, as text."""
    total = max(counts.total, 1)
    parts = [(counts.open, "open"), (counts.stick, "sticking"), (counts.slip, "sliding")]
    if counts.frictionless:
        parts.append((counts.frictionless, "closed without friction"))
    words = ", ".join(f"{100 * n / total:.1f} % {status}" for n, status in parts)
    tied = f"; {number(counts.tied)} more tied" if counts.tied else ""
    return f"{number(counts.total)}: {words}{tied}"


def jump_text(jump: Jump) -> str:
    """Return joints, energy and load factors of a jump as text."""
    where = ", ".join(jump.joints) or "many joints"
    at = "" if jump.time is None else f" at t = {jump.time:g} s"
    return (
        f"{jump.energy:.4g} J released in {where} between the load factors {jump.start:.4g} and "
        f"{jump.end:.4g} of step {jump.step}{at}"
    )


@dataclass(frozen=True, kw_only=True, repr=False)
class StaticState(Summarised):
    """Equilibrium at the end of a static stage.

    Attributes:
        displacement: u [m].
        joints: Response of the joints, None without joints.
        reaction: Forces of the supports on the body, zero at unconstrained dofs [N].
        reports: Solver reports, one per load step, or more if steps were divided.
        energy: Energies, works and losses from the unloaded body to this state.
        loads: Loads by name [N]; empty in the records of earlier stages.
        inactive: Names of the joints without tractions, because they have not been grouted yet.
        absent: Cell groups of the absent blocks.
        missing: Names, as in the energy ledger, of loads of the model that did not act.
        cuts: Number of times that a load increment was halved.
        jumps: Jumps of the stage that ``allow_jumps`` accepted.
        time: Time of the last loads that varied in time [s], the start of the next.
        load_factor: Factor of the controlled loads, None except after `controlled_statics`.
        controlled: Value of the controlled quantity [m], None except after `controlled_statics`.
    """

    displacement: PETSc.Vec
    joints: Response | None
    reaction: PETSc.Vec
    reports: list[SolveReport]
    energy: StaticEnergy
    loads: Mapping[str, PETSc.Vec]
    inactive: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    cuts: int = 0
    jumps: list[Jump] = field(default_factory=list)
    time: float = 0.0
    load_factor: float | None = None
    controlled: float | None = None

    @property
    def unloaded(self) -> bool:
        """True if no load step has been solved: the body is at rest without loads."""
        return not self.reports

    def _summary(self) -> Rows:
        solve = self.reports[-1] if self.reports else None
        yield "solves", f"{len(self.reports)}, {sum(r.iterations for r in self.reports)} iterations"
        yield "solver", solve.solver if solve else ""
        yield "joint points", "" if solve is None or solve.counts is None else shares(solve.counts)
        yield "inactive joints", names(self.inactive)
        yield "absent blocks", names(self.absent)
        yield "load increments halved", f"{self.cuts} times" if self.cuts else ""
        balance = 100 * self.energy.relative_error
        yield "energy imbalance", f"{balance:.2g} % of the largest energy"
        yield "jumps", names(map(jump_text, self.jumps))
        if self.load_factor is not None:
            yield "load factor", f"{self.load_factor:.4g} at {self.controlled:.4g} m"


@dataclass(frozen=True, kw_only=True, repr=False)
class Outcome(Summarised):
    """Result of a dynamic stage.

    Attributes:
        state: The last state.
        energy: The last energies.
        energy_error: Largest energy error relative to the largest energy, loss or input.
        imbalance: Largest energy imbalance, with numerical losses, divided by the largest energy;
            None if the scheme loses energy of the body, which the ledger does not count.
        local_error: Largest estimated displacement error of a single step, not of the run, divided
            by the largest displacement from the start of the stage, 2-norms over all dofs.
        steps: Number of steps requested.
        counts: Accepted substeps, more than ``steps`` if steps were divided, and rejected attempts.
        iterations: Newton iterations of all accepted substeps.
        solver: Solver of the steps, ``linear``, ``condensed``, ``monolithic`` or ``forms``.
        backward_euler_laws: Kinds of laws that an energy-consistent scheme evaluates at the end of
            steps, because these laws have no discrete gradient.
        chatter: Joints whose points open and close every few steps, with the fraction of the normal
            impulse in these contacts.
        laws_without_losses: Kinds of laws without a formula for their numerical loss
            (`LawWithLosses`); ``imbalance`` does not check joints with these laws.
    """

    state: DynamicState
    energy: EnergyRow
    energy_error: float
    imbalance: float | None
    local_error: float
    steps: int
    counts: StepCounts
    iterations: int
    solver: str
    backward_euler_laws: tuple[str, ...]
    chatter: Mapping[str, float]
    laws_without_losses: tuple[str, ...]

    def _summary(self) -> Rows:
        counts, imbalance = self.counts, self.imbalance
        yield "end", f"{self.state.time:g} s, {number(self.steps)} steps"
        yield "substeps", f"{number(counts.accepted)}, {counts.rejected} attempts rejected"
        yield "solver", f"{self.solver}, {number(self.iterations)} iterations"
        yield "energy error", f"{100 * self.energy_error:.3g} % of the largest energy"
        balance = "" if imbalance is None else f"{100 * imbalance:.2g} % of the largest energy"
        yield "energy imbalance", balance
        yield (
            "error of a single step",
            f"{100 * self.local_error:.3g} % of the largest displacement",
        )
        yield "joints that chatter", names(self.chatter)


def closing_lines(outcome: Outcome, model: Model, seconds: Mapping[str, float]) -> str:
    """Return energy error, accuracy, iterations and seconds by phase of a run, as text."""
    phases = ", ".join(f"{name} {value:.1f} s" for name, value in seconds.items())
    counts = outcome.counts
    mean = outcome.iterations / max(counts.accepted, 1)
    balance = (
        "" if outcome.imbalance is None else f" ({100 * outcome.imbalance:.1e} % with all losses)"
    )
    if balance and outcome.laws_without_losses:
        balance = f"{balance[:-1]} except in joints of {', '.join(outcome.laws_without_losses)})"
    rejected = f", {counts.rejected} attempts rejected" if counts.rejected else ""
    return (
        f"energy error {100 * outcome.energy_error:.3g} % of the largest energy{balance}; "
        f"largest error of a single step {100 * outcome.local_error:.3g} % of the largest "
        f"displacement (for the error of the run: dj.accuracy)\n"
        f"{outcome.steps} steps in {counts.accepted} substeps{rejected}; "
        f"{mean:.2f} Newton iterations per substep, {_solver(outcome, model)}\n{phases}"
    )


def _solver(outcome: Outcome, model: Model) -> str:
    """Return the name of the solver, with nonlinear cells and laws that use backward Euler."""
    text = f"{outcome.solver} solver"
    if model.bulk is not None:
        text += f" (nonlinear cells of {', '.join(model.bulk.kinds)})"
    if outcome.backward_euler_laws:
        text += f", backward Euler in {', '.join(outcome.backward_euler_laws)}"
    return text
