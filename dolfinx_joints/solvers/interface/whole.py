# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton's method on the displacement and the joint tractions, for large bodies.

The unknowns are the change x of the displacement and the tractions t, (13a) in docs/theory:

    A x + B^T (w t) = b,    t = t_c(g + B x + c t),

with the matrix A and the right-hand side b of the step, the gap operator B, the areas w, and the
gaps g at the start. t_c is the condensed form of the laws (Res in docs/theory): the traction of a
point with its own compliance c. Here c is estimated from the diagonal of A. The residual of a stiff
joint is then no larger than the residual of a soft joint. A correction eliminates t, which gives
the matrix A + B^T (w D) B of `NewtonSolver`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.mpi import of_ranks
from dolfinx_joints.joints.operator import diagonal_compliance
from dolfinx_joints.laws.law import Response
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.newton import BodyIterate, BodyProblem, NewtonSolver
from dolfinx_joints.solvers.step_solver import StepEquation
from dolfinx_joints.solvers.tangent import Tangent


class WholeSolver(NewtonSolver):
    """Newton's method on displacement and tractions, for laws with a condensed form."""

    @cached_property
    def operator(self) -> PETSc.Mat:
        """B with the columns of constrained dofs empty (collective)."""
        assert self.system.contact is not None
        return self.system.contact.operator.constrained(self.unconstrained)

    def _problem(self, tangent: Tangent, equation: StepEquation) -> _MixedProblem:
        """Return the equations of a step as a problem of Newton's method (collective)."""
        return _MixedProblem(self, tangent, equation)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Iterate(BodyIterate):
    """Displacement and tractions with the residuals of equilibrium and laws.

    ``norm`` is the norm of both residuals [J^(1/2)], ``response`` the response on compliances c.

    Attributes:
        traction: t, shape (n, 3), [Pa].
        law_residual: t less the tractions of the response, shape (n, 3), [Pa].
        inverse: (I - T c)^-1 of each point with T = dt/dh, shape (n, 3, 3).
        forces: Norm of both residuals as nodal forces [N].
    """

    traction: Floats
    law_residual: Floats
    inverse: Floats
    forces: float


