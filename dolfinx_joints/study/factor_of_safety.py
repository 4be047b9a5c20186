# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Factor of safety of a static state, by reduced strength of joints or by multiplied loads."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import annotated_types as at
from petsc4py import PETSc

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.parameters import check_kind_of
from dolfinx_joints.common.summary import Rows, Summarised, names
from dolfinx_joints.loads.load import FollowsJoints, Load, load_names
from dolfinx_joints.loads.temperature.thermal_strain import Temperature
from dolfinx_joints.loads.water.joint_water import Uplift
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.resultants import JointForces
from dolfinx_joints.postprocessing.joints.resultants import JointResultants
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.simulation.record import stage_record
from dolfinx_joints.simulation.simulation import Simulation
from dolfinx_joints.simulation.statics.stage import check_acting
from dolfinx_joints.simulation.statics.stage_start import check_fits, state_at_rest
from dolfinx_joints.simulation.statics.trials import FailureTrials, Trial
from dolfinx_joints.simulation.statics.unfinished import check_joints
from dolfinx_joints.solvers.step_solver import SolverOptions
from dolfinx_joints.time_integration.states import DynamicState

# Smallest and largest factor that is tried.
SMALLEST, LARGEST = 1.0 / 64.0, 64.0


@dataclass(frozen=True, kw_only=True, repr=False)
class FactorOfSafety(Summarised):
    """Factor of safety F, its last equilibrium, and the mechanism of failure.

    Attributes:
        factor: F, the largest factor with an equilibrium.
        upper: Smallest factor without an equilibrium; infinite if F = 64 has an equilibrium.
        of: Names of the joints or loads to which F applies.
        trials: All trials in their order.
        state: Equilibrium at F.
        resultants: Resultants of the joints at F, by name; their ``friction`` is that at F = 1.
        acceleration: Mechanism: acceleration of the body at ``upper``, from rest at the last
            equilibrium [m/s^2]. None without a failure, for a body without mass, or if the step of
            the motion did not converge.
    """

    factor: float
    upper: float
    of: tuple[str, ...]
    trials: tuple[Trial, ...]
    state: StaticState
    resultants: Mapping[str, JointResultants]
    acceleration: PETSc.Vec | None

    def _summary(self) -> Rows:
        failure = "" if self.upper == math.inf else self.trials[-1].outcome
        yield "factor of safety", f"{self.factor:.4g}" if failure else "none up to 64"
        yield "of", names(self.of)
        yield "failure", f"{failure} at {self.upper:.4g}" if failure else ""
        yield "trials", len(self.trials)


