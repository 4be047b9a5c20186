# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static stages whose load factor is unknown and follows from a controlled displacement (28f)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Annotated

import annotated_types as at
from petsc4py import PETSc

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ConvergenceError, JumpError
from dolfinx_joints.common.mpi import free_petsc_garbage
from dolfinx_joints.common.parameters import check_kind_of
from dolfinx_joints.joints.small_displacements import SmallDisplacements
from dolfinx_joints.laws.law import Response
from dolfinx_joints.loads.load import FollowsJoints, Load, load_names
from dolfinx_joints.model.model import Model
from dolfinx_joints.simulation.monitor import report_failures
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.simulation.record import stage_name, stage_record
from dolfinx_joints.simulation.simulation import Simulation
from dolfinx_joints.simulation.statics.controlled_quantity import (
    ControlledDisplacement,
    ControlledGap,
)
from dolfinx_joints.simulation.statics.jumps import Jumps
from dolfinx_joints.simulation.statics.ledger import SolvedIncrement
from dolfinx_joints.simulation.statics.load_increments import Increment, LoadIncrements
from dolfinx_joints.simulation.statics.stage import Equilibrium, check_acting, solve_increments
from dolfinx_joints.simulation.statics.stage_start import (
    carried_loads,
    start_of_stage,
    unloaded_state,
)
from dolfinx_joints.simulation.statics.unfinished import check_grouted
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.solvers.effective_matrix import STATIC
from dolfinx_joints.solvers.step_solver import SolverOptions
from dolfinx_joints.time_integration.products import Products
from dolfinx_joints.time_integration.substeps import locate


@checked
def controlled_statics(
    simulation: Simulation,
    values: Annotated[Sequence[float], at.MinLen(1), at.Unit("m")],
    *,
    loads: Sequence[Load],
    quantity: ControlledGap | ControlledDisplacement,
    name: str | None = None,
) -> StaticState:
    """Follow the equilibrium through given values of a gap or displacement (collective).

    The factor of the loads is unknown, and falls while bonds soften. It multiplies the values of
    the loads at time zero. All other loads of the last static stage stay constant, and supports
    keep their positions. Each value is recorded as a stage, "NAME, 1" and so on, whose state has
    the ``load_factor``. An increment is halved as in `Simulation.statics`.

    Args:
        simulation: Simulation of a model with joints; its last static stage is the start.
        values: Values of the quantity, one per step [m].
        loads: Loads of the model with the unknown factor, except water that follows openings.
        quantity: The controlled quantity.
        name: Name in results, "controlled statics 1" and so on by default.

    Raises:
        JumpError: The next equilibrium is distant: the path turns back in the quantity (snap-back).
        ConvergenceError: No equilibrium was found.
        JointsError: The loads do not change the quantity, or the solver is not the condensed one.
    """
    model, monitors, stages = simulation.model, simulation.monitors, simulation.stages
    check_acting(model, loads)
    check_kind_of("loads", loads, len(loads) > 0, "at least one load of the model")
    check_grouted(simulation.static)
    before = simulation.static or unloaded_state(model)
    named = dict(zip(load_names(model.loads), model.loads, strict=True))
    acting = [m for n, m in named.items() if n in before.loads or any(m is a for a in loads)]
    for load in acting:
        wanted = "a load that does not follow the openings of joints"
        check_kind_of("Each acting load", load, not isinstance(load, FollowsJoints), wanted)
    name = stage_name(name, "controlled statics", stages)
    with simulation.phase("static"), report_failures(name, model, monitors, stages):
        path = ControlledPath(simulation, before, loads, quantity)
        missing = tuple(n for n, load in named.items() if not any(load is a for a in acting))
        for step, state in enumerate(path.follow(values), start=1):
            simulation.static = state = replace(state, missing=missing)
            label = f"{name}, {step}"
            simulation.add_stage(stage_record(model, label, 0.0, state, acting))
    free_petsc_garbage(model.jointed.mesh.comm)  # Matrices of the stage's solver.
    assert simulation.static is not None
    return simulation.static


