# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Midpoint schemes; each marches M a + C v + K u + B^T w t = F with any matrices."""

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
    complete,
    scaled,
)
from dolfinx_joints.time_integration.joints_before import joints_before
from dolfinx_joints.time_integration.products import Products, combination, guess, joint_works
from dolfinx_joints.time_integration.scheme import StepReport, StepWork
from dolfinx_joints.time_integration.states import DynamicState


@dataclass(frozen=True, kw_only=True)
class _Midpoint:
    """The step that the midpoint schemes share; they differ in what they ask the laws for.

    With x = u1 - u0 and v1 = 2 x / dt - v0,

        (2/dt^2 M + 1/dt C + 1/2 K) x + B^T w t = (F0 + F1)/2 + 2/dt M v0 - K u0.

    Times x this is the change of kinetic and strain energy, the viscous loss, the work of the loads
    and that of the joints, to rounding.
    """

    rule: ClassVar[Rule] = DISCRETE_GRADIENT
    exact_modes: ClassVar[int] = 0
    forces_over_steps: ClassVar[bool] = True

    def conserves(self, system: MatrixSystem) -> bool:
        """Whether the balance is exact: where K has an energy."""
        return system.symmetric

    def advance(
        self, solver: StepSolver, state: DynamicState, dt: float, end: float | None = None
    ) -> tuple[DynamicState, StepReport]:
        """One step; see `Scheme.advance` (collective)."""
        if solver.system.bulk is not None and self.rule != DISCRETE_GRADIENT:
            raise ValueError(
                f"{type(self).__name__} asks laws for the end of steps that the body takes in the "
                "middle, which plastic cells cannot do; take EnergyConsistent."
            )
        rule = self.rule.over(dt)
        end = state.time + dt if end is None else end
        step = _Step(solver.system, state, dt, end, self.exact_modes)
        joints, solve = solver.solve(step.effective, step.known, step.x, step.joints, rule)
        products = step.products(joints)
        after = step.state_after(products, joints)
        work = step.work(products, after, rule)
        return after, StepReport(dt=dt, solve=solve, work=work, local_error=step.local_error(after))


@refuses_removed
@dataclass(frozen=True, kw_only=True)
@checked
class EnergyConsistent(_Midpoint):
    """Midpoint rule with the discrete gradient of the joints' energy: the balance always closes.

    What friction dissipates is all that joints take from a step, at any length of step and however
    stiff they are (`laws.points.discrete_gradient`). Where all joints stick, and without joints,
    this is Newmark's average acceleration. Accurate it is only where the step resolves the motion:
    watch the local error, and let `StepControl` shorten steps in which joints open or close.

    Attributes:
        exact_modes: Number of lowest modes, of the body cut at its joints, whose phase and damping
            are exact; of them a step takes those with omega dt up to 1.5.
    """

    exact_modes: Annotated[int, at.Ge(0)] = 0  # type: ignore[misc]


@dataclass(frozen=True, kw_only=True)
class ImplicitContact(_Midpoint):
    """Midpoint rule for the body, backward Euler for the joints: impacts lose energy, never gain.

    The tractions of the end of a step act over the whole of it (Kane, Repetto, Ortiz, Marsden
    1999). What impacts lose is counted as numerical.
    """

    rule: ClassVar[Rule] = BACKWARD_EULER