@checked
def factor_of_safety(
    simulation: Simulation,
    *,
    method: Literal["strength", "load"] = "strength",
    joints: Sequence[str] | None = None,
    multiplied: Sequence[Load] | None = None,
    loads: Sequence[Load] | None = None,
    start: StaticState | DynamicState | None = None,
    time: Annotated[float, at.Unit("s")] | None = None,
    tolerance: Annotated[float, at.Gt(0), at.Lt(1)] = 1e-3,
    monitors: Sequence[Monitor] = (),
) -> FactorOfSafety:
    """Return the factor of safety of a static state (31c) (collective).

    The strength of joints is divided by F, or loads are multiplied by F, until there is no
    equilibrium or the structure jumps to a distant equilibrium (`JumpError`). F starts at 1 and is
    doubled, or halved if there is no equilibrium at F = 1; then the interval is bisected. Each
    trial starts from the equilibrium at the largest stable factor, because friction depends on the
    path. The last failure is confirmed by other starts, other solvers and pseudo-time.

    The simulation does not change. The ``monitors`` receive two stages: "factor of safety" with the
    equilibrium at F, and "mechanism" with the displacement due to one second of the mechanism's
    acceleration in addition, which `views.deformed` draws.

    Args:
        simulation: Simulation of a model with joints.
        method: ``strength`` divides strengths of joints; ``load`` multiplies loads.
        joints: With ``strength``, names of the joints whose strength is divided; all by default.
        multiplied: With ``load``, loads that are multiplied, except water that follows the openings
            of joints; by default all loads.
        loads: Loads of the model that act, such as changed uplift; all by default.
        start: State from which the first trial starts, by default the simulation's static state; or
            a static state or the last state of a dynamic stage, also of another model on the same
            mesh, such as before a loss of strength. The stiffnesses of joints must be equal, and
            the internal variables of laws, unless the new laws have none.
        time: Time at which the loads are evaluated [s]; by default that of a dynamic ``start`` or,
            without ``start``, of the simulation's last stage; else zero.
        tolerance: Relative width of the interval of F.
        monitors: Observers of the two stages, with separate files; none if a `Temperature` is
            multiplied.

    Raises:
        JointsError: There is no static state, or no equilibrium at any factor from 1/64 to 1.
        ValueError: A joint has no strength, or a load cannot be multiplied.
    """
    model = simulation.model
    acting = model.loads if loads is None else loads
    divides = method == "strength"
    chosen = tuple(model.jointed.joint_names if joints is None else joints)
    check_joints(model, chosen)
    check_kind_of("joints", chosen, len({*chosen}) == len(chosen), "different names")
    if model.contact is None or not chosen:
        raise ValueError("There is no joint whose strength can be divided; name at least one.")
    unused, value = ("multiplied", multiplied) if divides else ("joints", joints)
    check_kind_of(unused, value, value is None, f"None with the method {method!r}")
    check_acting(model, acting)
    check_kind_of("loads", acting, len(acting) > 0, "at least one load of the model")
    of = chosen if divides else _loads_of(model, multiplied, acting, recorded=bool(monitors))
    before = simulation.static if start is None else start
    if before is None:
        raise JointsError("factor_of_safety() needs a static state: run statics() first.")
    a_state = isinstance(before, StaticState | DynamicState)
    check_kind_of("start", start, a_state, "a StaticState or a DynamicState")
    last = simulation.stages[-1].time if start is None and simulation.stages else 0.0
    if isinstance(before, DynamicState):
        last, before = before.time, state_at_rest(model, before)
    time = last if time is None else time
    check_fits(model, before)
    recorded = Simulation(model, monitors=monitors)
    options = simulation.options or SolverOptions()
    applied = {"joints": of if divides else (), "multiplied": () if divides else of}
    trials = FailureTrials(model, before, acting, options, simulation.solver, time=time, **applied)
    lower, upper = _bracket(trials, tolerance)
    named = dict(zip(load_names(model.loads), model.loads, strict=True))
    missing = tuple(n for n, load in named.items() if not any(load is one for one in acting))
    times = {name: lower if name in applied["multiplied"] else 1.0 for name in named}
    water = [_scaled(load, times[n]) for n, load in named.items() if n not in missing]
    state = trials.state({"missing": missing})
    acceleration = trials.acceleration(upper) if upper < math.inf else None
    stage = stage_record(model, "factor of safety", time, state, acting, water)
    recorded.add_stage(stage)
    if acceleration is not None:
        moved = replace(state, displacement=state.displacement + 0.5 * acceleration)  # after 1 s
        recorded.add_stage(stage_record(model, "mechanism", time, moved, acting, water))
    assert state.joints is not None
    return FactorOfSafety(
        factor=lower,
        upper=upper,
        of=of,
        trials=tuple(trials.trials),
        state=state,
        resultants=JointForces(model)(state.joints, stage.pressure),
        acceleration=acceleration,
    )


def _bracket(trials: FailureTrials, tolerance: float) -> tuple[float, float]:
    """Return the largest stable and the smallest unstable factor (collective)."""
    lower, upper, growth = 1.0, math.inf, 2.0
    while not trials.run(lower, all_solvers=lower == SMALLEST):
        if lower == SMALLEST:
            raise JointsError(
                f"There is no equilibrium at any factor from {lower:g} to 1: the loads exceed the "
                "strength by far, or a block has no support."
            )
        lower, upper = 0.5 * lower, lower
    while lower < LARGEST:
        if upper - lower <= tolerance * lower:
            # Confirm the failure from the nearest equilibrium: an earlier trial was further away.
            if not trials.run(upper, all_solvers=True):
                return lower, upper
            lower, upper, growth = upper, math.inf, 1.0 + 2.0 * tolerance
        factor = 0.5 * (lower + upper) if upper < math.inf else min(growth * lower, LARGEST)
        if trials.run(factor, all_solvers=False):
            lower, growth = factor, min(growth**2, 2.0)
        else:
            upper = factor
    return lower, math.inf


def _loads_of(
    model: Model, multiplied: Sequence[Load] | None, acting: Sequence[Load], *, recorded: bool
) -> tuple[str, ...]:
    """Return the names of the loads that are multiplied."""
    chosen = acting if multiplied is None else multiplied
    check_kind_of("multiplied", chosen, len(chosen) > 0, "at least one load of the model")
    for load in chosen:
        if isinstance(load, FollowsJoints) or not any(load is one for one in acting):
            raise ValueError(
                f"The load {type(load).__name__} cannot be multiplied; it must act, and it must "
                "not be water that follows the openings of joints."
            )
        if recorded and isinstance(load, Temperature):
            raise ValueError(
                "Monitors record thermal stresses without the factor; pass multiplied= without "
                "Temperature, or no monitors."
            )
    named = zip(load_names(model.loads), model.loads, strict=True)
    return tuple(name for name, load in named if any(load is one for one in chosen))


def _scaled(load: Load, factor: float) -> Load:
    """Return a load, with the pressure multiplied by a factor if it is an `Uplift`."""
    if not isinstance(load, Uplift):
        return load
    return replace(load, factor=lambda time: factor * load.factor(time))
