# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Initial state of a motion, its acceleration in balance with the forces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.laws.law import JointState, Response
from dolfinx_joints.model.mass_redistribution import joint_dofs
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.step_solver import StepSolver
from dolfinx_joints.time_integration.products import combination
from dolfinx_joints.time_integration.states import DynamicState

# Interval of the differences that give the first velocity and acceleration of moving supports, as a
# part of a step. For motions that the steps resolve, their error is far below that of the time
# scheme, and rounding leaves about eight digits.
INTERVAL = 1.0 / 16.0

# Of the loads or elastic forces, that may be left where there is no mass at the start.
LARGEST_FORCE = 1e-6


def initial_state(
    solver: StepSolver,
    *,
    time: float = 0.0,
    dt: float | None = None,
    displacement: PETSc.Vec | None = None,
    velocity: PETSc.Vec | None = None,
    joints: JointState | Response | None = None,
    water: NDArray[np.int8] | None = None,
) -> DynamicState:
    """Return the state at a time [s] whose acceleration balances the forces (collective).

    The length dt [s] of the next step is needed where supports move, see `INTERVAL`. Displacement
    [m] and velocity [m/s] are zero unless given, but for prescribed dofs. A state of the ``joints``
    is evaluated at the displacement, a response is taken as it is; they are at rest unless given.
    ``water``, see `DynamicState`, follows the openings unless given.
    """
    system = solver.system
    u, v = system.unknowns(displacement), system.unknowns(velocity)
    if displacement is None:
        u.getArray()[system.constrained] = system.prescribed(time)
    moving = system.vector()
    if dt is None and system.values is not None:
        raise ValueError("dt is missing; the first velocity of moving supports depends on it.")
    rates = None if dt is None else system.prescribed_rates(time, -INTERVAL * dt)
    if rates is not None:
        v.getArray()[system.constrained] = rates[0]
        moving.getArray()[system.constrained] = rates[1]
    if system.water is not None and system.contact is not None:
        state = joints.state if isinstance(joints, Response) else joints
        water = system.water.enter(system.contact.gap(u) if state is None else state.gap, water)
    load, work = system.load(time, u.duplicate()), u.duplicate()
    elastic_force = system.stiffness * u
    damping_force, inertia = system.damping_force(v, work), system.mass * moving
    force = combination((1.0, load), (-1.0, elastic_force), (-1.0, damping_force), (-1.0, inertia))
    forces, response = system.internal_forces, joints if isinstance(joints, Response) else None
    if forces is not None:
        response = response or forces.trial(u, joints or forces.at_rest(u))
        force.axpy(-1.0, forces.force_at_end(response, work))
    if velocity is None:
        _check_massless(system, force, max(load.norm(), elastic_force.norm()))
    a = _balance(system, force)
    left = combination((1.0, system.mass * a), (-1.0, force))
    reaction = system.vector()
    reaction.getArray()[system.constrained] = left.array_r[system.constrained]
    a.axpy(1.0, moving)
    return DynamicState(
        time=time,
        displacement=u,
        velocity=v,
        acceleration=a,
        load=load,
        reaction=reaction,
        momentum=system.mass * v,
        elastic_force=elastic_force,
        joints=response,
        water=water,
    )


def _check_massless(system: MatrixSystem, force: PETSc.Vec, scale: float) -> None:
    """Check that massless parts, joints aside, are in balance at a start from rest (collective).

    No inertia takes up that force: it would swing in them from step to step for ever.
    """
    comm = force.comm.tompi4py()
    if not sum(comm.allgather(len(system.massless))):
        return
    alone = np.zeros(force.getLocalSize(), dtype=bool)
    alone[system.massless] = True
    alone[system.constrained] = False
    if system.contact is not None:
        alone &= ~joint_dofs(system.contact.operator)
    left = float(np.abs(force.getArray(readonly=True)[alone]).max(initial=0.0))
    left = max(comm.allgather(left))
    if left > LARGEST_FORCE * scale:
        raise JointsError(
            f"A part of the body without mass is not in balance at the start: a nodal force of "
            f"{left:.3g} N is left; let its loads start at zero, or begin from statics()."
        )


def _balance(system: MatrixSystem, force: PETSc.Vec) -> PETSc.Vec:
    """Acceleration with M a = force at the unconstrained dofs with mass and zero at all others."""
    mask = system.vector(1.0)
    mask.getArray()[system.constrained] = 0.0
    unconstrained = mask.sum()
    mask.getArray()[system.massless] = 0.0
    if unconstrained and not mask.sum():
        raise JointsError(
            "The body has no mass: all densities are zero, which dynamics cannot do with; "
            "quasi_statics can."
        )
    mass = system.mass.copy()
    rows = np.flatnonzero(mask.array_r == 0.0) + mass.getOwnershipRange()[0]
    mass.zeroRowsColumns(rows.astype(PETSc.IntType), diag=1.0)
    b = force.duplicate()
    b.pointwiseMult(force, mask)
    ksp = PETSc.KSP().create(mass.comm)
    ksp.setOptionsPrefix("dolfinx_joints_acceleration_")
    ksp.setType("cg")
    ksp.getPC().setType("jacobi")
    ksp.setOperators(mass)
    ksp.setTolerances(rtol=1e-13, atol=1e-300, max_it=1000)
    ksp.setFromOptions()
    a = b.duplicate()
    ksp.solve(b, a)
    if ksp.getConvergedReason() < 0:
        raise JointsError(
            "The initial acceleration could not be found: the mass matrix is singular (has a part "
            "of the body mass in some directions only?)."
        )
    ksp.destroy()
    mass.destroy()
    return a
