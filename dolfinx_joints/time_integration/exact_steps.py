# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Midpoint steps that are exact in the lowest modes, by modified mass and damping (`ModalStep`).

The update v1 = 2 x/dt - v0 and the energy balance also apply with the modal masses m' (19a). In an
exact mode the stored velocity v is the true velocity divided by sqrt(m'), so that m' v^2 / 2 is the
kinetic energy.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.mesh.cells import Floats, Ints
from dolfinx_joints.model.exact_modes import ModalStep, lowest_modes
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.effective_matrix import MatrixCoefficients
from dolfinx_joints.time_integration.products import Products
from dolfinx_joints.time_integration.states import DynamicState


def rescale(system: MatrixSystem, state: DynamicState, count: int, rate: float) -> DynamicState:
    """Return the state with the velocities of ``count`` exact modes scaled for a step (collective).

    The kinetic energy does not change; ``rate`` is 2 / dt of the step [1/s].
    """
    if state.exact_modes == count and (count == 0 or state.rate == rate):
        return state
    velocity = _scale(system, state.velocity, state.exact_modes, state.rate, back=True)
    velocity = _scale(system, velocity, count, rate)
    momentum = system.mass * velocity
    if count:
        add_inertia(lowest_modes(system, count).step(rate), velocity, momentum)
    return replace(state, velocity=velocity, momentum=momentum, exact_modes=count, rate=rate)


def _scale(
    system: MatrixSystem, velocity: PETSc.Vec, count: int, rate: float, *, back: bool = False
) -> PETSc.Vec:
    """Divide modal velocities by sqrt(m'), or multiply them if ``back`` (collective)."""
    if not count:
        return velocity
    step = lowest_modes(system, count).step(rate)
    modal = step.modes.amounts(step.used, velocity)
    velocity = velocity.copy()
    change = (step.root if back else 1.0 / step.root) - 1.0
    velocity.getArray()[:] += step.modes.combined(change * modal)
    return velocity


def add_inertia(step: ModalStep, velocity: PETSc.Vec, momentum: PETSc.Vec) -> None:
    """Add the contribution of the modal masses m' to the momentum M v (collective)."""
    modal = step.modes.amounts(step.used, velocity)
    momentum.getArray()[:] += _inertia(step, velocity, modal)


def add_free_vibration(
    step: ModalStep, velocity: Floats, dt: float, acceleration: PETSc.Vec
) -> None:
    """Remove free vibration from the change of the mean acceleration in a step of length dt [s].

    ``velocity`` contains the modal velocities at the start, shape (used,), [m/s].
    """
    angle = step.modes.frequencies[: step.used] * dt
    change = 2.0 * (1.0 - np.cos(angle)) / dt * velocity  # -(v(t+dt) - 2 v(t) + v(t-dt)) / dt
    acceleration.getArray()[:] += step.modes.combined(change)


def add_modes(
    step: ModalStep,
    products: Products,
    effective: MatrixCoefficients,
    x: PETSc.Vec,
    modal: Floats,
    fixed: Ints,
) -> None:
    """Add the contributions of modal mass m' and damping c' to a step's products (collective).

    x is the displacement increment, ``modal`` its modal amplitudes, ``fixed`` the constrained dofs.
    """
    inertia = _inertia(step, x, modal)
    products.mass.getArray()[:] += inertia
    force = effective.mass * inertia
    if np.any(step.more_damping):
        force += step.modes.mass_times_modes(effective.damping * step.more_damping * modal)
        products.viscous += effective.damping * float(step.more_damping @ modal**2)
    products.reaction.getArray()[fixed] += force[fixed]
    force[fixed] = 0.0
    products.remainder.getArray()[:] += force


def _inertia(step: ModalStep, x: PETSc.Vec, modal: Floats) -> Floats:
    """Return the change of M x by m' at the owned rows (collective)."""
    change = step.modes.mass_times_modes((step.mass - 1.0) * modal + step.of_supports(x))
    step.modes.add_at_supports((step.root - 1.0) * modal, change)
    return change


class LoadKick:
    """Velocity correction (kick) of the exact modes for loads that change within a step (19c).

    With v1 = 2 x/dt - v0 + kick, undamped modes are exact for loads that are linear over the step.

    Attributes:
        of_patterns: Kick of each mode by each load pattern, shape (modes, patterns), [m/s].
    """

    def __init__(self, system: MatrixSystem, step: ModalStep, start: float, end: float) -> None:
        """Compute the kicks of a step between two times [s]."""
        self._step, self._names = step, system.names_of_patterns
        loads = step.modes.loads[: step.used] * (system.factors(end) - system.factors(start))
        self.of_patterns: Floats = step.kick[:, None] * loads

    def add(self, velocity: PETSc.Vec, momentum: PETSc.Vec) -> None:
        """Add the kick to a velocity, and the modified mass M' times the kick to a momentum."""
        step, kick = self._step, self.of_patterns.sum(axis=1)
        velocity.getArray()[:] += step.modes.combined(kick)
        momentum.getArray()[:] += step.modes.mass_times_modes(step.mass * kick)
        step.modes.add_at_supports(step.root * kick, momentum.getArray())

    def work(
        self, x: Floats, velocity: Floats, rate: float, of_supports: Floats
    ) -> dict[str, float]:
        """Return the work of each load due to the kick [J].

        x contains the modal displacement increments, ``velocity`` the modal velocities at the
        start, and ``of_supports`` the modal momenta of the change of the support velocities.
        ``rate`` is 2 / dt [1/s].
        """
        change = rate * x - 2.0 * velocity + self.of_patterns.sum(axis=1)
        momentum = self._step.mass * change + self._step.root * of_supports
        works: dict[str, float] = {}
        for name, work in zip(self._names, 0.5 * momentum @ self.of_patterns, strict=True):
            works[name] = works.get(name, 0.0) + float(work)
        return works
