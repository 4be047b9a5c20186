# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Controlled dissipation of a midpoint step in all that it does not take exactly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.model.exact_modes import ModalStep
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.effective_matrix import MatrixCoefficients
from dolfinx_joints.time_integration.exact_steps import add_modal_momentum
from dolfinx_joints.time_integration.products import Products, combination
from dolfinx_joints.time_integration.states import DynamicState

Floats = NDArray[np.float64]


def midpoint_coefficients(
    rate: float, spectral_radius: float, exact_modes: int
) -> MatrixCoefficients:
    """Coefficients of a midpoint step by its rate 2 / dt [1/s], (19e)."""
    eta = 0.5 * (1.0 - spectral_radius)
    return MatrixCoefficients(
        mass=(1.0 - eta) * (0.5 * rate**2),
        damping=0.5 * rate,
        stiffness=0.5 + eta / (1.0 + spectral_radius),
        exact_modes=exact_modes,
    )


class Dissipation:
    """What a spectral radius at infinity below 1 changes in a midpoint step.

    With P = 1 - Phi Psi^T, which leaves out the modes that the step takes exactly,

        x = dt [(v0 + v1)/2 + chi P (v1 - v0)],   v1 = v_mid - eta P (v_mid - v0),        (19d)

    and K has chi P x more than the mean displacement. All methods are collective.

    Args:
        system: The system.
        state: Its state before the step.
        effective: Coefficients of the step.
        spectral_radius: rho.
        exact: The exact modes, None without any.

    Attributes:
        eta: (1 - rho) / 2.
    """

    def __init__(
        self,
        system: MatrixSystem,
        state: DynamicState,
        effective: MatrixCoefficients,
        spectral_radius: float,
        exact: ModalStep | None,
    ) -> None:
        """Keep the parts."""
        self.eta = 0.5 * (1.0 - spectral_radius)
        self._chi, self._rate = effective.stiffness - 0.5, 2.0 * effective.damping
        self._exact, self._before, self._fixed = exact, state, system.constrained
        self._moves = system.values is not None

    def add_known(self, b: PETSc.Vec) -> None:
        """Change the known part of the step's equation."""
        momentum = self._momentum_of_rest(self._before.momentum, self._before.velocity)
        b.axpy(-self.eta * self._rate, momentum)

    def complete(self, products: Products, x: PETSc.Vec) -> None:
        """Change what is left of the step's equation, the exact modes' part of it."""
        step = self._exact
        if step is None:
            return
        modal, pushed = step.modes.amounts(step.used, x), step.pushed(x)
        force = np.zeros(x.getLocalSize())
        add_modal_momentum(step, 0.5 * self.eta * self._rate**2 * modal, force)
        force += step.modes.weighed(-self._chi * (step.squares * modal + pushed))
        step.modes.add_held(-self._chi * step.from_rest(modal, pushed), force)
        products.reaction.getArray()[self._fixed] += force[self._fixed]
        force[self._fixed] = 0.0
        products.remainder.getArray()[:] += force

    def damp(self, velocity: PETSc.Vec, momentum: PETSc.Vec) -> None:
        """Change velocity and momentum at the end of the midpoint rule to those of (19d)."""
        change = combination((1.0, velocity), (-1.0, self._before.velocity))
        gained = combination((1.0, momentum), (-1.0, self._before.momentum))
        momentum.axpy(-self.eta, self._momentum_of_rest(gained, change))
        velocity.axpy(-self.eta, change)
        step = self._exact
        if step is not None:
            modal = step.modes.amounts(step.used, change)
            velocity.getArray()[:] += step.modes.combined(self.eta * modal)

    def works(
        self, x: PETSc.Vec, products: Products, velocity: PETSc.Vec, momentum: PETSc.Vec
    ) -> tuple[float, float]:
        """Loss of a step, and work of moving supports on this part of the motion [J].

        The loss (19f) is chi (|P dv|^2_M + |P x|^2_K), modes taken off by their amounts.

        Args:
            x: Change of the displacement.
            products: M x and K x.
            velocity: At the end of the step.
            momentum: The same.
        """
        change = combination((1.0, velocity), (-1.0, self._before.velocity))
        gained = combination((1.0, momentum), (-1.0, self._before.momentum))
        inertia, stretch = float(change.dot(gained)), float(x.dot(products.stiffness))
        at_supports = gained.array_r.copy()
        step = self._exact
        if step is not None:
            modal, modal_change = (step.modes.amounts(step.used, v) for v in (x, change))
            carried = step.modes.carried(step.used, change)
            moved = step.root * modal_change
            inertia -= float(moved @ (moved + 2.0 * carried))
            pushed = step.pushed(x)
            stretch -= float((step.squares * modal + pushed) @ step.from_rest(modal, pushed))
            step.modes.add_at_supports(-moved, at_supports)
        return self._chi * (inertia + stretch), self._of_supports(x, change, gained, at_supports)

    def _of_supports(
        self, x: PETSc.Vec, change: PETSc.Vec, gained: PETSc.Vec, of_rest: Floats
    ) -> float:
        """Work of moving supports, from the momentum gained in all and in the rest of the modes."""
        if not self._moves:
            return 0.0
        fixed = self._fixed
        by_rule = self._rate * x.array_r[fixed] - 2.0 * self._before.velocity.array_r[fixed]
        mine = -0.5 * self.eta * float(by_rule @ gained.array_r[fixed])
        mine += self._chi * float(change.array_r[fixed] @ of_rest[fixed])
        return float(np.sum(x.comm.tompi4py().allgather(mine)))

    def _momentum_of_rest(self, momentum: PETSc.Vec, velocity: PETSc.Vec) -> PETSc.Vec:
        """M' P v from M' v and v."""
        rest, step = momentum.copy(), self._exact
        if step is not None:
            modal = step.modes.amounts(step.used, velocity)
            add_modal_momentum(step, -modal, rest.getArray())
        return rest
