# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Midpoint schemes; each marches M a + C v + K u + B^T w t = F with any matrices."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.laws.law import (
    BACKWARD_EULER,
    DISCRETE_GRADIENT,
    JointState,
    Rule,
    Status,
)
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.effective_matrix import MatrixCoefficients
from dolfinx_joints.solvers.step_solver import StepSolver
from dolfinx_joints.time_integration.products import Products, combination, joint_works
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

    def conserves(self, system: MatrixSystem) -> bool:
        """Whether the balance is exact: where K has an energy."""
        return system.symmetric

    def advance(
        self, solver: StepSolver, state: DynamicState, dt: float
    ) -> tuple[DynamicState, StepReport]:
        """One step of length dt [s] (collective)."""
        system, time, rate = solver.system, state.time + dt, _exact_square(2.0 / dt)
        if system.bulk is not None and self.rule != DISCRETE_GRADIENT:
            raise ValueError(
                f"{type(self).__name__} asks laws for the end of steps that the body takes in the "
                "middle, which plastic cells cannot do; take EnergyConsistent."
            )
        load = system.load(time, state.load.duplicate())
        known = [(0.5, load), (0.5, state.load)]
        known += [(rate, state.momentum), (-1.0, state.elastic_force)]
        if state.remainder is not None:
            known.append((-1.0, state.remainder))
        b = combination(*known)
        x = combination((dt, state.velocity))
        fixed = system.constrained
        x.getArray()[fixed] = system.prescribed(time) - state.displacement.array[fixed]
        turn = _Turn(system, state, x, rate, time, dt)
        turn.add(turn.momentum, b, -0.5 * rate)
        before = self._before(system, state, dt)
        effective = MatrixCoefficients(mass=0.5 * rate**2, damping=0.5 * rate, stiffness=0.5)
        joints, solve = solver.solve(effective, b, x, before, self.rule.over(dt))
        products = Products(system, effective, b, x, joints)
        velocity = combination((rate, x), (-1.0, state.velocity))
        turn.add(turn.velocity, velocity)
        if len(system.massless):
            # Nothing holds the velocities of these to those before: take the mean of the step.
            velocity.getArray()[system.massless] = x.array[system.massless] / dt
        momentum = combination((rate, products.mass), (-1.0, state.momentum))
        turn.add(turn.momentum, momentum)
        acceleration = combination((1.0, velocity), (-1.0, state.velocity))
        acceleration.scale(1.0 / dt)
        after = DynamicState(
            time=time,
            displacement=combination((1.0, state.displacement), (1.0, x)),
            velocity=velocity,
            acceleration=acceleration,
            load=load,
            reaction=products.reaction,
            momentum=momentum,
            elastic_force=combination((1.0, state.elastic_force), (1.0, products.stiffness)),
            joints=joints,
            remainder=products.remainder,
        )
        work = StepWork(
            loads=system.work_of_loads(x, state.time, time),
            supports=float(products.reaction.dot(x)) + turn.work(state.momentum, momentum),
            viscous=products.viscous,
            absorbed=products.absorbed,
            joints=joint_works(system, state, joints, self.rule.over(dt), mean_traction=False),
        )
        change = combination((1.0, acceleration), (-1.0, state.acceleration)).norm()
        error = float(change) * dt**2 / 12.0
        return after, StepReport(dt=dt, solve=solve, work=work, local_error=error)

    def _before(self, system: MatrixSystem, state: DynamicState, dt: float) -> JointState | None:
        """State of the joints, with the course of their slip for laws over a whole step."""
        if state.joints is None:
            return None
        if system.contact is None or self.rule != DISCRETE_GRADIENT:
            return state.joints.state
        velocity, status = state.velocity, state.joints.status[:, None]
        if len(system.massless):
            # Theirs is that in the middle of the last step.
            velocity, late = velocity.copy(), system.massless
            velocity.getArray()[late] += 0.5 * dt * state.acceleration.array[late]
        jump = system.contact.operator.jump
        # Between a side with mass and one without, what sticks seems to creep.
        way = np.where(status == Status.STICK, 0.0, dt * jump(velocity)[:, 1:])
        change = np.where(status == Status.SLIP, dt**2 * jump(state.acceleration)[:, 1:], 0.0)
        course = np.column_stack([way, change])
        return replace(state.joints.state, course=course)


@dataclass(frozen=True, kw_only=True)
class EnergyConsistent(_Midpoint):
    """Midpoint rule with the discrete gradient of the joints' energy: the balance always closes.

    What friction dissipates is all that joints take from a step, at any length of step and however
    stiff they are (`laws.discrete_gradient`). Where every joint sticks, and without joints, this is
    Newmark's average acceleration. Accurate it is only where the step resolves the motion: watch
    the local error, and let `StepControl` shorten steps in which joints open or close.
    """


@dataclass(frozen=True, kw_only=True)
class ImplicitContact(_Midpoint):
    """Midpoint rule for the body, backward Euler for the joints: impacts lose energy, never gain.

    The tractions of the end of a step act over the whole of it (Kane, Repetto, Ortiz, Marsden
    1999). What impacts lose is counted as numerical.
    """

    rule: ClassVar[Rule] = BACKWARD_EULER


class _Turn:
    """Change that prescribed dofs make to the midpoint rule: their velocities are prescribed, too.

    Left to v1 = 2 x / dt - v0, they would swing for ever after every corner of their motion.

    Attributes:
        velocity: v1 - (2 x / dt - v0), zero at unconstrained dofs; None where supports rest [m/s].
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
    ) -> None:
        """Find the change, none where supports rest (collective)."""
        self.velocity: PETSc.Vec | None = None
        self.momentum: PETSc.Vec | None = None
        rates = system.prescribed_rates(time, 0.5 * dt)
        if rates is not None:
            self.velocity, self.momentum = x.duplicate(), x.duplicate()
            fixed = system.constrained
            by_rule = rate * x.array[fixed] - state.velocity.array[fixed]
            self.velocity.set(0.0)
            self.velocity.getArray()[fixed] = rates[0] - by_rule
            system.mass.mult(self.velocity, self.momentum)

    @staticmethod
    def add(part: PETSc.Vec | None, to: PETSc.Vec, factor: float = 1.0) -> None:
        """Add a part to a vector, if there is one."""
        if part is not None:
            to.axpy(factor, part)

    def work(self, before: PETSc.Vec, after: PETSc.Vec) -> float:
        """Work of the supports on this part of the motion, from momenta of the body [J]."""
        if self.velocity is None:
            return 0.0
        return 0.5 * float(self.velocity.dot(after) - self.velocity.dot(before))


def _exact_square(rate: float) -> float:
    """The rate, within 2e-8 of it, whose square has no rounding error.

    The rounding of 2/dt against that of 2/dt^2 would be the same in every step: over 1e5 of them
    the energy would drift by some 1e-11.
    """
    mantissa, exponent = math.frexp(rate)
    return math.ldexp(round(mantissa * 2**26) / 2**26, exponent)
