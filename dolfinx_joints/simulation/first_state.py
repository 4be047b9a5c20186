# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The state that a dynamic stage begins with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.parameters import check_kind_of, offers
from dolfinx_joints.laws.law import JointState, Response
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.nodal_field import NodalField, nodal_vector
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.simulation.checkpoint import Checkpoints
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.solvers.step_solver import StepSolver
from dolfinx_joints.time_integration.exact_steps import scaled
from dolfinx_joints.time_integration.initial_state import INTERVAL, initial_state
from dolfinx_joints.time_integration.midpoint import EnergyConsistent
from dolfinx_joints.time_integration.scheme import Scheme
from dolfinx_joints.time_integration.states import DynamicState
from dolfinx_joints.time_integration.substeps import StepControl

# Of the largest initial velocity, that it may differ from that of moving supports, which is found
# by differences.
SAME_VELOCITY = 1e-3


@dataclass(frozen=True, kw_only=True)
class InitialFields:
    """Fields that a dynamic stage begins with, on top of the static state.

    A field is a function of the nodes (n, 3) that returns (n, gdim), a UFL expression or DOLFINx
    function, a vector of the unknowns, or a number for each axis.

    Args:
        velocity: Velocity [m/s], zero unless given; at supports it must be theirs.
        displacement: Displacement from the static state [m]; joints respond to it from there.
    """

    velocity: NodalField | None = None
    displacement: NodalField | None = None


def checked_settings(
    scheme: Scheme | None,
    control: StepControl | None,
    start: DynamicState | InitialFields | None,
    checkpoint: Checkpoints | None,
) -> tuple[Scheme, StepControl]:
    """Scheme and control of a dynamic stage, defaults where none is given; all are checked."""
    scheme = EnergyConsistent() if scheme is None else scheme
    control = StepControl() if control is None else control
    known = offers(scheme, "advance", "conserves")
    check_kind_of("scheme", scheme, known, "a time scheme, such as Newmark()")
    check_kind_of("control", control, isinstance(control, StepControl), "a StepControl")
    known = isinstance(start, DynamicState | InitialFields | None)
    check_kind_of("start", start, known, "InitialFields or the state of an earlier outcome")
    known = isinstance(checkpoint, Checkpoints | None)
    check_kind_of("checkpoint", checkpoint, known, "a Checkpoints")
    return scheme, control


def given_fields(model: Model, start: DynamicState | InitialFields | None) -> dict[str, PETSc.Vec]:
    """Nodal vectors of the initial fields that are given, by name (collective).

    Raises:
        ValueError: One is no such field.
        JointsError: A state to go on from is given to a model with waves in a reservoir, whose
            ground would begin again at rest.
    """
    if isinstance(start, DynamicState) and model.coupled is not None:
        raise JointsError(
            "start is given, but waves in a reservoir begin with the ground at rest: the velocity "
            "that the ground has at the end of the stage before would be a blow on the water. Run "
            "it as one stage with one motion."
        )
    fields = vars(start).items() if isinstance(start, InitialFields) else ()
    return {name: nodal_vector(model, name, each) for name, each in fields if each is not None}


def first_state(
    solver: StepSolver,
    dt: float,
    static: StaticState | None,
    start: DynamicState | None,
    fields: Mapping[str, PETSc.Vec],
) -> DynamicState:
    """Return the first state of a dynamic stage, its acceleration in balance (collective).

    It follows from the last static state and the ``fields`` ``velocity`` [m/s] and
    ``displacement`` beyond it [m], or else from a dynamic state ``start``. The first step is dt
    [s] long.
    """
    if start is not None:
        start = scaled(solver.system, start, 0, 0.0)
        _check_displacement(solver.system, start.displacement, start.time)
        return initial_state(
            solver,
            time=start.time,
            dt=dt,
            displacement=start.displacement,
            velocity=start.velocity,
            joints=start.joints,
            water=start.water,
        )
    system, velocity, added = solver.system, fields.get("velocity"), fields.get("displacement")
    if velocity is not None:
        _check_velocity(system, velocity, dt)
    if static is None and added is None:
        return initial_state(solver, dt=dt, velocity=velocity)
    # The joints' tractions are taken as they are: a point that slid sits on the friction limit,
    # and asked again, round-off would decide.
    joints: Response | JointState | None = None if static is None else static.joints
    u = system.unknowns(None if static is None else static.displacement)
    if added is not None:
        if system.internal_forces is not None:
            before = static.joints if static else None
            joints = before.state if before else system.internal_forces.at_rest(u)
        u.axpy(1.0, system.unknowns(added))
    _check_displacement(system, u)
    return initial_state(solver, dt=dt, displacement=u, velocity=velocity, joints=joints)


def _check_velocity(system: MatrixSystem, v: PETSc.Vec, dt: float) -> None:
    """Check that an initial velocity is that of the supports where there are some (collective)."""
    rates = system.prescribed_rates(0.0, -INTERVAL * dt)
    there = v.getArray(readonly=True)[system.constrained] - (0.0 if rates is None else rates[0])
    off = max(v.comm.tompi4py().allgather(float(np.abs(there).max(initial=0.0))))
    if off > SAME_VELOCITY * v.norm(PETSc.NormType.INFINITY):
        raise ValueError(
            f"The initial velocity differs by {off:.3g} m/s from that of the supports; let it be "
            "theirs there, zero where they rest."
        )


def _check_displacement(system: MatrixSystem, u: PETSc.Vec, time: float = 0.0) -> None:
    """Check that displacements of the supports do not jump at the start (collective)."""
    at_start = system.prescribed(time)
    there = u.getArray(readonly=True)[system.constrained]
    jump = float(np.abs(at_start - there).max(initial=0.0))
    if max(u.comm.tompi4py().allgather(jump)) > 1e-9 * u.norm():
        raise ValueError(
            f"The displacements of the supports at t = {time:g} differ from those that the dynamic "
            "stage starts from, of the static state and InitialFields, or of start= "
            "and its motion; let them agree there."
        )


def in_words(value: Any) -> Any:
    """A setting as a results file keeps it: of a nodal vector its largest number."""
    if not isinstance(value, PETSc.Vec):
        return value
    return f"up to {value.norm(PETSc.NormType.INFINITY):.6g} along an axis"


def shaken_by(motion: Any, loads: Sequence[Any]) -> dict[str, Any]:
    """What acts in a dynamic stage besides the loads of the model, as a results file keeps it."""
    found = {f"load {i}" if len(loads) > 1 else "load": load for i, load in enumerate(loads, 1)}
    return found if motion is None else found | {"ground motion": getattr(motion, "name", motion)}
