# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Midpoint steps that are exact in the lowest modes, by their mass and damping (`ModalStep`).

With m' the step keeps v1 = 2 x/dt - v0 in all of the body and its balance of energies, but v is not
the velocity: of a mode it is that divided by sqrt(m'), so that m' v^2 / 2 is the kinetic energy.
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


def scaled(system: MatrixSystem, state: DynamicState, count: int, rate: float) -> DynamicState:
    """Return a state with modal velocities scaled for a step, kinetic energy kept (collective).

    The step is exact in ``count`` modes; its ``rate`` is 2 / dt [1/s].
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
    """Modal velocities divided by the root of m', or times it (collective)."""
    if not count:
        return velocity
    step = lowest_modes(system, count).step(rate)
    known = step.modes.amounts(step.used, velocity)
    velocity = velocity.copy()
    change = (step.root if back else 1.0 / step.root) - 1.0
    velocity.getArray()[:] += step.modes.combined(change * known)
    return velocity


def add_inertia(step: ModalStep, velocity: PETSc.Vec, momentum: PETSc.Vec) -> None:
    """Add what m' changes to the momentum of a velocity (collective)."""
    known = step.modes.amounts(step.used, velocity)
    momentum.getArray()[:] += _inertia(step, velocity, known)


def add_free_vibration(
    step: ModalStep, velocity: Floats, dt: float, acceleration: PETSc.Vec
) -> None:
    """Remove free vibration from the change of the mean acceleration in a step of length dt [s].

    ``velocity`` has the modal velocities at the start, shape (used,), [m/s].
    """
    turn = step.modes.frequencies[: step.used] * dt
    own = 2.0 * (1.0 - np.cos(turn)) / dt * velocity  # v(t + dt) - 2 v(t) + v(t - dt), over -dt
    acceleration.getArray()[:] += step.modes.combined(own)


def complete(
    step: ModalStep,
    products: Products,
    effective: MatrixCoefficients,
    x: PETSc.Vec,
    modal: Floats,
    fixed: Ints,
) -> None:
    """Add what m' and c' change to the products of a step with the body (collective).

    x is the change of the displacement, ``modal`` Phi.M x, and ``fixed`` are constrained dofs.
    """
    inertia = _inertia(step, x, modal)
    products.mass.getArray()[:] += inertia
    force = effective.mass * inertia
    if np.any(step.more_damping):
        force += step.modes.weighed(effective.damping * step.more_damping * modal)
        products.viscous += effective.damping * float(step.more_damping @ modal**2)
    products.reaction.getArray()[fixed] += force[fixed]
    force[fixed] = 0.0
    products.remainder.getArray()[:] += force


def _inertia(step: ModalStep, x: PETSc.Vec, modal: Floats) -> Floats:
    """Owned rows of the change of M x (collective)."""
    change = step.modes.weighed((step.mass - 1.0) * modal + step.of_supports(x))
    step.modes.add_at_supports((step.root - 1.0) * modal, change)
    return change


class LoadKick:
    """Change that loads which grow along a step make to the midpoint rule in exact modes.

    v1 = 2 x/dt - v0 + kick, with which x is exact under a load that is linear in the step.

    Attributes:
        of_patterns: Modal kick of each pattern of the loads, shape (modes, patterns), [m/s].
    """

    def __init__(self, system: MatrixSystem, step: ModalStep, start: float, end: float) -> None:
        """Find the kicks of a step between two times [s]."""
        self._step, self._names = step, system.names_of_patterns
        loads = step.modes.loads[: step.used] * system.load_change(start, end)
        self.of_patterns: Floats = step.kick[:, None] * loads

    def add(self, velocity: PETSc.Vec, momentum: PETSc.Vec) -> None:
        """Add the kick to a velocity, and S^T M S times it to a momentum."""
        step, kick = self._step, self.of_patterns.sum(axis=1)
        velocity.getArray()[:] += step.modes.combined(kick)
        momentum.getArray()[:] += step.modes.weighed(step.mass * kick)
        step.modes.add_at_supports(step.root * kick, momentum.getArray())

    def work(
        self, x: Floats, velocity: Floats, rate: float, of_supports: Floats
    ) -> dict[str, float]:
        """Return the work of each load on the kick [J].

        x and ``velocity`` are modal displacements in the step and velocities at its start,
        ``rate`` is 2 / dt [1/s], ``of_supports`` Phi.M of the change of the supports' velocities.
        """
        change = rate * x - 2.0 * velocity + self.of_patterns.sum(axis=1)
        momentum = self._step.mass * change + self._step.root * of_supports
        works: dict[str, float] = {}
        for name, work in zip(self._names, 0.5 * momentum @ self.of_patterns, strict=True):
            works[name] = works.get(name, 0.0) + float(work)
        return works
