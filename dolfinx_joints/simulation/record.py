# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a monitor sees of each static stage and of each dynamic step."""

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
    """A static stage at its end.

    Attributes:
        name: Name of the stage.
        time: Time at which its loads and prescribed displacements are taken [s].
        state: Equilibrium, displacements counted from the unloaded body.
        loads: Which of the model's loads act, their places in ``Model.loads``.
        pressure: Of the water at the local joint points, shape (n,), [Pa]; None without any.
    """

    name: str
    time: float
    state: StaticState
    loads: tuple[int, ...]
    pressure: NDArray[np.float64] | None


@dataclass(frozen=True, kw_only=True)
class Record:
    """Step as a monitor sees it.

    Attributes:
        stage: ``dynamic``; of static stages monitors see a `StageRecord`.
        step: Number of the step, 0 for the start of the stage.
        time: Time [s].
        displacement: Nodal displacements u [m].
        velocity: Nodal velocities v [m/s].
        reaction: Forces of the supports on the body, zero at unconstrained dofs [N].
        joints: Response of the joints, None without joints.
        motion: Acceleration of the ground at a time [s], [m/s^2], None where it rests.
        free_surface: Velocity of the level free surface under the waves of all `FreeField` alone,
            (3,) at a time [s], [m/s]; None without any. Displacements are absolute then.
        solve: How the solve went, None at step 0 of a dynamic stage.
        energy: Energies.
        substeps: Substeps that this step was cut into: 1 for a whole step, 0 at the start.
        static_part: Static part of the displacement at a time [s], [m] (collective), see
            `DifferingGround`; None where the ground is the same everywhere.
        reservoir_force: Of waves in the reservoir on the face, (gdim,), [N]; None without any.
        reservoir_pressure: Gives the pressure of these waves at the rank's unknowns of the water,
            shape (n,), [Pa]; likewise.
        wet_joints: Names of the joints with water.
        pressure: Gives the pressure of the water at the local joint points at the time of the
            record, shape (n,), [Pa]; None without water in joints (collective).
        settings: How the stage is run, by name; of the record that monitors start with.
        stages: Static stages before; likewise.
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
            known = np.asarray(self.motion(self.time), dtype=np.float64)[:3]
            ground[: len(known)] = known
        return ground


def stage_record(
    model: Model, name: str, time: float, state: StaticState, acting: Sequence[Load]
) -> StageRecord:
    """A static stage under loads of the model, with its water in joints (collective)."""
    pressure = None
    if state.joints is not None and any(isinstance(load, JointLoad) for load in acting):
        from dolfinx_joints.loads.water.pressures_in_joints import WaterPressures, water_in_joints

        water = WaterPressures(model, water_in_joints(acting))
        pressure = water(time, water.by_opening(state.joints.state.gap))
    places = tuple(i for i, one in enumerate(model.loads) if any(one is load for load in acting))
    state = replace(state, loads={})  # a vector for each load and stage would fill the memory
    return StageRecord(name=name, time=time, state=state, loads=places, pressure=pressure)


def grout_record(
    model: Model, name: str, state: StaticState, stages: Sequence[StageRecord]
) -> StageRecord:
    """The grouting of joints (collective).

    Loads are those of the stage before, and water stays until a static stage looks again.
    """
    if not stages:
        return stage_record(model, name, 0.0, state, model.loads)
    return replace(stages[-1], name=name, state=replace(state, loads={}))


def stage_name(given: str | None, kind: str, stages: Sequence[StageRecord]) -> str:
    """The name of a new stage: the one given if no stage has it, else its kind and a number."""
    names = [stage.name for stage in stages]
    if given is None:
        numbered = (f"{kind} {number}" for number in count(1))
        return next(n for n in numbered if not any(f"{s},".startswith(f"{n},") for s in names))
    from dolfinx_joints.results.layout import stage_bytes

    stage_bytes(given)
    if given in names:
        raise JointsError(
            f"There is a static stage {given!r} already; the stages so far are: {', '.join(names)}."
        )
    return given
