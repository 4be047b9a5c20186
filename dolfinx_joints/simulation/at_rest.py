# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static stages after a motion: free vibration to rest, then equilibrium with the slips left."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import annotated_types as at

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.parameters import check_kind_of, shown
from dolfinx_joints.model.model import Model
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.simulation import Simulation
from dolfinx_joints.simulation.statics.stage_start import check_fits, state_at_rest
from dolfinx_joints.time_integration.states import DynamicState

# Kinetic energy of a body at rest, divided by its energy at the end of the motion.
AT_REST = 1e-6

# Steps of the first run of free vibration, and largest number of runs. Each run is twice as long.
FIRST_STEPS, MOST_RUNS = 50, 10

# Changes of the energies in a run, divided by the kinetic energy, of a steady drift on dashpots.
STEADY = 1e-3


@checked
def to_rest(
    simulation: Simulation,
    state: DynamicState,
    *,
    dt: Annotated[float, at.Gt(0), at.Unit("s")],
    model: Model | None = None,
    monitors: Sequence[Monitor] = (),
) -> Simulation:
    """Return a simulation that continues with static stages after a motion (collective).

    The body vibrates freely under the loads of its model until its damping has brought it to rest.
    Then a static stage computes the equilibrium, with slips, openings and broken bonds as the
    motion left them, and the loads at this time. This stage is called "at rest" in results.

    Args:
        simulation: The simulation of the motion.
        state: Last state of the motion, ``outcome.state``.
        dt: Time step of the free vibration [s].
        model: Model with other loads for the static stage, such as a changed uplift, on the same
            mesh and with laws of equal class and stiffness; by default the model of the motion.
        monitors: Observers of the static stages, with separate files.

    Raises:
        JointsError: The body does not come to rest or drifts on dashpots, or the reservoir has
            waves.
        ValueError: The model has another mesh, other joint laws, or materials with other variables.
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
        kinetic, strain = state.kinetic_energy, state.strain_energy
        state = free.dynamics(dt=dt, steps=FIRST_STEPS * 2**run, start=state).state
        change = abs(state.kinetic_energy - kinetic) + abs(state.strain_energy - strain)
        drifts = before.absorbing and change <= STEADY * kinetic
        if drifts or state.kinetic_energy <= limit:
            break
    if state.kinetic_energy > limit:
        remedy = "Give the model damping, and end the motion and the changes of the loads."
        if drifts:
            remedy = "It drifts: dashpots balance only the loads of statics() before the motion."
        raise JointsError(
            f"The body does not come to rest: at t = {state.time:g} s its kinetic energy is "
            f"{state.kinetic_energy:.3g} J, but at most {limit:.3g} J is allowed. {remedy}"
        )
    settled = Simulation(after, monitors=monitors, **options)
    settled.static = state_at_rest(before, state)
    check_fits(after, settled.static)
    settled.quasi_statics([state.time], name="at rest")
    return settled
