# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Schemes that satisfy equilibrium at the end of steps: Newmark, HHT-alpha, generalized-alpha."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import annotated_types as at
from petsc4py import PETSc

from dolfinx_joints.common.declared import checked
from dolfinx_joints.laws.law import BACKWARD_EULER, Rule
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.effective_matrix import MatrixCoefficients
from dolfinx_joints.solvers.step_solver import StepSolver
from dolfinx_joints.time_integration.products import Products, combination, joint_works, predictor
from dolfinx_joints.time_integration.scheme import StepReport, StepWork
from dolfinx_joints.time_integration.states import DynamicState


class _Alpha:
    """Step of the generalized-alpha method, shared by all schemes of this module.

    Equations (18) and (19): M a_m + C v_f + K u_f + B^T w t_f = F_f, where
    a_m = (1 - alpha_m) a1 + alpha_m a0, v_f to F_f are weighted with alpha_f in the same way, and

    u1 = u0 + dt v0 + dt^2 ((1/2 - beta) a0 + beta a1),  v1 = v0 + dt ((1 - gamma) a0 + gamma a1).
    """

    rule: ClassVar[Rule] = BACKWARD_EULER
    forces_over_steps: ClassVar[bool] = False

    @property
    def alpha_m(self) -> float:
        """Weight of the start of the step in the inertia forces."""
        return 0.0

    @property
    def alpha_f(self) -> float:
        """Weight of the start of the step in all other forces."""
        return 0.0

    @property
    def beta(self) -> float:
        """Newmark's beta, chosen for the largest damping of high frequencies."""
        return 0.25 * (1.0 - self.alpha_m + self.alpha_f) ** 2

    @property
    def gamma(self) -> float:
        """Newmark's gamma, chosen for second-order accuracy."""
        return 0.5 - self.alpha_m + self.alpha_f

    def conserves(self, system: MatrixSystem) -> bool:
        """Return True for average acceleration with symmetric K and supports at rest."""
        average = (self.alpha_m, self.alpha_f, self.beta, self.gamma) == (0.0, 0.0, 0.25, 0.5)
        return average and system.symmetric and system.values is None

    def advance(
        self, solver: StepSolver, state: DynamicState, dt: float, end: float | None = None
    ) -> tuple[DynamicState, StepReport]:
        """Compute one step; see `Scheme.advance` (collective)."""
        system, time = solver.system, state.time + dt if end is None else end
        share = 1.0 - self.alpha_f
        of_mass, of_damping = 1.0 / (self.beta * dt**2), self.gamma / (self.beta * dt)
        # a1 = of_mass x + a_known and v1 = of_damping x + v_known.
        v, a = state.velocity, state.acceleration
        a_known = combination((-1.0 / (self.beta * dt), v), (1.0 - 0.5 / self.beta, a))
        v_known = combination(
            (1.0 - self.gamma / self.beta, v), (dt * (1.0 - 0.5 * self.gamma / self.beta), a)
        )
        x = predictor(state, (dt, v), (0.5 * dt**2, a))
        fixed = system.constrained
        x.getArray()[fixed] = system.prescribed(time) - state.displacement.array[fixed]
        # a1 is second-order accurate at the time t1 - (alpha_f - alpha_m) dt, not at t1.
        rates = system.prescribed_rates(time, dt, late=self.alpha_f - self.alpha_m)
        if rates is not None:
            # Support accelerations computed from the displacements by (19) would oscillate.
            a_known.getArray()[fixed] = rates[1] - of_mass * x.array[fixed]
            v_known.getArray()[fixed] = rates[0] - of_damping * x.array[fixed]
        load = system.load(time, state.load.duplicate())
        b = self._right_hand_side(solver, state, load, a_known, v_known)
        before = None if state.joints is None else state.joints.state
        effective = MatrixCoefficients(
            mass=(1.0 - self.alpha_m) / share * of_mass, damping=of_damping, stiffness=1.0
        )
        joints, solve = solver.solve(effective, b, x, before, self.rule.over(dt))
        products = Products(system, effective, b, x, joints)
        a_known.axpy(of_mass, x)
        v_known.axpy(of_damping, x)
        momentum = v_known.duplicate()
        system.mass.mult(v_known, momentum)
        after = DynamicState(
            time=time,
            displacement=combination((1.0, state.displacement), (1.0, x)),
            velocity=v_known,
            acceleration=a_known,
            load=load,
            reaction=products.reaction,
            momentum=momentum,
            elastic_force=combination((1.0, state.elastic_force), (1.0, products.stiffness)),
            joints=joints,
        )
        work = StepWork(
            loads=system.work_of_loads(x, state.time, time),
            supports=0.5 * float(state.reaction.dot(x) + products.reaction.dot(x)),
            viscous=products.viscous / (of_damping * dt),
            absorbed=products.absorbed / (of_damping * dt),
            joints=joint_works(system, state, joints, self.rule.over(dt), mean_traction=True),
        )
        change = combination((1.0, a_known), (-1.0, a))
        error = system.norm(change) * dt**2 * abs(self.beta - 1.0 / 6.0)
        return after, StepReport(dt=dt, solve=solve, work=work, local_error=error)

    def _right_hand_side(
        self,
        solver: StepSolver,
        state: DynamicState,
        load: PETSc.Vec,
        a_known: PETSc.Vec,
        v_known: PETSc.Vec,
    ) -> PETSc.Vec:
        """Return the right-hand side of the equation, divided by 1 - alpha_f, [N]."""
        system, old, share = solver.system, self.alpha_f, 1.0 - self.alpha_f
        b = combination((1.0, load), (old / share, state.load), (-1.0 / share, state.elastic_force))
        mean = combination((1.0 - self.alpha_m, a_known), (self.alpha_m, state.acceleration))
        work = b.duplicate()
        system.mass.mult(mean, work)
        b.axpy(-1.0 / share, work)
        mean.waxpy(old / share, state.velocity, v_known)
        b.axpy(-1.0, system.damping_force(mean, work))
        if old:
            # Add the forces at the start: the residual at supports is then the reaction at the end.
            b.axpy(old / share, state.reaction)
            if system.internal_forces is not None and state.joints is not None:
                b.axpy(-old / share, system.internal_forces.force_at_end(state.joints, work))
        return b


