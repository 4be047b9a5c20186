# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Midpoint schemes for M a + C v + K u + B^T w t = F, for any matrices M, C and K."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar

import annotated_types as at
import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import refuses_removed
from dolfinx_joints.laws.law import BACKWARD_EULER, DISCRETE_GRADIENT, Floats, Response, Rule
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
from dolfinx_joints.time_integration.joints_before import joints_before
from dolfinx_joints.time_integration.products import Products, combination, joint_works, predictor
from dolfinx_joints.time_integration.scheme import StepReport, StepWork
from dolfinx_joints.time_integration.states import DynamicState


@dataclass(frozen=True, kw_only=True)
class _Midpoint:
    """Step of the midpoint schemes, which differ in the rule that evaluates the joint laws.

    With x = u1 - u0 and v1 = 2 x / dt - v0, equation (14) is

        (2/dt^2 M + 1/dt C + 1/2 K) x + B^T w t = (F0 + F1)/2 + 2/dt M v0 - K u0.

    The product of this equation and x is the energy balance of the step: the changes of kinetic and
    strain energy, the viscous loss, and the works of loads and joints. The balance closes to
    rounding error.
    """

    rule: ClassVar[Rule] = DISCRETE_GRADIENT
    exact_modes: ClassVar[int] = 0
    forces_over_steps: ClassVar[bool] = True

    def conserves(self, system: MatrixSystem) -> bool:
        """Return True if K is symmetric: the energy balance is then exact."""
        return system.symmetric

    def advance(
        self, solver: StepSolver, state: DynamicState, dt: float, end: float | None = None
    ) -> tuple[DynamicState, StepReport]:
        """Compute one step; see `Scheme.advance` (collective)."""
        if solver.system.bulk is not None and self.rule != DISCRETE_GRADIENT:
            raise ValueError(
                f"{type(self).__name__} evaluates the laws at the end of a step and the body at "
                "mid-step, which plastic cells do not support; use EnergyConsistent."
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
    """Midpoint rule with a discrete gradient of the joint energy: the energy balance always closes.

    In each step the joints dissipate exactly the friction work, for any step length and joint
    stiffness (`laws.points.discrete_gradient`). If all joints stick, or without joints, the scheme
    equals Newmark's average acceleration. The scheme is accurate only if the step resolves the
    motion. Check the local error, or let `StepControl` shorten the steps in which joints open or
    close.

    Attributes:
        exact_modes: Number of lowest modes, of the body cut at its joints, whose frequency and
            damping are exact; only modes with a circular frequency up to 1.5 / dt are corrected.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.Joints(dj.frictionless(normal_stiffness=1e9), initial_gaps={"joint_1": 0.001})
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=[dj.Fixed(group="base")])
        >>> up = lambda t: (0.0, 0.0, 10.0)  # the ground hits the upper block [m/s^2]
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
        effective: Coefficients of the matrix.
        rhs: Right-hand side of (14), less the remainder of the last step, plus the contributions
            of prescribed dofs and exact modes [N].
        x: u1 - u0, an initial guess until the step is solved; at prescribed dofs exact [m].
        joints: State of the joints at the start, as passed to the laws.
    """

    def __init__(
        self, system: MatrixSystem, state: DynamicState, dt: float, end: float, modes: int
    ) -> None:
        """Set up the step of length dt [s] from a state to the time ``end`` [s] (collective)."""
        self._system, self._dt, self._time = system, dt, end
        self._rate = rate = exact_square(2.0 / dt)
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
        self._prescribed = _PrescribedChange(system, state, self.x, rate, self._time, dt, exact)
        self._prescribed.add(self._prescribed.momentum, self.rhs, -0.5 * rate)
        self.joints = joints_before(system, state, self._prescribed.velocity, rate)

    @cached_property
    def _modal(self) -> Floats:
        """Displacement increments of the exact modes, once x is solved, shape (used,), [m]."""
        return self._amounts(self.x)

    @cached_property
    def _modal_rates(self) -> Floats:
        """Velocities of the exact modes at the start of the step, shape (used,), [m/s]."""
        return self._amounts(self._before.velocity)

    def _amounts(self, vector: PETSc.Vec) -> Floats:
        exact = self._exact
        return np.zeros(0) if exact is None else exact.modes.amounts(exact.used, vector)

    def products(self, joints: Response | None) -> Products:
        """Return the products with x, including mass and damping of exact modes (collective)."""
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
        self._prescribed.add(self._prescribed.velocity, velocity)
        if len(massless):
            # The scheme does not determine velocities of massless dofs: use the mean of the step.
            velocity.getArray()[massless] = self.x.array[massless] / self._dt
        self._prescribed.add(self._prescribed.momentum, momentum)
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
        """Return the works over the step, each by a separate formula (collective)."""
        system, before, exact = self._system, self._before, self._exact
        loads = system.work_of_loads(self.x, before.time, self._time)
        if exact is not None:
            of_supports = self._dt * exact.modes.support_amounts(exact.used, after.acceleration)
            kicks = self._prescribed.works(self._modal, self._modal_rates, self._rate, of_supports)
            for name, kick_work in kicks.items():
                loads[name] += kick_work
        supports = float(products.reaction.dot(self.x))
        supports += self._prescribed.work(before.momentum, after.momentum)
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


class _PrescribedChange:
    """Correction of the update v1 = 2 x / dt - v0 at prescribed dofs and in exact modes.

    Prescribed dofs get the prescribed velocities. With the midpoint update their velocities would
    oscillate without decay after each kink of the prescribed motion. Exact modes add a `LoadKick`.

    Attributes:
        velocity: v1 - (2 x / dt - v0), None if zero [m/s].
        momentum: M times ``velocity``, None if zero [N s].
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
    def add(part: PETSc.Vec | None, to: PETSc.Vec, factor: float = 1.0) -> None:
        """Add ``factor`` times a part to a vector, unless the part is None."""
        if part is not None:
            to.axpy(factor, part)

    def work(self, before: PETSc.Vec, after: PETSc.Vec) -> float:
        """Return the work of the supports due to the correction, from M v of start and end [J]."""
        if self.velocity is None:
            return 0.0
        change = (after.array_r - before.array_r)[self._fixed]
        local_work = 0.5 * float(self.velocity.array_r[self._fixed] @ change)
        return float(np.sum(before.comm.tompi4py().allgather(local_work)))

    def works(self, *parts: Any) -> dict[str, float]:
        """Return the work of each load due to the correction [J], see `LoadKick.work`."""
        return {} if self._kick is None else self._kick.work(*parts)


def exact_square(rate: float) -> float:
    """Return a rate within a relative 2e-8 of ``rate`` whose square is exact in double precision.

    Otherwise 2/dt and 2/dt^2 would be rounded inconsistently, with the same error in each step. In
    1e5 steps the energy would drift by a relative 1e-11.
    """
    mantissa, exponent = math.frexp(rate)
    return math.ldexp(round(mantissa * 2**26) / 2**26, exponent)