class _MixedProblem(BodyProblem[_Iterate]):
    """Equilibrium and laws of a step as one problem."""

    def __init__(self, solver: WholeSolver, tangent: Tangent, equation: StepEquation) -> None:
        """Estimate the compliances (collective)."""
        super().__init__(solver, tangent, equation)
        assert solver.system.contact is not None
        self._contact, self._product = solver.system.contact, self.b.duplicate()
        diagonal = self.matrix.constrained.getDiagonal()
        c = diagonal_compliance(solver.operator, diagonal).reshape(-1, 3)
        self._areas = self._contact.operator.areas[:, None]
        live = np.maximum(np.count_nonzero(c[:, 1:], axis=1), 1)
        self._own = self._areas * np.column_stack([c[:, 0], c[:, 1:].sum(axis=1) / live])
        self._c = np.repeat(self._own, (1, 2), axis=1)
        self._inverse_diagonal, self._unit = diagonal, 0.0
        self._inverse_diagonal.reciprocal()

    def start(self) -> _Iterate:
        """Return the first iterate (collective).

        In statics start from the tractions of the accepted state, so that the first correction is
        the elastic predictor.
        """
        if self.matrix.inertia:
            traction = self._evaluate(self.x, np.zeros_like(self.state.gap)).response.traction
        else:
            traction = self._contact.respond(self.x, self.state, self.rule).traction
        start = self._evaluate(self.x.copy(), traction)
        self._unit = start.unit
        return start

    def trial(self, at: _Iterate, correction: PETSc.Vec, share: float) -> _Iterate:
        """Return the iterate after subtracting a share of a correction of x (collective)."""
        gaps = self._contact.operator.jump(correction)
        traction_correction = np.einsum("nij,nj->ni", at.response.tangent, gaps) + at.law_residual
        traction_correction = np.einsum("nij,nj->ni", at.inverse, traction_correction)
        change = at.change.duplicate()
        change.waxpy(-share, correction, at.change)
        return self._evaluate(change, at.traction - share * traction_correction)

    def stiffness(self, at: _Iterate, part: float) -> Floats:
        """Return D = (I - T c)^-1 T of each point, shape (n, 3, 3), [Pa/m]."""
        stiffness: Floats = at.inverse @ at.response.tangent
        return stiffness + part * self._contact.closed_tangent(firm=True) if part else stiffness

    def right_hand_side(self, at: _Iterate, tolerance: float) -> tuple[PETSc.Vec, float]:
        """Return the right-hand side of a correction [N] and its tolerance (collective).

        Part of the right-hand side cancels against the tractions, so scale the tolerance.
        """
        traction = np.einsum("nij,nj->ni", at.inverse, at.law_residual)
        vector = at.unbalanced.copy()
        vector.axpy(-1.0, self._contact.operator.force(traction, self.force))
        vector.pointwiseMult(vector, self.free)
        return vector, tolerance * min(at.forces / (float(vector.norm()) or 1.0), 1.0)

    def _evaluate(self, change: PETSc.Vec, traction: Floats) -> _Iterate:
        """Return the iterate of a displacement and tractions (collective)."""
        operator = self._contact.operator
        gap = self.state.gap + operator.jump(change)
        response = self._contact.respond_condensed(
            gap + self._c * traction, self._own, self.state, self.rule
        )
        law_residual = traction - response.traction
        self.matrix.multiply(change, self._product)
        operator.force(traction, self.force)
        scale = max(float(v.norm()) for v in (self._product, self.force, self.b)) or 1.0
        unbalanced = self._product.duplicate()
        unbalanced.waxpy(1.0, self.force, self._product)
        unbalanced.axpy(-1.0, self.b)
        unbalanced.pointwiseMult(unbalanced, self.free)
        self._product.pointwiseMult(unbalanced, self._inverse_diagonal)
        energy = float(self._product.dot(unbalanced))
        operator.force(law_residual, self.force)
        forces = float(np.hypot(self.force.norm(), unbalanced.norm()))
        self.force.aypx(-1.0, unbalanced)
        self.force.pointwiseMult(self.force, self.free)
        rounding = limits.PRODUCT_ROUNDING * self.matrix.norm * float(change.norm()) / scale
        law_relative, law_rounding, law_energy = self._law_residual(
            response, law_residual, np.abs(gap), traction
        )
        norm = float(np.sqrt(energy + law_energy))
        # Laws: relative to the largest joint force; equilibrium: to its largest term.
        relative = np.array([law_relative, float(self.force.norm()) / scale])
        largest = [limits.LARGEST_CONTACT_ROUNDING, limits.LARGEST_ROUNDING]
        tolerance = np.maximum(self.wanted, np.minimum([law_rounding, rounding], largest))
        max_relative = float(relative.max())
        return _Iterate(
            change=change,
            response=response,
            unbalanced=unbalanced,
            norm=norm,
            unit=self._unit or norm or 1.0,
            relative=max_relative,
            accepted=bool(np.all(relative <= tolerance)),
            target=self.wanted / (max_relative or 1.0),
            traction=traction,
            law_residual=law_residual,
            inverse=np.linalg.inv(np.eye(3) - response.tangent * self._c[:, None, :]),
            forces=forces,
        )

    def _law_residual(
        self, response: Response, residual: Floats, gap: Floats, traction: Floats
    ) -> tuple[float, float, float]:
        """Return residual and rounding error of the laws, relative; energy [J] (collective)."""
        reach = gap + np.abs(self._c * traction)
        exact = np.divide(reach, self._c, out=np.zeros_like(reach), where=self._c > 0.0)
        sizes = [self._areas * np.abs(values) for values in (residual, response.traction, exact)]
        local_sizes = [size.max(initial=0.0) for size in sizes]
        by_rank = of_ranks(
            self._contact.operator.comm,
            np.array([*local_sizes, np.sum(self._areas * self._c * residual**2)]),
        )
        error, largest, rounding = by_rank[:, :3].max(axis=0)
        largest = largest or error or 1.0
        return error / largest, limits.GAP_ROUNDING * rounding / largest, float(by_rank[:, 3].sum())
