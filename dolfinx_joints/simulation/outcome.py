# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results of stages: of each step for monitors, and of the stage for the caller."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.laws.law import BACKWARD_EULER, Response
from dolfinx_joints.model.model import Model
from dolfinx_joints.solvers.step_solver import SolveReport
from dolfinx_joints.time_integration.energy import EnergyRow
from dolfinx_joints.time_integration.states import DynamicState
from dolfinx_joints.time_integration.substeps import StepCounts


@dataclass(frozen=True, kw_only=True)
class Record:
    """Step as a monitor sees it.

    Attributes:
        stage: ``dynamic``; static stages are not monitored.
        step: Number of the step, 0 for the start of the stage.
        time: Time [s].
        displacement: u [m].
        velocity: v [m/s].
        reaction: Forces of the supports on the body at constrained dofs, zero elsewhere [N].
        joints: Response of the joints, None without joints.
        motion: Acceleration of the ground at a time [s], [m/s^2], None where it rests.
        solve: How the solve went, None at step 0 of a dynamic stage.
        energy: Energies.
        substeps: Substeps that this step was cut into: 1 for a whole step, 0 at the start.
        wet_joints: Names of the joints with water.
        pressure: Gives the pressure of the water at the local joint points at the time of the
            record, shape (n,), [Pa]; None without water in joints (collective).
        settings: How the stage is run, by name; of the record that monitors start with.
    """

    stage: str
    step: int
    time: float
    displacement: PETSc.Vec
    velocity: PETSc.Vec
    reaction: PETSc.Vec
    joints: Response | None
    motion: Callable[[float], Any] | None
    solve: SolveReport | None
    energy: EnergyRow
    substeps: int
    wet_joints: tuple[str, ...] = ()
    pressure: Callable[[], NDArray[np.float64]] | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)

    @property
    def ground_acceleration(self) -> NDArray[np.float64]:
        """Acceleration of the ground at the time of the record, shape (3,), [m/s^2]."""
        ground = np.zeros(3)
        if self.motion is not None:
            known = np.asarray(self.motion(self.time), dtype=np.float64)[:3]
            ground[: len(known)] = known
        return ground


@dataclass(frozen=True, kw_only=True)
class StaticState:
    """Equilibrium at the end of a static stage.

    Attributes:
        displacement: u [m].
        joints: Response of the joints, None without joints.
        reaction: Forces of the supports on the body, zero at unconstrained dofs [N].
        reports: How the solves went, one per load step.
        joints_inactive: Whether the joints carried nothing: blocks stood alone.
        missing: Loads of the model that did not act.
    """

    displacement: PETSc.Vec
    joints: Response | None
    reaction: PETSc.Vec
    reports: list[SolveReport]
    joints_inactive: bool = False
    missing: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """End of a dynamic stage.

    Attributes:
        state: The last state.
        energy: The last energies.
        energy_error: Largest energy error relative to the largest energy, loss or input.
        imbalance: Largest sum of all energy lines relative to the same, None where the scheme
            loses energy of the body, which has no line.
        local_error: Largest estimated displacement error of a step relative to the largest
            displacement from the static state, 2-norms over all dofs.
        steps: Steps asked for.
        counts: Accepted substeps, more than ``steps`` where steps were cut, and rejected attempts.
        iterations: Newton iterations of all accepted substeps.
        solver: Which solver took the steps, ``linear``, ``condensed`` or ``monolithic``.
        backward_euler_laws: Kinds of laws taken at the end of steps although the scheme asks
            for whole steps, because they know nothing else.
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


def closing_lines(outcome: Outcome, model: Model, seconds: Mapping[str, float]) -> str:
    """Energy error, accuracy, iterations and seconds by phase of a run, as text."""
    phases = ", ".join(f"{name} {value:.1f} s" for name, value in seconds.items())
    counts = outcome.counts
    mean = outcome.iterations / max(counts.accepted, 1)
    balance = "" if outcome.imbalance is None else f", of all lines {outcome.imbalance:.1e}"
    rejected = f", {counts.rejected} attempts rejected" if counts.rejected else ""
    return (
        f"energy error {100 * outcome.energy_error:.3g} % of the largest energy{balance}; "
        f"largest local displacement error {100 * outcome.local_error:.3g} % of the largest "
        f"displacement\n{outcome.steps} steps in {counts.accepted} substeps{rejected}; "
        f"{mean:.2f} Newton iterations per substep, {_solver(outcome, model)}\n{phases}"
    )


def _solver(outcome: Outcome, model: Model) -> str:
    """The solver of a run, and which laws left no choice."""
    missing = () if model.contact is None else model.contact.not_condensed(BACKWARD_EULER)
    text = f"{outcome.solver} solver"
    if outcome.solver == "monolithic" and missing:
        text += f" (no condensed form in {', '.join(missing)})"
    if model.bulk is not None:
        text += f" (plastic cells of {', '.join(model.bulk.kinds)})"
    if outcome.backward_euler_laws:
        text += f", backward Euler in {', '.join(outcome.backward_euler_laws)}"
    return text
