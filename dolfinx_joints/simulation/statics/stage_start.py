# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Start of a static stage: response of the joints, and the loads that balance this response."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.laws.law import BACKWARD_EULER, JointState, Response, Status
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.simulation.static_energy import StaticEnergy
from dolfinx_joints.solvers.step_solver import SolveReport
from dolfinx_joints.time_integration.states import DynamicState

# Name in the ledger of residual forces of earlier stages, in inactive joints and absent blocks.
CONSTRUCTION = "construction"


def unloaded_state(model: Model) -> StaticState:
    """Return the state of the unloaded body, its joints at rest (collective)."""
    zeros = np.zeros(0 if model.contact is None else len(model.contact.operator.names))
    energy = StaticEnergy(
        joint_elastic=zeros,
        joint_friction=zeros,
        joint_numerical=zeros,
        joint_bonds=zeros,
        joint_released=zeros,
    )
    zero = model.stiffness.createVecRight()
    zero.set(0.0)
    return StaticState(
        displacement=zero, joints=None, reaction=zero, reports=[], energy=energy, loads={}
    )


def start_of_stage(system: MatrixSystem, before: StaticState) -> Response | None:
    """Return the response of joints and nonlinear cells at the start of a stage (collective).

    This is the response at the end of the last stage, or of the unloaded body; None without joints
    and nonlinear cells.
    """
    internal_forces = system.internal_forces
    if internal_forces is None or before.joints is not None:
        return None if internal_forces is None else before.joints
    at_rest = internal_forces.at_rest(before.displacement)
    if system.bulk is not None or system.contact is None or not system.contact.rigid:
        response: Response = internal_forces.respond(system.vector(), at_rest, BACKWARD_EULER)
        return response
    return without_traction(at_rest)


def state_at_rest(model: Model, end: DynamicState) -> StaticState:
    """Return a dynamic state as the start of a static stage (collective).

    Remaining forces of inertia and damping, and the strain energy, count as `CONSTRUCTION`.
    """
    start, system, joints = unloaded_state(model), model.system(static=True), end.joints
    forces, contact = system.internal_forces, system.contact
    if forces is not None and joints is not None and not (contact and contact.rigid):
        # Midpoint schemes store mean tractions of the last step: evaluate the laws at its end.
        joints = forces.respond(system.vector(), joints.state, BACKWARD_EULER)
    u = end.displacement  # end.strain_energy has the errors of the solver
    strain = 0.5 * float(u.dot(system.stiffness * u)) + system.bulk_terms(joints)[0]
    energy = replace(start.energy, strain=strain, input_by_load={CONSTRUCTION: strain})
    solved = [SolveReport(iterations=0, factorizations=0)]  # the body is not unloaded
    facts = {"joints": joints, "energy": energy, "reaction": end.reaction, "reports": solved}
    return replace(start, displacement=u, time=end.time, **facts)


def check_fits(model: Model, start: StaticState) -> None:
    """Check that a state has the mesh and the internal variables of a model, and no idle joints."""
    contact, joints, unfinished = model.contact, start.joints, [*start.inactive, *start.absent]
    if unfinished:
        raise JointsError(
            f"{unfinished[0]} does not act in the given state; all joints and blocks must act."
        )
    fits = start.displacement.getSizes() == model.stiffness.createVecRight().getSizes()
    if joints is not None:
        stored: Any = getattr(getattr(joints.state, "bulk", None), "internal", None)
        initial: Any = getattr(model.bulk, "initial", None)
        fits &= np.shape(stored) == np.shape(initial)
    if contact is not None and joints is not None:
        needed = contact.resting(contact.initial_gap)
        fits &= len(joints.state.gap) == len(needed.gap)
        fits &= joints.state.internal.size >= needed.internal.size
    if not all(model.jointed.mesh.comm.allgather(fits)):
        raise ValueError("The state is of another mesh or of laws with other variables.")


def without_traction(state: JointState) -> Response:
    """Return the response of open points without tractions in a given state."""
    count = len(state.gap)
    return Response(
        traction=np.zeros((count, 3)),
        tangent=np.zeros((count, 3, 3)),
        state=state,
        dissipation=np.zeros(count),
        status=np.full(count, Status.OPEN, dtype=np.int8),
    )


def carried_loads(
    system: MatrixSystem, before: StaticState, start: Response | None
) -> dict[str, PETSc.Vec]:
    """Return the loads by name that balance the state at the start of a stage [N] (collective).

    The system has all joints and blocks; ``start`` is the response from `start_of_stage`.
    """
    loads = {name: load for name, load in before.loads.items() if name != CONSTRUCTION}
    residual = system.stiffness * before.displacement
    residual.axpy(-1.0, before.reaction)
    if system.internal_forces is not None and start is not None:
        residual.axpy(1.0, system.internal_forces.force(start, residual.duplicate()))
    if before.unloaded:
        residual.getArray()[system.constrained] = 0.0
    for load in loads.values():
        residual.axpy(-1.0, load)
    if residual.norm() > 0.0:
        loads[CONSTRUCTION] = residual
    return loads
