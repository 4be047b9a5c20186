# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Products and works of a step, for all schemes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.errors import ConvergenceError
from dolfinx_joints.common.mpi import raised_together
from dolfinx_joints.laws.law import Floats, Response, Rule
from dolfinx_joints.laws.losses import work
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.effective_matrix import MatrixCoefficients
from dolfinx_joints.time_integration.states import DynamicState


class Products:
    """M x and K x of the displacement increment x of a step, and the residual of its equation.

    Attributes:
        mass: M x, zero in statics.
        stiffness: K x.
        viscous: x.C x times the coefficient of C in the equation, without absorbing boundaries [J].
        absorbed: Corresponding product with the dashpots of absorbing boundaries [J].
        reaction: Residual of the step's equation at the constrained dofs, zero elsewhere [N].
        remainder: Residual at the unconstrained dofs, zero elsewhere [N].
    """

    def __init__(
        self,
        system: MatrixSystem,
        effective: MatrixCoefficients,
        b: PETSc.Vec,
        x: PETSc.Vec,
        joints: Response | None,
    ) -> None:
        """Compute the products (collective)."""
        self.mass, self.stiffness, self.reaction = (b.duplicate() for _ in range(3))
        if effective.mass or effective.damping:
            system.multiply(x, self.mass, self.stiffness)
        else:  # Static stages compute too few products for `system.multiply` and its set-up.
            self.mass.set(0.0)
            system.stiffness.mult(x, self.stiffness)
        residual = combination(
            (-1.0, b), (effective.mass, self.mass), (effective.stiffness, self.stiffness)
        )
        # Compute C x separately, so that the energy balance detects errors of the solved matrix.
        damped = combination(
            (system.rayleigh.mass_factor, self.mass),
            (system.rayleigh.stiffness_factor, self.stiffness),
        )
        if system.dashpots is not None:
            system.dashpots.mult(x, self.reaction)
            damped.axpy(1.0, self.reaction)
        if system.damped_modes is not None:
            system.damped_modes.add_force(x, damped)
        residual.axpy(effective.damping, damped)
        self.absorbed = 0.0
        if system.absorption is not None:
            system.absorption.mult(x, self.reaction)
            self.absorbed = effective.damping * float(self.reaction.dot(x))
            damped.axpy(-1.0, self.reaction)
        self.viscous = effective.damping * float(damped.dot(x))
        if system.internal_forces is not None and joints is not None:
            residual.axpy(1.0, system.internal_forces.force(joints, self.reaction))
        norm = float(residual.norm())
        if not np.isfinite(norm):
            raise ConvergenceError(iteration=1, residual=norm)
        self.reaction.set(0.0)
        fixed = system.constrained
        self.reaction.getArray()[fixed] = residual.getArray(readonly=True)[fixed]
        residual.getArray()[fixed] = 0.0
        self.remainder = residual


def combination(*terms: tuple[float, PETSc.Vec]) -> PETSc.Vec:
    """Return the sum of factors times vectors as a new vector."""
    (factor, first), *others = terms
    total = first.copy()
    total.scale(factor)
    for factor, vector in others:
        total.axpy(factor, vector)
    return total


def predictor(state: DynamicState, *terms: tuple[float, PETSc.Vec]) -> PETSc.Vec:
    """Return the initial guess of a step: the sum of terms, or zero if laws have a history.

    A bond that breaks at the initial guess stays broken, and the solver may converge with it.
    """
    x = combination(*terms)
    if state.joints is not None and state.joints.state.internal.shape[1]:
        x.set(0.0)
    return x


@dataclass(frozen=True, kw_only=True)
class JointWorks:
    """Works of a step on each joint, all of shape (number of joints,), [J].

    total: Work of the body on the joint.
    friction: Part of ``total`` that friction dissipates.
    numerical: Part lost by the time scheme, from formulas of the laws.
    impact: Part lost at points that close without rebound.
    """

    total: Floats
    friction: Floats
    numerical: Floats
    impact: Floats


def joint_works(
    system: MatrixSystem,
    before: DynamicState,
    joints: Response | None,
    rule: Rule,
    *,
    mean_traction: bool,
) -> JointWorks:
    """Return the works on the joints in a step that ends with the response ``joints`` (collective).

    If ``mean_traction``, the mean of the tractions at start and end acts, else the end tractions.
    """
    if system.contact is None or before.joints is None or joints is None:
        empty = np.zeros(0)
        return JointWorks(total=empty, friction=empty, numerical=empty, impact=empty)
    traction, start = joints.traction, before.joints.state
    if mean_traction:
        traction = 0.5 * (traction + before.joints.traction)
    with raised_together(system.contact.operator.comm):
        lost = system.contact.losses(rule, start, joints, traction)
    work_of_body = work(traction, joints.state.gap - start.gap)
    sums = system.contact.integrals(np.array([work_of_body, *lost]))
    return JointWorks(total=sums[0], friction=sums[1], numerical=sums[2], impact=sums[3])