@dataclass(frozen=True, kw_only=True)
@checked
class Newmark(_Alpha):
    """Newmark's method (1959); by default average acceleration, the scheme of the paper.

    Average acceleration (beta 1/4, gamma 1/2) conserves the energy of a linear system, but not the
    energy of joints that open and close.

    Attributes:
        beta: Weight of a1, the acceleration at the end of the step, in the displacement (19).
        gamma: Weight of a1 in the velocity (19); below 1/2 the method is unstable.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.frictionless(normal_stiffness=1e11)
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=[dj.Fixed(group="base")])
        >>> along = lambda t: (1.0, 0.0, 0.0)  # the ground moves, the upper block slides [m/s^2]
        >>> run = dj.Simulation(model)
        >>> end = run.dynamics(dt=0.01, steps=10, motion=along, scheme=dj.Newmark()).state
        >>> round(end.displacement.min()[1], 5)  # relative to the ground, -0.5 * 1 * 0.1^2 [m]
        -0.005
    """

    beta: Annotated[float, at.Gt(0), at.Le(0.5)] = 0.25
    gamma: Annotated[float, at.Ge(0.5), at.Le(1)] = 0.5


@dataclass(frozen=True, kw_only=True)
@checked
class HilberHughesTaylor(_Alpha):
    """HHT-alpha method (1977): second-order accurate, damps high frequencies.

    Attributes:
        alpha: Weight of the start of the step in the forces; 0 is average acceleration.
    """

    alpha: Annotated[float, at.Ge(0), at.Le(1 / 3)] = 0.1

    @property
    def alpha_f(self) -> float:
        """Weight of the start of the step in all forces except inertia."""
        return self.alpha


@dataclass(frozen=True, kw_only=True)
@checked
class GeneralizedAlpha(_Alpha):
    """Generalized-alpha method (Chung and Hulbert 1993) with given damping of high frequencies.

    Attributes:
        spectral_radius: Value at infinite frequency, from 0 (damped out in a step) to 1 (undamped).
    """

    spectral_radius: Annotated[float, at.Ge(0), at.Le(1)] = 0.8

    @property
    def alpha_m(self) -> float:
        """Weight of the start of the step in the inertia forces."""
        return (2.0 * self.spectral_radius - 1.0) / (self.spectral_radius + 1.0)

    @property
    def alpha_f(self) -> float:
        """Weight of the start of the step in all other forces."""
        return self.spectral_radius / (self.spectral_radius + 1.0)
