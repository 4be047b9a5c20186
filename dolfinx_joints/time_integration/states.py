# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a time scheme goes from and to, and how it begins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.errors import ConvergenceError, JointsError
from dolfinx_joints.joints.contact import Rule
from dolfinx_joints.laws.law import Floats, JointState, Response
from dolfinx_joints.model.mass_redistribution import joint_dofs
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.direct import MatrixCoefficients
from dolfinx_joints.solvers.newton import SolveReport, StepSolver

# Spacing of the differences that give the first velocity and acceleration of moving supports [s].
SPACING = 1e-4

# Of the loads or elastic forces, that may be left where there is no mass at the start.
LARGEST_FORCE = 1e-6


@dataclass(frozen=True, kw_only=True)
class DynamicState:
    """State of a system at one time; never changed once made.

    Attributes:
        time: Time [s].
        displacement: u [m].
        velocity: v [m/s].
        acceleration: a, or its mean over the last step where the scheme knows no other [m/s^2].
        load: Nodal loads F [N].
        reaction: Forces of the supports on the body at constrained dofs, zero elsewhere: at this
            time, or their mean over the last step where the scheme knows no other [N].
        momentum: M v [N s].
        elastic_force: K u [N].
        joints: Response of the joints and of plastic cells, None without both.
        remainder: What rounding left of the last step's equation at the free dofs, None at the
            start [N]. Taken into the next step it does not add up over many of them.
        water: What the water in ``load`` does at the local joint points (`Wetness`), shape (n,),
            None where no load depends on the joints.
    """

    time: float
    displacement: PETSc.Vec
    velocity: PETSc.Vec
    acceleration: PETSc.Vec
    load: PETSc.Vec
    reaction: PETSc.Vec
    momentum: PETSc.Vec
    elastic_force: PETSc.Vec
    joints: Response | None
    remainder: PETSc.Vec | None = None
    water: NDArray[np.int8] | None = None

    @property
    def kinetic_energy(self) -> float:
        """v.M v / 2 [J] (collective)."""
        return 0.5 * float(self.velocity.dot(self.momentum))

    @property
    def strain_energy(self) -> float:
        """u.K u / 2 of bulk and springs, plastic strains apart [J] (collective)."""
        return 0.5 * float(self.displacement.dot(self.elastic_force))


@dataclass(frozen=True, kw_only=True)
class StepWork:
    """Works of a step as the scheme itself balances them.

    Attributes:
        loads: Of each load by name [J].
        supports: Of moving supports [J].
        viscous: Against the damping [J].
        joints: Of the body on each joint, shape (number of joints,), [J].
    """

    loads: Mapping[str, float]
    supports: float
    viscous: float
    joints: Floats


@dataclass(frozen=True, kw_only=True)
class StepReport:
    """A step.

    Attributes:
        dt: Its length [s].
        solve: How its solve went.
        work: Works.
        local_error: Estimate of the displacement error made in this step, 2-norm over all dofs [m].
    """

    dt: float
    solve: SolveReport
    work: StepWork
    local_error: float


class Scheme(Protocol):
    """A time scheme: parameters, and one step.

    Attributes:
        rule: What it asks the laws for.
    """

    @property
    def rule(self) -> Rule:
        """See above."""

    def conserves(self, system: MatrixSystem) -> bool:
        """Whether its balance is exact for a system: what is missing then tells of the solve."""

    def advance(
        self, solver: StepSolver, state: DynamicState, dt: float
    ) -> tuple[DynamicState, StepReport]:
        """The state a step later; raises ConvergenceError and leaves ``state`` as it was."""


class Products:
    """M x and K x of the change x of a step, and what of its equation is left.

    Attributes:
        mass: M x.
        stiffness: K x.
        viscous: x.C x times the coefficient of C in the equation [J].
        reaction: Residual of the step's equation at the constrained dofs, zero elsewhere [N].
        remainder: The same at the free dofs [N].
    """

    def __init__(
        self,
        solver: StepSolver,
        effective: MatrixCoefficients,
        b: PETSc.Vec,
        x: PETSc.Vec,
        joints: Response | None,
    ) -> None:
        """Multiply (collective).

        Raises:
            ConvergenceError: The residual is not finite.
        """
        system = solver.system
        self.mass, self.stiffness, self.reaction = (b.duplicate() for _ in range(3))
        system.mass.mult(x, self.mass)
        system.stiffness.mult(x, self.stiffness)
        products = [self.mass, self.stiffness]
        factors = np.array([effective.mass, effective.stiffness])
        damped = np.array(
            system.coefficients(effective.mass, effective.damping, effective.stiffness)
        )
        # The difference of what the equation holds: nothing of it goes unaccounted by rounding.
        self.viscous = float((damped - factors) @ [product.dot(x) for product in products])
        residual = combination((-1.0, b), *zip(damped, products, strict=True))
        if system.dashpots is not None:
            system.dashpots.mult(x, self.reaction)
            residual.axpy(effective.damping, self.reaction)
            self.viscous += effective.damping * float(self.reaction.dot(x))
        if system.resistance is not None and joints is not None:
            residual.axpy(1.0, system.resistance.force(joints, self.reaction))
        norm = float(residual.norm())
        if not np.isfinite(norm):
            raise ConvergenceError(iteration=1, residual=norm)
        self.reaction.set(0.0)
        held = system.constrained
        self.reaction.getArray()[held] = residual.getArray(readonly=True)[held]
        residual.getArray()[held] = 0.0
        self.remainder = residual


