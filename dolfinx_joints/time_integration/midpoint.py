# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Midpoint schemes for M a + C v + K u + B^T w t = F; unsymmetric M, C and K are allowed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any, ClassVar

import annotated_types as at
import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import refuses_removed
from dolfinx_joints.laws.law import (
    BACKWARD_EULER,
    DISCRETE_GRADIENT,
    Floats,
    JointState,
    Response,
    Rule,
)
from dolfinx_joints.model.exact_modes import ModalStep
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.effective_matrix import MatrixCoefficients
from dolfinx_joints.solvers.step_solver import StepSolver
from dolfinx_joints.time_integration.exact_steps import (
    LoadKick,
    add_free_vibration,
    add_inertia,
    add_modes,
    rescale,
)
from dolfinx_joints.time_integration.products import Products, combination, joint_works, predictor
from dolfinx_joints.time_integration.scheme import StepReport, StepWork
from dolfinx_joints.time_integration.states import DynamicState


@dataclass(frozen=True, kw_only=True)
class _Midpoint:
    """Step of the midpoint schemes, which differ in the rule that evaluates the joint laws.

    With x = u1 - u0 and v1 = 2 x / dt - v0, equation (14) is

        (2/dt^2 M + 1/dt C + 1/2 K) x + B^T w t = (F0 + F1)/2 + 2/dt M v0 - K u0.

    The product of this equation and x is the energy balance of the step: the changes of kinetic and
    strain energy, the viscous loss, and the works of loads and joints. If M and K are symmetric,
    the balance closes to rounding error.

    Attributes:
        forces_over_steps: True: tractions and reactions are means over the step.
    """

    rule: ClassVar[Rule] = DISCRETE_GRADIENT
    exact_modes: ClassVar[int] = 0
    forces_over_steps: ClassVar[bool] = True

    def conserves(self, system: MatrixSystem) -> bool:
        """Return True if the matrices are declared symmetric: the energy balance is then exact."""
        return system.symmetric

    def advance(
        self, solver: StepSolver, state: DynamicState, dt: float, end: float | None = None
    ) -> tuple[DynamicState, StepReport]:
        """Compute one step; see `Scheme.advance` (collective)."""
        if solver.system.bulk is not None and self.rule != DISCRETE_GRADIENT:
            raise ValueError(
                f"{type(self).__name__} does not support nonlinear cells: it evaluates joint laws "
                "at the end of a step, but the body at mid-step. Use EnergyConsistent."
            )
        rule = self.rule.over(dt)
        end = state.time + dt if end is None else end
        step = _Step(solver.system, state, dt, end, self.exact_modes)
        joints, solve = solver.solve(step.effective, step.rhs, step.x, step.joints, rule)
        products = step.products(joints)
        after = step.state_after(products, joints)
        work = step.work(products, after, rule)
        return after, StepReport(dt=dt, solve=solve, work=work, local_error=step.local_error(after))


@refuses_removed
@dataclass(frozen=True, kw_only=True)
@checked
class EnergyConsistent(_Midpoint):
    """Midpoint rule with a discrete gradient of the joint energy, for an exact energy balance.

    With symmetric matrices the balance closes to rounding error for any step length and joint
    stiffness: friction joints dissipate exactly their friction work
    (`laws.points.discrete_gradient`). Rigid joints with restitution 0 also lose energy in impacts.
    Laws without a discrete gradient are evaluated at the end of the step; their energy error then
    depends on the step. If all joints stick, or without joints, the scheme equals Newmark's average
    acceleration. It is accurate only if the step resolves the motion: check the local error, or let
    `StepControl` shorten the steps in which joints open or close.

    Attributes:
        exact_modes: Number of lowest modes, of the body cut at its joints, that are integrated with
            their exact frequency and damping. Modes above the circular frequency 1.5 / dt are not.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.Joints(dj.frictionless(normal_stiffness=1e9), initial_gaps={"joint_1": 0.001})
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=[dj.Fixed(group="base")])
        >>> up = lambda t: (0.0, 0.0, 10.0)  # ground acceleration [m/s^2]
        >>> run = dj.Simulation(model)
        >>> outcome = run.dynamics(dt=0.001, steps=20, motion=up, scheme=dj.EnergyConsistent())
        >>> abs(outcome.energy_error) < 1e-9
        True
    """

    exact_modes: Annotated[int, at.Ge(0)] = 0  # type: ignore[misc]


@dataclass(frozen=True, kw_only=True)
class ImplicitContact(_Midpoint):
    """Midpoint rule for the body, backward Euler for the joints: impacts never create energy.

    The tractions at the end of a step act over the whole step (Kane, Repetto, Ortiz, Marsden 1999).
    The energy lost in impacts counts as a numerical loss.
    """

    rule: ClassVar[Rule] = BACKWARD_EULER


