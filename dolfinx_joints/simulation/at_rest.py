# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static stages after a motion: free vibration to rest, then equilibrium with the slips left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any

import annotated_types as at

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.parameters import check_kind_of, shown
from dolfinx_joints.model.model import Model
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.simulation.record import stage_record
from dolfinx_joints.simulation.simulation import Simulation
from dolfinx_joints.simulation.statics.stage_start import unloaded_state
from dolfinx_joints.solvers.step_solver import SolveReport
from dolfinx_joints.time_integration.states import DynamicState

# Kinetic energy of a body at rest, divided by its energy at the end of the motion.
AT_REST = 1e-6

# Steps of the first run of free vibration, and largest number of runs. Each run is twice as long.
FIRST_STEPS, MOST_RUNS = 50, 10


@checked
def to_rest(
    simulation: Simulation,
    state: DynamicState,
    *,
    dt: Annotated[float, at.Gt(0), at.Unit("s")],
    model: Model | None = None,
    monitors: Sequence[Monitor] = (),
    steps: Annotated[int, at.Ge(1)] = 1,
) -> Simulation:
    """Return a simulation that continues with static stages after a motion (collective).

    The body vibrates freely under the loads of its model until its damping has brought it to rest.
    Then a static stage computes the equilibrium, with slips, openings and broken bonds as the
    motion left them, and the loads at this time. The remaining inertia fades over its steps.

    Args:
        simulation: The simulation of the motion.
        state: Last state of the motion, ``outcome.state``.
        dt: Time step of the free vibration [s].
        model: Model with other loads for the static stage, such as a changed uplift, on the same
            mesh and with laws of equal class and stiffness; by default the model of the motion.
        monitors: Observers of the static stages, with separate files.
        steps: Load steps of the static stage, called "at rest" in results.

    Raises:
        JointsError: The body does not come to rest, or the reservoir has waves.
        ValueError: The model has another mesh or other joint laws.
    """
    check_kind_of("state", state, isinstance(state, DynamicState), "a DynamicState")
    before, after = simulation.model, model or simulation.model
    if after.jointed is not before.jointed:
        raise ValueError("model has another mesh than the simulation; it must have the same mesh.")
    for name in before.jointed.joint_names:
        laws = [model.contact.laws[name] for model in (before, after) if model.contact]
        kinds = {(type(w), type(getattr(w, "law", 0)), w.closed_stiffness()) for w in laws}
        wanted = f"of the class and stiffnesses of the law of the motion, {shown(laws[0])}"
        check_kind_of(f"model: the law of joint {name!r}", laws[-1], len(kinds) == 1, wanted)
    options: Any = {"options": simulation.options, "solver": simulation.solver}
    free = Simulation(before, **options)
    free.static = simulation.static
    limit = AT_REST * (state.kinetic_energy + state.strain_energy)
    for run in range(MOST_RUNS):
        state = free.dynamics(dt=dt, steps=FIRST_STEPS * 2**run, start=state).state
        if state.kinetic_energy <= limit:
            break
    else:
        raise JointsError(
            f"The body does not come to rest: at t = {state.time:g} s its kinetic energy is "
            f"{state.kinetic_energy:.3g} J, but at most {limit:.3g} J is allowed. Give the model "
            "damping, and end the motion and the changes of the loads."
        )
    settled = Simulation(after, monitors=monitors, **options)
    settled.static = _as_static(before, state)
    path = [(state.time, 1.0 / remaining) for remaining in range(steps, 0, -1)]
    settled.static = settled._march("at rest", path, after.loads, time=state.time)
    settled.add_stage(stage_record(after, "at rest", state.time, settled.static, after.loads))
    return settled


def _as_static(model: Model, state: DynamicState) -> StaticState:
    """Return a state at rest as a static state, with its residual force to fade (collective)."""
    system, unloaded = model.system(static=True), unloaded_state(model)
    u, joints, elastic = state.displacement, state.joints, unloaded.energy.joint_elastic
    if model.contact is not None and joints is not None:
        elastic = model.contact.stored_energy(joints.state)
    strain = 0.5 * float(u.dot(system.stiffness * u)) + system.bulk_terms(joints)[0]
    stored = strain + float(elastic.sum())
    energy = replace(unloaded.energy, strain=strain, joint_elastic=elastic, scale=stored)
    energy = replace(energy, input_by_load={"motion": stored})
    # Without a report the static stage would assume the unloaded body.
    solved = [SolveReport(iterations=0, factorizations=0)]
    return replace(unloaded, displacement=u.copy(), joints=joints, reports=solved, energy=energy)
