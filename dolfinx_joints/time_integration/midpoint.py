# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Midpoint schemes; each marches M a + C v + K u + B^T w t = F with any matrices."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import annotated_types as at
import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.declared import checked
from dolfinx_joints.laws.law import BACKWARD_EULER, DISCRETE_GRADIENT, Floats, Rule
from dolfinx_joints.model.exact_modes import ModalStep
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.step_solver import StepSolver
from dolfinx_joints.time_integration.dissipation import Dissipation, midpoint_coefficients
from dolfinx_joints.time_integration.exact_steps import (
    LoadKick,
    add_free_vibration,
    add_inertia,
    complete,
    scaled,
)
from dolfinx_joints.time_integration.joints_before import joints_before
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
    exact_modes: ClassVar[int] = 0
    spectral_radius: ClassVar[float] = 1.0

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
        state = scaled(system, state, self.exact_modes, rate)
        effective = midpoint_coefficients(rate, self.spectral_radius, self.exact_modes)
        exact = effective.modal_step(system)
        dissipation = None
        if self.spectral_radius < 1.0:
            dissipation = Dissipation(system, state, effective, self.spectral_radius, exact)
        load = system.load(time, state.load.duplicate())
        known = [(0.5, load), (0.5, state.load)]
        known += [(rate, state.momentum), (-1.0, state.elastic_force)]
        if state.remainder is not None:
            known.append((-1.0, state.remainder))
        b = combination(*known)
        if dissipation is not None:
            dissipation.add_known(b)
        x = combination((dt, state.velocity))
        fixed = system.constrained
        x.getArray()[fixed] = system.prescribed(time) - state.displacement.array[fixed]
        turn = _Turn(system, state, x, rate, time, dt, exact, 0.5 * (1.0 - self.spectral_radius))
        turn.add(turn.momentum, b, -0.5 * rate)
        before = joints_before(system, state, turn.velocity, rate, self.spectral_radius)
        joints, solve = solver.solve(effective, b, x, before, self.rule.over(dt))
        products = Products(system, effective, b, x, joints)
        modal: Floats = np.zeros(0)
        if exact is not None:
            modal = exact.modes.amounts(exact.used, x)
            complete(exact, products, effective, x, modal, fixed)
        velocity = combination((rate, x), (-1.0, state.velocity))
        momentum = combination((rate, products.mass), (-1.0, state.momentum))
        if dissipation is not None:
            dissipation.complete(products, x, modal)
            dissipation.damp(velocity, momentum, modal)
        turn.add(turn.velocity, velocity)
        if len(system.massless):
            # Nothing holds the velocities of these to those before: take the mean of the step.
            velocity.getArray()[system.massless] = x.array[system.massless] / dt
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
            exact_modes=state.exact_modes,
            rate=rate,
        )
        change = combination((1.0, acceleration), (-1.0, state.acceleration))
        loads = system.work_of_loads(x, state.time, time)
        if exact is not None:
            rates = exact.modes.amounts(exact.used, state.velocity)
            add_free_vibration(exact, rates, dt, change)
            of_supports = dt * exact.modes.carried(exact.used, acceleration)
            for name, kicked in turn.works(modal, rates, rate, of_supports).items():
                loads[name] += kicked
        supports = float(products.reaction.dot(x)) + turn.work(state.momentum, momentum)
        lost = 0.0
        if dissipation is not None:
            lost, more = dissipation.works(x, modal, products, velocity, momentum)
            supports += more
        work = StepWork(
            loads=loads,
            supports=supports,
            viscous=products.viscous,
            absorbed=products.absorbed,
            dissipation=lost,
            joints=joint_works(system, state, joints, self.rule.over(dt), mean_traction=False),
        )
        error = float(change.norm()) * dt**2 / 12.0
        return after, StepReport(dt=dt, solve=solve, work=work, local_error=error)


@dataclass(frozen=True, kw_only=True)
@checked
class EnergyConsistent(_Midpoint):
    """Midpoint rule with the discrete gradient of the joints' energy: the balance always closes.

    What friction dissipates is all that joints take from a step, at any length of step and however
    stiff they are (`laws.discrete_gradient`). Where every joint sticks, and without joints, this is
    Newmark's average acceleration. Accurate it is only where the step resolves the motion: watch
    the local error, and let `StepControl` shorten steps in which joints open or close.

    Attributes:
        exact_modes: Number of lowest modes, of the body cut at its joints, whose phase and damping
            are exact; of them a step takes those with omega dt up to 1.5.
        spectral_radius: Factor by which a step multiplies what vibrates infinitely fast, of all
            that is not in exact modes: 1 keeps it, 0 takes it out in one step. Below 1 that part is
            of first order, and the ledger has its loss as ``dissipation``.
    """

    exact_modes: Annotated[int, at.Ge(0)] = 0  # type: ignore[misc]
    spectral_radius: Annotated[float, at.Ge(0), at.Le(1)] = 1.0  # type: ignore[misc]


@dataclass(frozen=True, kw_only=True)
class ImplicitContact(_Midpoint):
    """Midpoint rule for the body, backward Euler for the joints: impacts lose energy, never gain.

    The tractions of the end of a step act over the whole of it (Kane, Repetto, Ortiz, Marsden
    1999). What impacts lose is counted as numerical.
    """

    rule: ClassVar[Rule] = BACKWARD_EULER


class _Turn:
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
        share: float,
    ) -> None:
        """Find the change, ``share`` being that of `Dissipation` (collective)."""
        self.velocity: PETSc.Vec | None = None
        self.momentum: PETSc.Vec | None = None
        self._fixed = system.constrained
        self._kick = None if exact is None else LoadKick(system, exact, state.time, time)
        kicked = self._kick is not None and self._kick.felt
        rates = system.prescribed_rates(time, 0.5 * dt)
        if rates is None and not kicked:
            return
        self.velocity, self.momentum = x.duplicate(), x.duplicate()
        self.velocity.set(0.0)
        self.momentum.set(0.0)
        if rates is not None:
            before, moved = state.velocity.array[self._fixed], x.array[self._fixed]
            by_rule = rate * moved - before - share * (rate * moved - 2.0 * before)
            self.velocity.getArray()[self._fixed] = rates[0] - by_rule
            system.mass.mult(self.velocity, self.momentum)
            if exact is not None:
                add_inertia(exact, self.velocity, self.momentum)
        if self._kick is not None and kicked:
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
        return {} if self._kick is None or not self._kick.felt else self._kick.work(*parts)


def _exact_square(rate: float) -> float:
    """The rate, within 2e-8 of it, whose square has no rounding error.

    The rounding of 2/dt against that of 2/dt^2 would be the same in every step: over 1e5 of them
    the energy would drift by some 1e-11.
    """
    mantissa, exponent = math.frexp(rate)
    return math.ldexp(round(mantissa * 2**26) / 2**26, exponent)