class _Step:
    """Equation of one step, and the quantities derived from its solution x.

    Attributes:
        effective: Coefficients of M', C' and K in the matrix of (14).
        rhs: Right-hand side of (14) minus the residual that the last step left, and minus the
            velocity correction times M' / dt [N].
        x: u1 - u0, an initial guess until the step is solved; at prescribed dofs exact [m].
        joints: State of the joints at the start, as passed to the laws.
    """

    def __init__(
        self, system: MatrixSystem, state: DynamicState, dt: float, end: float, modes: int
    ) -> None:
        """Set up the step of length dt [s] from a state to the time ``end`` [s] (collective)."""
        self._system, self._dt, self._time = system, dt, end
        self._rate = rate = _rate_with_exact_square(2.0 / dt)
        self._before = state = rescale(system, state, modes, rate)
        self.effective = MatrixCoefficients(
            mass=0.5 * rate**2, damping=0.5 * rate, stiffness=0.5, exact_modes=modes
        )
        self._exact = exact = self.effective.modal_step(system)
        self._load = system.load(self._time, state.load.duplicate())
        terms = [(0.5, self._load), (0.5, state.load)]
        terms += [(rate, state.momentum), (-1.0, state.elastic_force)]
        if state.remainder is not None:
            terms.append((-1.0, state.remainder))
        self.rhs = combination(*terms)
        self.x = predictor(state, (dt, state.velocity))
        fixed = system.constrained
        increment = system.prescribed(self._time) - state.displacement.array[fixed]
        self.x.getArray()[fixed] = increment
        self._correction = _VelocityCorrection(system, state, self.x, rate, self._time, dt, exact)
        self._correction.add(self._correction.momentum, self.rhs, -0.5 * rate)
        self.joints = joints_before(system, state, self._correction.velocity, rate)

    @cached_property
    def _modal(self) -> Floats:
        """Modal components of x, to be read after the solve, shape (used modes,), [kg^1/2 m]."""
        return self._modal_components(self.x)

    @cached_property
    def _modal_rates(self) -> Floats:
        """Modal velocities at the start of the step, shape (used modes,), [kg^1/2 m/s]."""
        return self._modal_components(self._before.velocity)

    def _modal_components(self, vector: PETSc.Vec) -> Floats:
        """Return phi.M u in the exact modes used in this step (collective)."""
        exact = self._exact
        return np.zeros(0) if exact is None else exact.modes.amounts(exact.used, vector)

    def products(self, joints: Response | None) -> Products:
        """Return M' x, K x and the other products with x of the step (collective)."""
        system, exact = self._system, self._exact
        products = Products(system, self.effective, self.rhs, self.x, joints)
        if exact is not None:
            add_modes(exact, products, self.effective, self.x, self._modal, system.constrained)
        return products

    def state_after(self, products: Products, joints: Response | None) -> DynamicState:
        """Return the state at the end of the step (collective)."""
        before, massless = self._before, self._system.massless
        velocity = combination((self._rate, self.x), (-1.0, before.velocity))
        momentum = combination((self._rate, products.mass), (-1.0, before.momentum))
        self._correction.add(self._correction.velocity, velocity)
        if len(massless):
            # The scheme does not determine velocities of massless dofs: use the mean of the step.
            velocity.getArray()[massless] = self.x.array[massless] / self._dt
        self._correction.add(self._correction.momentum, momentum)
        acceleration = combination((1.0, velocity), (-1.0, before.velocity))
        acceleration.scale(1.0 / self._dt)
        return DynamicState(
            time=self._time,
            displacement=combination((1.0, before.displacement), (1.0, self.x)),
            velocity=velocity,
            acceleration=acceleration,
            load=self._load,
            reaction=products.reaction,
            momentum=momentum,
            elastic_force=combination((1.0, before.elastic_force), (1.0, products.stiffness)),
            joints=joints,
            remainder=products.remainder,
            exact_modes=before.exact_modes,
            rate=self._rate,
        )

    def work(self, products: Products, after: DynamicState, rule: Rule) -> StepWork:
        """Return the works over the step by separate formulas, to check (14) (collective)."""
        system, before, exact = self._system, self._before, self._exact
        loads = system.work_of_loads(self.x, before.time, self._time)
        if exact is not None:
            support_momentum = self._dt * exact.modes.support_amounts(
                exact.used, after.acceleration
            )
            kick_works = self._correction.works(
                self._modal, self._modal_rates, self._rate, support_momentum
            )
            for name, kick_work in kick_works.items():
                loads[name] += kick_work
        supports = float(products.reaction.dot(self.x))
        supports += self._correction.work(before.momentum, after.momentum)
        return StepWork(
            loads=loads,
            supports=supports,
            viscous=products.viscous,
            absorbed=products.absorbed,
            joints=joint_works(system, before, after.joints, rule, mean_traction=False),
        )

    def local_error(self, after: DynamicState) -> float:
        """Return the displacement error of the step, equation (33) [m] (collective)."""
        change = combination((1.0, after.acceleration), (-1.0, self._before.acceleration))
        if self._exact is not None:
            add_free_vibration(self._exact, self._modal_rates, self._dt, change)
        return self._system.norm(change) * self._dt**2 / 12.0