class ControlledPath(Equilibrium):
    """Equilibria at values of a quantity; each is the start of the next increment.

    The arguments are those of `controlled_statics`; ``before`` is the state at the start.
    """

    def __init__(
        self,
        simulation: Simulation,
        before: StaticState,
        loads: Sequence[Load],
        quantity: ControlledGap | ControlledDisplacement,
    ) -> None:
        """Prepare the system and its solver (collective)."""
        self._model, self._quantity, model = simulation.model, quantity, simulation.model
        system = model.system(only=loads, static=True)
        start = start_of_stage(system, before)
        carried = carried_loads(system, before, start)
        self._controlled = system.loads_by_name(0.0, 1.0)
        self._constant_loads = {n: load for n, load in carried.items() if n not in self._controlled}
        self._load, self._direction = system.vector(), quantity.direction(model)
        for force in self._controlled.values():
            self._load.axpy(1.0, force)
        self._free_load = self._load.copy()
        for vector in (self._free_load, self._direction):
            vector.getArray()[system.constrained] = 0.0
        fixed = before.displacement.getArray()[system.constrained]
        control = self._free_load, self._direction
        system = replace(system, values=lambda _: fixed, control=control)
        options = simulation.options or SolverOptions()
        solver = make_solver(system, options, simulation.solver, static_steps=1)
        super().__init__(system, solver, before, start, carried, constant=True)
        assert self.joints is not None
        self._value = quantity.value(model, before.displacement, self.joints.gap)
        self._factor = self.factor = 0.0

    def follow(self, values: Sequence[float]) -> Iterator[StaticState]:
        """Yield the equilibrium at each value of the quantity [m] (collective)."""
        increments = LoadIncrements([(None, float(value)) for value in values], self._value)
        jumps, watch = Jumps(self.ledger, self._model, False), SmallDisplacements(
            self._model.contact
        )
        try:
            for increment in solve_increments(self, increments, jumps, "condensed", watch):
                free_petsc_garbage(self._model.jointed.mesh.comm)
                if increment.whole:
                    facts = {"load_factor": self.factor, "controlled": self._value}
                    yield self.state({"cuts": increments.cuts, **facts})
        except ConvergenceError as failure:
            if failure.law is not None:
                raise
            raise locate(failure, reached=self.factor, remedy=self._remedy(failure)) from None
        watch.warn("in a static stage")
        self.ledger.warn()

    def accept(self, solved: SolvedIncrement, increment: Increment) -> None:
        """Continue from the solution of an increment (collective)."""
        super().accept(solved, increment)
        self.factor, self._value = self._factor, increment.share

    def _set_up(self, increment: Increment) -> None:
        """Set b without the controlled loads, and x with the change of the quantity."""
        self._factor = 0.0
        super()._set_up(increment)
        change = (increment.share - self._value) / (self._direction.norm() ** 2 or 1.0)
        self._direction.copy(self._x)
        self._x.scale(change)

    def _products(self, response: Response | None) -> Products:
        """Return the products with the factor that balances the solution (collective)."""
        unbalanced = super()._products(response).remainder
        self._factor = float(unbalanced.dot(self._load)) / float(self._free_load.norm()) ** 2
        self._b.axpy(self._factor, self._load)
        return super()._products(response)

    def _loads(self, increment: Increment) -> dict[str, PETSc.Vec]:
        """Return the loads by name at the end of an increment [N] (collective)."""
        return self._constant_loads | {n: self._factor * load for n, load in self._controlled.items()}

    def _remedy(self, failure: ConvergenceError) -> str:
        """Return the value at the last equilibrium, and quantities to control instead."""
        joints = failure.joints if isinstance(failure, JumpError) else ()
        joint = repr(joints[0]) if joints else "the joint that breaks"
        turns = "turns back (snap-back)" if joints else "may turn back (snap-back)"
        return (
            f"The controlled {self._quantity}, is {self._value:.6g} m at the last equilibrium. "
            f"Beyond it this quantity {turns}. Control a quantity that grows along the whole path, "
            f"such as the opening of {joint}."
        )