class _Step:
    """The equation of one step, and what follows once a solver has found its x.

    Attributes:
        effective: Coefficients of the matrix.
        known: (F0 + F1)/2 + 2/dt M v0 - K u0, the remainder of the last step, and what prescribed
            dofs and exact modes change [N].
        x: u1 - u0, a guess until it is solved for; prescribed dofs are as they must be [m].
        joints: State of the joints as laws take it at the start.
    """

    def __init__(
        self, system: MatrixSystem, state: DynamicState, dt: float, end: float, modes: int
    ) -> None:
        """Set up the step of length dt [s] from a state to a time [s], exact in some modes.

        (Collective.)
        """
        self._system, self._dt, self._time = system, dt, end
        self._rate = rate = exact_square(2.0 / dt)
        self._before = state = scaled(system, state, modes, rate)
        self.effective = MatrixCoefficients(
            mass=0.5 * rate**2, damping=0.5 * rate, stiffness=0.5, exact_modes=modes
        )
        self._exact = exact = self.effective.modal_step(system)
        self._load = system.load(self._time, state.load.duplicate())
        known = [(0.5, self._load), (0.5, state.load)]
        known += [(rate, state.momentum), (-1.0, state.elastic_force)]
        if state.remainder is not None:
            known.append((-1.0, state.remainder))
        self.known = combination(*known)
        self.x = guess(state, (dt, state.velocity))
        fixed = system.constrained
        moved = system.prescribed(self._time) - state.displacement.array[fixed]
        self.x.getArray()[fixed] = moved
        self._prescribed = _PrescribedChange(system, state, self.x, rate, self._time, dt, exact)
        self._prescribed.add(self._prescribed.momentum, self.known, -0.5 * rate)
        self.joints = joints_before(system, state, self._prescribed.velocity, rate)

    @cached_property
    def _modal(self) -> Floats:
        """Phi.M x of the exact modes, once x is solved for, shape (used,), [m]."""
        return self._amounts(self.x)

    @cached_property
    def _modal_rates(self) -> Floats:
        """Their velocities at the start, shape (used,), [m/s]."""
        return self._amounts(self._before.velocity)

    def _amounts(self, vector: PETSc.Vec) -> Floats:
        exact = self._exact
        return np.zeros(0) if exact is None else exact.modes.amounts(exact.used, vector)

    def products(self, joints: Response | None) -> Products:
        """M x and K x, with the mass and damping of exact modes (collective)."""
        system, exact = self._system, self._exact
        products = Products(system, self.effective, self.known, self.x, joints)
        if exact is not None:
            complete(exact, products, self.effective, self.x, self._modal, system.constrained)
        return products

    def state_after(self, products: Products, joints: Response | None) -> DynamicState:
        """The state at the end of the step (collective)."""
        before, massless = self._before, self._system.massless
        velocity = combination((self._rate, self.x), (-1.0, before.velocity))
        momentum = combination((self._rate, products.mass), (-1.0, before.momentum))
        self._prescribed.add(self._prescribed.velocity, velocity)
        if len(massless):
            # Nothing holds the velocities of these to those before: take the mean of the step.
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
        """Works over the step, each by its own formula (collective)."""
        system, before, exact = self._system, self._before, self._exact
        loads = system.work_of_loads(self.x, before.time, self._time)
        if exact is not None:
            of_supports = self._dt * exact.modes.carried(exact.used, after.acceleration)
            kicks = self._prescribed.works(self._modal, self._modal_rates, self._rate, of_supports)
            for name, kicked in kicks.items():
                loads[name] += kicked
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
        """Error of the displacement in the step, equation (33) [m] (collective)."""
        change = combination((1.0, after.acceleration), (-1.0, self._before.acceleration))
        if self._exact is not None:
            add_free_vibration(self._exact, self._modal_rates, self._dt, change)
        return self._system.norm(change) * self._dt**2 / 12.0


class _PrescribedChange:
    """Change that prescribed dofs and exact modes make to the midpoint rule.

    The velocities of prescribed dofs are prescribed, too: left to v1 = 2 x / dt - v0, they would
    swing for ever after every corner of their motion. In exact modes there is a `LoadKick`.

    Attributes:
        velocity: v1 - (2 x / dt - v0), None where it is zero [m/s].
        momentum: M times that, or None [N s].
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
        """Find the change (collective)."""
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
            by_rule = rate * x.array[self._fixed] - state.velocity.array[self._fixed]
            self.velocity.getArray()[self._fixed] = rates[0] - by_rule
            system.mass.mult(self.velocity, self.momentum)
            if exact is not None:
                add_inertia(exact, self.velocity, self.momentum)
        if self._kick is not None:
            self._kick.add(self.velocity, self.momentum)

    @staticmethod
    def add(part: PETSc.Vec | None, to: PETSc.Vec, factor: float = 1.0) -> None:
        """Add a part to a vector, if there is one."""
        if part is not None:
            to.axpy(factor, part)

    def work(self, before: PETSc.Vec, after: PETSc.Vec) -> float:
        """Work of the supports on this part of the motion, from momenta of the body [J]."""
        if self.velocity is None:
            return 0.0
        gained = (after.array_r - before.array_r)[self._fixed]
        mine = 0.5 * float(self.velocity.array_r[self._fixed] @ gained)
        return float(np.sum(before.comm.tompi4py().allgather(mine)))

    def works(self, *parts: Any) -> dict[str, float]:
        """Work of each load on this part of the motion [J], see `LoadKick.work`."""
        return {} if self._kick is None else self._kick.work(*parts)


def exact_square(rate: float) -> float:
    """The rate, within 2e-8 of it, whose square has no rounding error.

    The rounding of 2/dt against that of 2/dt^2 would be the same in every step: over 1e5 of them
    the energy would drift by some 1e-11.
    """
    mantissa, exponent = math.frexp(rate)
    return math.ldexp(round(mantissa * 2**26) / 2**26, exponent)
