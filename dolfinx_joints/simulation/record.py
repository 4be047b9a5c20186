# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Data that monitors receive of each static stage and of each dynamic step."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.laws.law import Response
from dolfinx_joints.loads.load import JointLoad, Load
from dolfinx_joints.model.model import Model
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.solvers.step_solver import SolveReport
from dolfinx_joints.time_integration.energy import EnergyRow


@dataclass(frozen=True, kw_only=True, eq=False)
class StageRecord:
    """Result of a static stage, as passed to monitors.

    Attributes:
        name: Name of the stage.
        time: Time at which loads and prescribed displacements are evaluated [s].
        state: Equilibrium, with displacements from the unloaded body.
        loads: Indices in ``Model.loads`` of the acting loads.
        pressure: Water pressure at the local joint points, shape (n,), [Pa]; None without water.
    """

    name: str
    time: float
    state: StaticState
    loads: tuple[int, ...]
    pressure: NDArray[np.float64] | None


@dataclass(frozen=True, kw_only=True)
class Record:
    """Step of a dynamic stage, as passed to monitors.

    Attributes:
        stage: ``dynamic``; static stages have a `StageRecord` instead.
        step: Number of the step, 0 for the start of the stage.
        time: Time [s].
        displacement: Nodal displacements u [m].
        velocity: Nodal velocities v [m/s].
        reaction: Forces of the supports on the body, zero at unconstrained dofs [N].
        joints: Response of the joints, None without joints.
        motion: Ground acceleration [m/s^2] as a function of time [s], None if the ground is fixed.
        free_surface: Velocity of a level free surface due to all `FreeField` waves, as a function
            of time [s], (3,), [m/s]; displacements are then absolute. None without such waves.
        solve: Report of the solver, None at step 0 of a dynamic stage.
        energy: Energies, works and losses.
        substeps: Number of substeps of this step: 1 for an undivided step, 0 at the start.
        static_part: Function of time [s] that returns the static part of the displacement [m]
            (collective), see `DifferingGround`; None if the ground motion is uniform.
        reservoir_force: Force of reservoir waves on the face, (gdim,), [N]; None without waves.
        reservoir_pressure: Function that returns the pressure of reservoir waves at this rank's
            unknowns of the water, shape (n,), [Pa]; None without waves.
        wet_joints: Names of the joints with water.
        pressure: Function that returns the water pressure at the local joint points at the time of
            the record, shape (n,), [Pa] (collective); None without water in joints.
        settings: Settings of the run by name, only in the record at the start.
        stages: Previous static stages, only in the record at the start.
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
    free_surface: Callable[[float], NDArray[np.float64]] | None = None
    static_part: Callable[[float], PETSc.Vec] | None = None
    reservoir_force: NDArray[np.float64] | None = None
    reservoir_pressure: Callable[[], NDArray[np.float64]] | None = None
    wet_joints: tuple[str, ...] = ()
    pressure: Callable[[], NDArray[np.float64]] | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    stages: Sequence[StageRecord] = ()

    @property
    def ground_acceleration(self) -> NDArray[np.float64]:
        """Acceleration of the ground at the time of the record, shape (3,), [m/s^2]."""
        ground = np.zeros(3)
        if self.motion is not None:
            acceleration = np.asarray(self.motion(self.time), dtype=np.float64)[:3]
            ground[: len(acceleration)] = acceleration
        return ground


def stage_record(
    model: Model,
    name: str,
    time: float,
    state: StaticState,
    acting: Sequence[Load],
    water: Sequence[Load] | None = None,
) -> StageRecord:
    """Return the record of a static stage under loads, with its water in joints (collective).

    The pressures in joints are those of the loads ``water``, by default of ``acting``.
    """
    pressure = None
    if state.joints is not None and any(isinstance(load, JointLoad) for load in acting):
        from dolfinx_joints.loads.water.pressures_in_joints import WaterPressures, water_in_joints

        pressures = WaterPressures(model, water_in_joints(acting if water is None else water))
        pressure = pressures(time, pressures.by_opening(state.joints.state.gap))
    indices = tuple(i for i, m in enumerate(model.loads) if any(m is load for load in acting))
    state = replace(state, loads={})  # One vector per load and stage would need too much memory.
    return StageRecord(name=name, time=time, state=state, loads=indices, pressure=pressure)


def grout_record(
    model: Model, name: str, state: StaticState, stages: Sequence[StageRecord]
) -> StageRecord:
    """Return the record of a grouting stage (collective).

    The record repeats the loads and the joint water of the previous stage.
    """
    if not stages:
        return stage_record(model, name, 0.0, state, model.loads)
    return replace(stages[-1], name=name, state=replace(state, loads={}))


def stage_name(given: str | None, kind: str, stages: Sequence[StageRecord]) -> str:
    """Return the name of a new stage: the given name if unused, by default kind and number."""
    names = [stage.name for stage in stages]
    if given is None:
        numbered = (f"{kind} {number}" for number in count(1))
        return next(n for n in numbered if not any(f"{s},".startswith(f"{n},") for s in names))
    from dolfinx_joints.results.layout import stage_bytes

    stage_bytes(given)
    if given in names:
        raise JointsError(
            f"The stage name {given!r} is in use; choose a name other than {', '.join(names)}."
        )
    return given
