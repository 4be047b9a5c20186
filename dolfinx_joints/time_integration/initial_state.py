# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Initial state of a motion, with an acceleration that balances the forces."""

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

# Interval of the finite differences for the initial velocity and acceleration of moving supports,
# as a fraction of the step. If the steps resolve the motion, the error of the differences is far
# below the error of the time scheme, and about eight digits remain after rounding.
INTERVAL = 1.0 / 16.0

# Largest unbalanced force at massless dofs at the start, divided by the load or elastic force norm.
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

    The length dt [s] of the next step is required if supports move, see `INTERVAL`. Displacement
    [m] and velocity [m/s] are zero by default, except at prescribed dofs. If ``joints`` is a joint
    state, the laws are evaluated at the displacement; a response is used unchanged. By default the
    joints are at rest, and the joint water (`DynamicState.water`) follows from their openings.
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
    a = balancing_acceleration(system, force)
    imbalance = combination((1.0, system.mass * a), (-1.0, force))
    reaction = system.vector()
    reaction.getArray()[system.constrained] = imbalance.array_r[system.constrained]
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
    """Check that massless dofs outside joints are in balance at a start from rest (collective).

    No inertia balances a residual at these dofs, so it would oscillate in all later steps.
    """
    comm = force.comm.tompi4py()
    if not sum(comm.allgather(len(system.massless))):
        return
    checked = np.zeros(force.getLocalSize(), dtype=bool)
    checked[system.massless] = True
    checked[system.constrained] = False
    if system.contact is not None:
        checked &= ~joint_dofs(system.contact.operator)
    residual = float(np.abs(force.getArray(readonly=True)[checked]).max(initial=0.0))
    residual = max(comm.allgather(residual))
    if residual > LARGEST_FORCE * scale:
        raise JointsError(
            f"A part of the body without mass is not in balance at the start: the largest residual "
            f"nodal force is {residual:.3g} N. Start its loads at zero, or begin with statics()."
        )


def balancing_acceleration(system: MatrixSystem, force: PETSc.Vec) -> PETSc.Vec:
    """Solve M a = force for a at unconstrained dofs with mass; a is zero at all other dofs."""
    mask = system.vector(1.0)
    mask.getArray()[system.constrained] = 0.0
    unconstrained = mask.sum()
    mask.getArray()[system.massless] = 0.0
    if unconstrained and not mask.sum():
        raise JointsError(
            "The body has no mass: all densities are zero. Set a density for dynamics, or use "
            "quasi_statics."
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
            "The initial acceleration cannot be computed: the mass matrix is singular. Check for "
            "parts of the body that have mass in some directions only."
        )
    ksp.destroy()
    mass.destroy()
    return a
