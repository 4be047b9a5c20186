# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Products and works of a step that all schemes need."""

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
    """M x and K x of the change x of a step, and what of its equation is left.

    Attributes:
        mass: M x, zero in statics.
        stiffness: K x.
        viscous: x.C x times the coefficient of C in the equation, absorption apart [J].
        absorbed: The same of the dashpots that take waves out [J].
        reaction: Residual of the step's equation at the constrained dofs, zero elsewhere [N].
        remainder: The same at the unconstrained dofs [N].
    """

    def __init__(
        self,
        system: MatrixSystem,
        effective: MatrixCoefficients,
        b: PETSc.Vec,
        x: PETSc.Vec,
        joints: Response | None,
    ) -> None:
        """Multiply (collective)."""
        self.mass, self.stiffness, self.reaction = (b.duplicate() for _ in range(3))
        if effective.mass or effective.damping:
            system.multiply(x, self.mass, self.stiffness)
        else:  # statics: few products, which do not pay for what fast ones prepare
            self.mass.set(0.0)
            system.stiffness.mult(x, self.stiffness)
        residual = combination(
            (-1.0, b), (effective.mass, self.mass), (effective.stiffness, self.stiffness)
        )
        # C x apart from the solved matrix, so that the balance shows errors of that one.
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
    """A new vector, the sum of factors times vectors."""
    (factor, first), *others = terms
    total = first.copy()
    total.scale(factor)
    for factor, vector in others:
        total.axpy(factor, vector)
    return total


def guess(state: DynamicState, *terms: tuple[float, PETSc.Vec]) -> PETSc.Vec:
    """Where the solve of a step starts: a sum as of `combination`, zero if laws have a history.

    A bond that the start breaks stays broken, and that is often a solution of the step, too.
    """
    x = combination(*terms)
    if state.joints is not None and state.joints.state.internal.shape[1]:
        x.set(0.0)
    return x


@dataclass(frozen=True, kw_only=True)
class JointWorks:
    """Works of a step on each joint, all of shape (number of joints,), [J].

    Attributes:
        taken: Work of the body.
        friction: What of it is dissipated.
        numerical: What of it the time scheme loses, by the formulae of the laws.
        impact: What of it points lose that strike and do not rebound.
    """

    taken: Floats
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
    """Works on the joints in a step that ends with a response (collective).

    ``mean_traction`` takes the mean of the tractions at both ends, not those of the response.
    """
    if system.contact is None or before.joints is None or joints is None:
        none = np.zeros(0)
        return JointWorks(taken=none, friction=none, numerical=none, impact=none)
    traction, start = joints.traction, before.joints.state
    if mean_traction:
        traction = 0.5 * (traction + before.joints.traction)
    with raised_together(system.contact.operator.comm):
        lost = system.contact.losses(rule, start, joints, traction)
    taken = work(traction, joints.state.gap - start.gap)
    sums = system.contact.integrals(np.array([taken, *lost]))
    return JointWorks(taken=sums[0], friction=sums[1], numerical=sums[2], impact=sums[3])
