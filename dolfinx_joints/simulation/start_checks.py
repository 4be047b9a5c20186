# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks at the start of a dynamic stage: complete static state, no suddenly applied loads."""

from __future__ import annotations

from collections.abc import Sequence

from petsc4py import PETSc

from dolfinx_joints.common.errors import JointsError, warn
from dolfinx_joints.loads.free_field import SupportForces
from dolfinx_joints.loads.ground_motion import BaseMotion
from dolfinx_joints.loads.load import Load, load_names
from dolfinx_joints.loads.oblique_field import rising_waves
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.simulation.record import StageRecord
from dolfinx_joints.simulation.statics.unfinished import check_grouted
from dolfinx_joints.time_integration.states import DynamicState

# Smaller changes of a load, divided by the largest load, are rounding errors.
SAME_LOAD = 1e-9
# Smaller unbalanced forces, divided by the loads, are within the tolerance of static solves.
IN_BALANCE = 1e-6


def check_built(static: StaticState | None) -> None:
    """Raise JointsError if a joint is inactive or a block is absent in the static state."""
    check_grouted(static)
    if static is not None and static.absent:
        raise JointsError(
            f"{', '.join(static.absent)} is absent in the static state, and its weight would act "
            "suddenly; run statics() with all blocks first."
        )


def check_complete(static: StaticState | None) -> None:
    """Check that all joints, blocks and loads of the model act in the static state.

    Raises:
        JointsError: A joint is inactive, a block is absent or a load is missing.
    """
    check_built(static)
    if static is not None and static.missing:
        raise JointsError(
            f"The static state does not include {', '.join(static.missing)} as it acts in the "
            "dynamic stage, where it would act suddenly; run statics() with all loads first."
        )


def sudden_loads(
    model: Model,
    system: MatrixSystem,
    state: DynamicState,
    static: StaticState | None,
    stages: Sequence[StageRecord],
    of_stage: Sequence[Load],
) -> list[str]:
    """Warn on rank 0 of loads that differ from the loads of the static state (collective).

    Ground motions are excluded, and there is no warning if the forces at the start are in balance.
    The system, its first state and the additional loads ``of_stage`` belong to the dynamic stage;
    ``static`` is None if no load has acted yet. All ranks return a list of at most one warning.
    """
    of_model, acting = load_names(model.loads), [*model.loads, *of_stage]
    names = load_names(acting)
    before = {} if static is None else static.loads
    loads = system.loads_by_name(state.time, 1.0)
    largest = max((float(vector.norm()) for vector, _ in system.patterns), default=0.0)
    changes: dict[str, float] = {}
    for i, (name, load) in enumerate(zip(names, acting, strict=True)):
        if isinstance(load, BaseMotion | SupportForces) or rising_waves([load]):
            continue
        force = loads.get(name, system.vector())
        largest = max(largest, float(force.norm()))
        if i < len(of_model) and of_model[i] in before:
            force.axpy(-1.0, system.unknowns(before[of_model[i]]))
        changes[name] = float(force.norm())
    sudden = [name for name, change in changes.items() if change > SAME_LOAD * largest]
    if not sudden or _in_balance(system, state):
        return []
    start = f"t = {state.time:g} s"
    reason, remedy = "they are not part of the static state", "add them to the model"
    if static is None:
        reason, remedy = "no static stage was run", "run statics() first"
    elif not set(sudden) <= set(names[len(of_model) :]):
        last = f", {stages[-1].name!r} at t = {stages[-1].time:g} s," if stages else ""
        reason = f"the last static stage{last} ended with other values"
        remedy = f"let quasi_statics() end at {start}"
    text = (
        f"Loads are applied suddenly at the start of the dynamic stage, {start}: "
        f"{', '.join(sudden)}; {reason}. To start at rest, {remedy}, or let the load factors start "
        "at zero."
    )
    if model.jointed.mesh.comm.rank == 0:
        warn(text)
    return [text]


def _in_balance(system: MatrixSystem, state: DynamicState) -> bool:
    """Return True if the forces do not accelerate the body (collective)."""
    force: PETSc.Vec = system.mass * state.acceleration
    return bool(force.norm() <= IN_BALANCE * state.load.norm())