def combination(*terms: tuple[float, PETSc.Vec]) -> PETSc.Vec:
    """A new vector, the sum of factors times vectors."""
    (factor, first), *others = terms
    total = first.copy()
    total.scale(factor)
    for factor, vector in others:
        total.axpy(factor, vector)
    return total


def joint_work(
    system: MatrixSystem, before: DynamicState, joints: Response | None, *, mean_traction: bool
) -> Floats:
    """Work of the body on each joint in a step [J] (collective).

    Args:
        system: The system.
        before: State at the start of the step.
        joints: Response of the joints at its end.
        mean_traction: Take the mean of the tractions of both, not those of the response.
    """
    if system.contact is None or before.joints is None or joints is None:
        return np.zeros(0)
    traction = joints.traction
    if mean_traction:
        traction = 0.5 * (traction + before.joints.traction)
    moved = joints.state.gap - before.joints.state.gap
    return system.contact.integrals(np.einsum("ij,ij->i", traction, moved))


def initial_state(
    solver: StepSolver,
    *,
    time: float = 0.0,
    displacement: PETSc.Vec | None = None,
    velocity: PETSc.Vec | None = None,
    joints: JointState | Response | None = None,
    water: NDArray[np.int8] | None = None,
) -> DynamicState:
    """State whose acceleration balances the forces at the start of the motion (collective).

    Args:
        solver: Solver of the system.
        time: Start [s].
        displacement: u [m]; zero unless given, but for prescribed dofs.
        velocity: v [m/s], zero unless given.
        joints: State of the joints, asked for their tractions at ``displacement``, or the response
            that led there, taken as it is; at rest at ``displacement`` unless given.
        water: `DynamicState.water`; by the openings unless given.
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
    if system.water is not None and system.contact is not None:
        known = joints.state if isinstance(joints, Response) else joints
        water = system.water.enter(system.contact.gap(u) if known is None else known.gap, water)
    load = system.load(time, u.duplicate())
    force = load.copy()
    work = u.duplicate()
    elastic_force = u.duplicate()
    system.stiffness.mult(u, elastic_force)
    force.axpy(-1.0, elastic_force)
    force.axpy(-1.0, system.damping_force(v, work))
    system.mass.mult(moving, work)
    force.axpy(-1.0, work)
    response = None
    if system.resistance is not None:
        response = joints if isinstance(joints, Response) else None
        if not isinstance(joints, Response):
            response = system.resistance.trial(u, joints or system.resistance.at_rest(u))
        assert response is not None
        system.resistance.force_at_end(response, work)
        force.axpy(-1.0, work)
    if velocity is None:
        _check_massless(system, force, max(load.norm(), elastic_force.norm()))
    a = _balance(system, force)
    reaction = force.duplicate()
    system.mass.mult(a, reaction)
    reaction.axpy(-1.0, force)
    a.axpy(1.0, moving)
    held = np.zeros(reaction.getLocalSize())
    held[system.constrained] = reaction.getArray(readonly=True)[system.constrained]
    reaction.setArray(held)
    momentum = v.duplicate()
    system.mass.mult(v, momentum)
    return DynamicState(
        time=time,
        displacement=u,
        velocity=v,
        acceleration=a,
        load=load,
        reaction=reaction,
        momentum=momentum,
        elastic_force=elastic_force,
        joints=response,
        water=water,
    )


def _check_massless(system: MatrixSystem, force: PETSc.Vec, scale: float) -> None:
    """Refuse a start from rest with massless parts, joints aside, out of balance (collective).

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
    """Acceleration with M a = force at the free dofs with mass and zero at all others."""
    resting = np.zeros(force.getLocalSize(), dtype=bool)
    resting[system.constrained] = True
    unconstrained_dofs = int((~resting).sum())
    resting[system.massless] = True
    left = [unconstrained_dofs, int((~resting).sum())]
    unconstrained_dofs, moving = np.sum(force.comm.tompi4py().allgather(left), axis=0)
    if unconstrained_dofs and not moving:
        raise JointsError(
            "The body has no mass: all densities are zero, which dynamics cannot do with; "
            "quasi_statics can."
        )
    free = force.duplicate()
    free.setArray(np.where(resting, 0.0, 1.0))
    mass = system.mass.copy()
    rows = np.flatnonzero(resting) + mass.getOwnershipRange()[0]
    mass.zeroRowsColumns(rows.astype(PETSc.IntType), diag=1.0)
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
            "The initial acceleration could not be found: the mass matrix is singular (has a part "
            "of the body mass in some directions only?)."
        )
    ksp.destroy()
    return a