class _VelocityCorrection:
    """Correction of the update v1 = 2 x / dt - v0 at prescribed dofs and in exact modes.

    Prescribed dofs get the prescribed velocities. With the midpoint update their velocities would
    oscillate without decay after each kink of the prescribed motion. In exact modes `LoadKick` adds
    the velocity correction (19c) for loads that change in the step.

    Attributes:
        velocity: v1 - (2 x / dt - v0), None if zero [m/s].
        momentum: M' times ``velocity``, None if zero [N s].
    """

    def __init__(
        self,
        system: MatrixSystem,
        state: DynamicState,
        x: PETSc.Vec,
        rate: float,
        time: float,
        dt: float,
        exact: ModalStep | None,
    ) -> None:
        """Compute the correction (collective)."""
        self.velocity: PETSc.Vec | None = None
        self.momentum: PETSc.Vec | None = None
        self._fixed = system.constrained
        self._kick = None if exact is None else LoadKick(system, exact, state.time, time)
        rates = system.prescribed_rates(time, dt)
        if rates is None and exact is None:
            return
        self.velocity, self.momentum = x.duplicate(), x.duplicate()
        self.velocity.set(0.0)
        self.momentum.set(0.0)
        if rates is not None:
            midpoint = rate * x.array[self._fixed] - state.velocity.array[self._fixed]
            self.velocity.getArray()[self._fixed] = rates[0] - midpoint
            system.mass.mult(self.velocity, self.momentum)
            if exact is not None:
                add_inertia(exact, self.velocity, self.momentum)
        if self._kick is not None:
            self._kick.add(self.velocity, self.momentum)

    @staticmethod
    def add(correction: PETSc.Vec | None, to: PETSc.Vec, factor: float = 1.0) -> None:
        """Add ``factor`` times a correction to a vector, unless the correction is None."""
        if correction is not None:
            to.axpy(factor, correction)

    def work(self, before: PETSc.Vec, after: PETSc.Vec) -> float:
        """Return the work of the supports due to the correction, from M' v at start and end [J]."""
        if self.velocity is None:
            return 0.0
        change = (after.array_r - before.array_r)[self._fixed]
        local_work = 0.5 * float(self.velocity.array_r[self._fixed] @ change)
        return float(np.sum(before.comm.tompi4py().allgather(local_work)))

    def works(self, *arguments: Any) -> dict[str, float]:
        """Return the work of each load due to the correction [J]; see `LoadKick.work`."""
        return {} if self._kick is None else self._kick.work(*arguments)


def _rate_with_exact_square(rate: float) -> float:
    """Return ``rate`` rounded to 26 bits, so that its square is exact in double precision.

    The matrix and the update of a step use this rate, which differs from 2/dt by a relative 1.5e-8
    at most. With 2/dt itself, 2/dt and 2/dt^2 would be rounded differently, with the same error in
    each step: the energy would drift by a relative 1e-11 in 1e5 steps.
    """
    mantissa, exponent = math.frexp(rate)
    return math.ldexp(round(mantissa * 2**26) / 2**26, exponent)


def joints_before(
    system: MatrixSystem, state: DynamicState, correction: PETSc.Vec | None, rate: float
) -> JointState | None:
    """Return the joint state with slips scaled to the step length, and approaches without rebound.

    ``correction`` is v1 - (2 x / dt - v0), None if zero [m/s]; ``rate`` is 2 / dt [1/s].
    """
    if state.joints is None:
        return None
    joints = state.joints.state
    if len(joints.slips) and state.rate not in (0.0, rate):
        joints = replace(joints, slips=rescaled_slips(joints.slips, state.rate / rate))
    if system.contact is None or not system.contact.stops:
        return joints
    velocity = state.velocity.copy()
    if correction is not None:
        velocity.axpy(-1.0, correction)  # Without rebound, 0 = v1 = 2 x / dt - (v0 - correction).
    if len(system.massless):
        # Velocities of massless dofs are means of the last step: extrapolate them to its end.
        massless = system.massless
        velocity.getArray()[massless] += state.acceleration.array[massless] / rate
    approach = 2.0 / rate * system.contact.operator.jump(velocity)[:, 0]
    return replace(joints, approach=approach)


def rescaled_slips(slips: Floats, times: float) -> Floats:
    """Return the last two slips for steps ``times`` as long; slip is a parabola in time."""
    slips = slips.copy()
    last, before = slips[:, :2], slips[:, 2:4]
    change = times**2 * (last - before)
    end = times * (1.5 * last - 0.5 * before)
    slips[:, :2], slips[:, 2:4] = end - 0.5 * change, end - 1.5 * change
    return slips
