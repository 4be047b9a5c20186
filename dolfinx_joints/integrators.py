# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time schemes as data, and the step that halves itself where Newton fails."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.checks import check_count, check_number
from dolfinx_joints.errors import ConvergenceError, JointsError
from dolfinx_joints.laws import JointState, Response
from dolfinx_joints.linear import Effective
from dolfinx_joints.solver import SolveReport, StepSolver
from dolfinx_joints.system import MatrixSystem

# Spacing of the differences that give the first velocity and acceleration of moving supports [s].
SPACING = 1e-4


@dataclass(frozen=True, kw_only=True)
class DynamicState:
    """State of a system at one time; never changed once made.

    Attributes:
        time: Time [s].
        displacement: u [m].
        velocity: v [m/s].
        acceleration: a [m/s^2].
        load: Nodal loads F [N].
        reaction: Forces of the supports on the body at constrained dofs, zero elsewhere [N].
        joints: Response of the joints, None without joints.
    """

    time: float
    displacement: PETSc.Vec
    velocity: PETSc.Vec
    acceleration: PETSc.Vec
    load: PETSc.Vec
    reaction: PETSc.Vec
    joints: Response | None


@dataclass(frozen=True, kw_only=True)
class StepReport:
    """An accepted step.

    Attributes:
        dt: Its length [s].
        solve: How its solve went.
        local_error: Estimate of the displacement error made in this step, 2-norm over all dofs [m].
    """

    dt: float
    solve: SolveReport
    local_error: float


class Scheme(Protocol):
    """A time scheme: parameters, and one step."""

    def advance(
        self, solver: StepSolver, state: DynamicState, dt: float
    ) -> tuple[DynamicState, StepReport]:
        """The state a step later; raises ConvergenceError and leaves ``state`` as it was."""


@dataclass(frozen=True, kw_only=True)
class Newmark:
    """Newmark's method, M a + C v + K u + B^T w t(B u) = F at the end of the step.

    u1 = u0 + dt v0 + dt^2 ((1/2 - beta) a0 + beta a1),  v1 = v0 + dt ((1 - gamma) a0 + gamma a1)

    Average acceleration (beta 1/4, gamma 1/2) is the default: it keeps the energy of a linear
    system and is the method of the paper.

    Attributes:
        beta: Above 0, at most 1/2.
        gamma: At least 1/2 (below it the method is unstable), at most 1.

    Raises:
        ValueError: A parameter is out of its range.
    """

    beta: float = 0.25
    gamma: float = 0.5

    def __post_init__(self) -> None:
        """Check the parameters."""
        check_number("Newmark beta", self.beta, lambda v: 0 < v <= 0.5, "above 0 and at most 1/2")
        check_number(
            "Newmark gamma",
            self.gamma,
            lambda v: 0.5 <= v <= 1,
            "at least 1/2 (unstable below) and at most 1",
        )

    def advance(
        self, solver: StepSolver, state: DynamicState, dt: float
    ) -> tuple[DynamicState, StepReport]:
        """One step of length dt [s] (collective).

        Raises:
            ConvergenceError: Newton did not converge.
        """
        system, beta, gamma = solver.system, self.beta, self.gamma
        time = state.time + dt
        mass_factor, damping_factor = 1.0 / (beta * dt**2), gamma / (beta * dt)
        u_start = state.displacement.copy()
        u_start.axpy(dt, state.velocity)
        u_start.axpy(dt**2 * (0.5 - beta), state.acceleration)
        v_start = state.velocity.copy()
        v_start.axpy(dt * (1.0 - gamma), state.acceleration)
        held, rates = system.constrained, system.prescribed_rates(time, 0.5 * dt)
        if rates is not None:
            # So that the rule below gives these dofs the motion prescribed: inferred from their
            # displacements alone, their accelerations would swing for ever undamped.
            u_start.getArray()[held] = system.prescribed(time) - rates[1] / mass_factor
            v_start.getArray()[held] = rates[0] - dt * gamma * rates[1]
        load = system.load(time, state.load.duplicate())
        known = u_start.copy()
        known.scale(mass_factor)
        b = load.copy()
        system.mass.multAdd(known, b, b)
        u_start.copy(known)
        known.scale(damping_factor)
        known.axpy(-1.0, v_start)
        system.damping.multAdd(known, b, b)
        u = u_start.copy()
        u.axpy(dt**2 * beta, state.acceleration)
        u.getArray()[held] = system.prescribed(time)
        start = None if state.joints is None else replace(state.joints.state, dt=dt)
        effective = Effective(mass=mass_factor, damping=damping_factor, stiffness=1.0)
        joints, reaction, report = solver.solve(effective, b, u, start)
        acceleration = u.copy()
        acceleration.axpy(-1.0, u_start)
        acceleration.scale(mass_factor)
        velocity = v_start
        velocity.axpy(dt * gamma, acceleration)
        after = DynamicState(
            time=time,
            displacement=u,
            velocity=velocity,
            acceleration=acceleration,
            load=load,
            reaction=reaction,
            joints=joints,
        )
        return after, StepReport(
            dt=dt, solve=report, local_error=self._local_error(state, after, dt)
        )

    def _local_error(self, before: DynamicState, after: DynamicState, dt: float) -> float:
        """dt^2 |beta - 1/6| |a1 - a0| (Zienkiewicz and Xie 1991), 2-norm over all dofs [m]."""
        change = after.acceleration.copy()
        change.axpy(-1.0, before.acceleration)
        return float(dt**2 * abs(self.beta - 1.0 / 6.0) * change.norm())


