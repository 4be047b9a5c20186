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
    share = 0.5 * (1.0 - spectral_radius)
    return MatrixCoefficients(
        mass=(1.0 - share) * (0.5 * rate**2),
        damping=0.5 * rate,
        stiffness=0.5 + share / (1.0 + spectral_radius),
        exact_modes=exact_modes,
    )


class Dissipation:
    """What a spectral radius at infinity below 1 changes in a midpoint step.

    With P = 1 - Phi Psi^T, which leaves out the modes that the step takes exactly,

        x = dt [(v0 + v1)/2 + chi P (v1 - v0)],   v1 = v_mid - share P (v_mid - v0),        (19d)

    share = (1 - rho)/2, and K has chi P x more than the mean displacement; v is that of the step in
    exact modes (`exact_steps`). All methods are collective.

    Args:
        system: The system.
        state: Its state before the step.
        effective: Coefficients of the step.
        spectral_radius: rho.
        exact: The exact modes, None without any.
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
        self._share = 0.5 * (1.0 - spectral_radius)
        self._chi, self._rate = effective.stiffness - 0.5, 2.0 * effective.damping
        self._exact, self._before, self._fixed = exact, state, system.constrained
        self._moves = system.values is not None
        if exact is not None:
            self._modal_before = exact.modes.amounts(exact.used, state.velocity)

    def add_known(self, b: PETSc.Vec) -> None:
        """Change the known part of the step's equation."""
        momentum = self._before.momentum.copy()
        if self._exact is not None:
            add_modal_momentum(self._exact, -self._modal_before, momentum.getArray())
        b.axpy(-self._share * self._rate, momentum)

    def complete(self, products: Products, x: PETSc.Vec, modal: Floats) -> None:
        """Change what is left of the step's equation, the exact modes' part of it.

        Args:
            products: Their residual.
            x: Change of the displacement.
            modal: Phi.M x of the exact modes.
        """
        step = self._exact
        if step is None:
            return
        pushed = step.pushed(x)
        force = step.modes.weighed(-self._chi * (step.squares * modal + pushed))
        step.modes.add_held(-self._chi * step.from_rest(modal, pushed), force)
        add_modal_momentum(step, 0.5 * self._share * self._rate**2 * modal, force)
        products.reaction.getArray()[self._fixed] += force[self._fixed]
        force[self._fixed] = 0.0
        products.remainder.getArray()[:] += force

    def damp(self, velocity: PETSc.Vec, momentum: PETSc.Vec, modal: Floats) -> None:
        """Change velocity and momentum at the end of the midpoint rule to those of (19d)."""
        for end, start in (
            (velocity, self._before.velocity),
            (momentum, self._before.momentum),
        ):
            end.scale(1.0 - self._share)
            end.axpy(self._share, start)
        if self._exact is not None:
            kept = self._share * (self._rate * modal - 2.0 * self._modal_before)
            velocity.getArray()[:] += self._exact.modes.combined(kept)
            add_modal_momentum(self._exact, kept, momentum.getArray())

    def displaced(self, acceleration: PETSc.Vec, dt: float) -> PETSc.Vec:
        """What dissipation adds to x in a step of length dt [s], dt^2 chi P a of (19d), [m]."""
        found = acceleration.copy()
        if self._exact is not None:
            modal = self._exact.modes.amounts(self._exact.used, acceleration)
            found.getArray()[:] -= self._exact.modes.combined(modal)
        found.scale(self._chi * dt**2)
        return found

    def works(
        self,
        x: PETSc.Vec,
        modal: Floats,
        products: Products,
        velocity: PETSc.Vec,
        momentum: PETSc.Vec,
    ) -> tuple[float, float]:
        """Loss of a step, and work of moving supports on this part of the motion [J].

        The loss (19f) is chi (|P dv|^2_M + |P x|^2_K), modes taken off by their amounts.

        Args:
            x: Change of the displacement.
            modal: Phi.M x of the exact modes.
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
            carried = step.modes.carried(step.used, change)
            moved = step.root * step.modes.amounts(step.used, change)
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
        mine = -0.5 * self._share * float(by_rule @ gained.array_r[fixed])
        mine += self._chi * float(change.array_r[fixed] @ of_rest[fixed])
        return float(np.sum(x.comm.tompi4py().allgather(mine)))