def initial_state(
    solver: StepSolver,
    *,
    time: float = 0.0,
    displacement: PETSc.Vec | None = None,
    velocity: PETSc.Vec | None = None,
    joints: JointState | None = None,
) -> DynamicState:
    """State whose acceleration balances the forces at the start of the motion (collective).

    Args:
        solver: Solver of the system.
        time: Start [s].
        displacement: u [m]; zero unless given, but for prescribed dofs.
        velocity: v [m/s], zero unless given.
        joints: State of the joints, at rest at ``displacement`` unless given.
    """
    system = solver.system
    u = system.stiffness.createVecRight() if displacement is None else displacement.copy()
    v = u.duplicate() if velocity is None else velocity.copy()
    if displacement is None:
        u.set(0.0)
        u.getArray()[system.constrained] = system.prescribed(time)
    if velocity is None:
        v.set(0.0)
    moving = u.duplicate()
    moving.set(0.0)
    rates = system.prescribed_rates(time, -SPACING)
    if rates is not None:
        v.getArray()[system.constrained] = rates[0]
        moving.getArray()[system.constrained] = rates[1]
    load = system.load(time, u.duplicate())
    force = load.copy()
    work = u.duplicate()
    terms = ((system.stiffness, u), (system.damping, v), (system.mass, moving))
    for matrix, vector in terms:
        matrix.mult(vector, work)
        force.axpy(-1.0, work)
    response = None
    if system.contact is not None:
        response = system.contact.trial(u, joints or system.contact.at_rest(u))
        system.contact.operator.force(response.traction, work)
        force.axpy(-1.0, work)
    a = _balance(system, force)
    reaction = force.duplicate()
    system.mass.mult(a, reaction)
    reaction.axpy(-1.0, force)
    a.axpy(1.0, moving)
    held = np.zeros(reaction.getLocalSize())
    held[system.constrained] = reaction.getArray(readonly=True)[system.constrained]
    reaction.setArray(held)
    return DynamicState(
        time=time,
        displacement=u,
        velocity=v,
        acceleration=a,
        load=load,
        reaction=reaction,
        joints=response,
    )


def _balance(system: MatrixSystem, force: PETSc.Vec) -> PETSc.Vec:
    """Acceleration with M a = force at the free dofs and zero at the constrained ones."""
    free = force.duplicate()
    free.set(1.0)
    free.getArray()[system.constrained] = 0.0
    mass = system.mass.copy()
    start = mass.getOwnershipRange()[0]
    mass.zeroRowsColumns((system.constrained + start).astype(PETSc.IntType), diag=1.0)
    b = force.duplicate()
    b.pointwiseMult(force, free)
    ksp = PETSc.KSP().create(mass.comm)
    ksp.setType("cg")
    ksp.getPC().setType("jacobi")
    ksp.setOperators(mass)
    ksp.setTolerances(rtol=1e-13, atol=1e-300, max_it=1000)
    a = b.duplicate()
    a.set(0.0)
    ksp.solve(b, a)
    if ksp.getConvergedReason() < 0:
        raise JointsError(
            "The initial acceleration could not be found: the mass matrix is singular (is some "
            "density zero?)."
        )
    ksp.destroy()
    return a


@dataclass(frozen=True, kw_only=True)
class StepControl:
    """What to do where Newton fails on a step.

    Attributes:
        max_halvings: A step of length dt may be cut down to dt / 2**max_halvings.

    Raises:
        ValueError: The number is negative.
    """

    max_halvings: int = 6

    def __post_init__(self) -> None:
        """Check the number."""
        check_count("max_halvings", self.max_halvings, 0, "it must be zero or more")


def advance_halving(
    scheme: Scheme,
    solver: StepSolver,
    state: DynamicState,
    dt: float,
    control: StepControl,
) -> Iterator[tuple[DynamicState, StepReport]]:
    """Accepted steps from ``state`` over dt [s]: one, or more where Newton fails (collective).

    Sub-steps stay on the levels dt / 2^k, so that few matrices are factored.

    Raises:
        ConvergenceError: The shortest step allowed does not converge.
    """
    level, done = 0, 0  # done counts pieces of dt / 2^max_halvings
    finest = 2**control.max_halvings
    start = state.time
    while done < finest:
        pieces = finest >> level
        try:
            state, report = scheme.advance(solver, state, dt * pieces / finest)
        except ConvergenceError as failure:
            if level == control.max_halvings:
                raise located(failure, time=state.time + dt * pieces / finest) from None
            level += 1
            continue
        done += pieces
        if done == finest:
            state = replace(state, time=start + dt)
        yield state, report
        while level and done % (finest >> (level - 1)) == 0:
            level -= 1


def located(failure: ConvergenceError, **where: Any) -> ConvergenceError:
    """The same failure with stage, step or time filled in."""
    known = {name: value for name, value in vars(failure).items() if not name.startswith("_")}
    return ConvergenceError(**{**known, **where})


def check_step(dt: float) -> None:
    """Refuse a time step that is not positive.

    Raises:
        ValueError: It is zero, negative or not finite.
    """
    check_number("dt", dt, lambda v: v > 0, "positive and finite", unit="s")
