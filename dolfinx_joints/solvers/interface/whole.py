# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton's method on the displacement and the tractions of joints of large bodies.

The unknowns are the change x of the displacement and the tractions t:

    A x + B^T (w t) = b,    t = t_c(g + B x + c t),    (13a)

where t_c is the answer of the laws on the compliances c of their points, as the condensed solver
asks them, here estimated from the diagonal of A. Whether a point opens then follows from gap and
traction together, and the residual of a stiff joint is no larger than that of a soft one. In a
correction t is eliminated; its matrix A + B^T (w D) B is that of `NewtonSolver`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.mpi import free_petsc_garbage, of_ranks
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.joints.internal_forces import JointInternalForces
from dolfinx_joints.joints.operator import diagonal_compliance
from dolfinx_joints.laws.law import BACKWARD_EULER, JointState, Response, Rule
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.effective_matrix import EffectiveMatrix, MatrixCoefficients
from dolfinx_joints.solvers.line_search import LineSearch
from dolfinx_joints.solvers.newton import INNER_TOLERANCE, REGULARISATIONS, NewtonSolver
from dolfinx_joints.solvers.step_solver import SolveReport, SolverOptions, solve_failure
from dolfinx_joints.solvers.tangent import Tangent

Floats = NDArray[np.float64]

EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, kw_only=True)
class _Iterate:
    """Displacement and tractions, and what is left of their equations.

    Attributes:
        change: x [m].
        traction: t, shape (n, 3), [Pa].
        response: Answer of the laws on the compliances c.
        left: t less the answer's tractions, shape (n, 3), [Pa].
        inverse: (I - T c)^-1 of each point with T = dt/dh, shape (n, 3, 3).
        unbalanced: A x + B^T (w t) - b at the unconstrained dofs [N].
        norm: Of both residuals, [J^(1/2)].
        forces: Norm of both as forces of nodes [N].
        relative: What is left in the joints, of their largest force, and of the equilibrium with
            the answer's tractions, of its largest part.
        rounding: What rounding leaves of either.
    """

    change: PETSc.Vec
    traction: Floats
    response: Response
    left: Floats
    inverse: Floats
    unbalanced: PETSc.Vec
    norm: float
    forces: float
    relative: Floats
    rounding: Floats

    def solved(self, tolerance: float) -> bool:
        """Whether no more is left of either than the tolerance or rounding."""
        return bool(np.all(self.relative <= np.maximum(tolerance, self.rounding)))


class WholeSolver(NewtonSolver):
    """Newton's method on displacement and tractions, for joints with condensed laws.

    Args:
        system: The system, with joints.
        options: Tolerances and limits.
    """

    def __init__(self, system: MatrixSystem, options: SolverOptions | None) -> None:
        """Make the work vectors (collective)."""
        super().__init__(system, options)
        assert system.contact is not None
        self._contact: Contact = system.contact
        self._operator = system.contact.operator.constrained(self.unconstrained)

    def solve(
        self,
        effective: MatrixCoefficients,
        b: PETSc.Vec,
        x: PETSc.Vec,
        state: JointState | None,
        rule: Rule = BACKWARD_EULER,
    ) -> tuple[Response | None, SolveReport]:
        """Solve for ``x`` in place, starting from it; see `NewtonSolver.solve` (collective)."""
        assert state is not None
        tangent: Tangent = self._tangents(effective)
        equations, options = _Equations(self, tangent.effective, b, state, rule), self.options
        at = equations.start(x)
        factorizations, norms, line_search = 0, [at.norm], LineSearch(options.max_cuts)
        inertia, wanted = tangent.effective.inertia, options.relative_tolerance
        while not (at.solved(wanted) if inertia else at.relative.max() <= wanted):
            iteration, residual = len(norms) - 1, float(at.relative.max())
            if iteration == options.max_iterations or not np.isfinite(at.norm):
                joints = JointInternalForces(self._contact)
                raise solve_failure(joints, at.response, state, iteration, residual, options)
            fallen = at.norm / norms[-2] if iteration else 1.0
            # As rough as Newton's method lets corrections be, no finer than is asked for.
            inner = max(min(INNER_TOLERANCE, fallen**2), 0.3 * wanted / residual)
            factorizations += self._correct_both(equations, tangent, at, inner)
            if at.solved(wanted) and self._settled(at.change):
                break
            at = equations.search(at, self._correction, line_search.cuts(at.norm))
            free_petsc_garbage(self._contact.operator.comm)  # vectors of trials and iterates
            norms.append(at.norm)
        at.change.copy(x)
        return at.response, SolveReport(
            iterations=len(norms) - 1,
            factorizations=factorizations,
            residual=float(at.relative.max()),
            counts=self._contact.counts(at.response.status),
            residuals=tuple(norm / (norms[0] or 1.0) for norm in norms),
            solver=self.name,
        )

    def _correct_both(
        self, equations: _Equations, tangent: Tangent, at: _Iterate, tolerance: float
    ) -> int:
        """Newton's correction of x; factorizations it took (collective)."""
        right = equations.right(at)
        # Tractions that laws take back are no forces of stiff joints.
        tolerance *= min(at.forces / (float(right.norm()) or 1.0), 1.0)
        for part in REGULARISATIONS:
            try:
                added = part * self._contact.closed_tangent(firm=True) if part else 0.0
                solver = tangent.update(equations.stiffness(at) + added)
                factored = solver.solve(right, self._correction, tolerance)
                self._correction.pointwiseMult(self._correction, self.unconstrained)
                return int(factored)
            except JointsError as error:
                tangent.forget()
                failure = error
        raise failure


class _Equations:
    """Both equations of a step."""

    def __init__(
        self,
        solver: WholeSolver,
        matrix: EffectiveMatrix,
        b: PETSc.Vec,
        state: JointState,
        rule: Rule,
    ) -> None:
        self._contact, self._matrix, self._b = solver._contact, matrix, b
        self._free, self._state, self._rule = solver.unconstrained, state, rule
        diagonal = matrix.constrained.getDiagonal()
        each = diagonal_compliance(solver._operator, diagonal).reshape(-1, 3)
        self._areas = self._contact.operator.areas[:, None]
        live = np.maximum(np.count_nonzero(each[:, 1:], axis=1), 1)
        self._own = self._areas * np.column_stack([each[:, 0], each[:, 1:].sum(axis=1) / live])
        self._c = np.repeat(self._own, (1, 2), axis=1)
        self._inverse = diagonal
        self._inverse.reciprocal()
        self._force, self._product = b.duplicate(), b.duplicate()

    def start(self, x: PETSc.Vec) -> _Iterate:
        """Return the first iterate (collective).

        In statics the tractions are those of the accepted state, so that the first correction is
        the elastic predictor.
        """
        if not self._matrix.inertia:
            return self.evaluate(
                x.copy(), self._contact.respond(x, self._state, self._rule).traction
            )
        at = self.evaluate(x.copy(), np.zeros_like(self._state.gap))
        return self.evaluate(at.change, at.response.traction)

    def evaluate(self, change: PETSc.Vec, traction: Floats) -> _Iterate:
        """Residuals at a displacement and tractions (collective)."""
        operator = self._contact.operator
        gap = self._state.gap + operator.jump(change)
        response = self._contact.respond_condensed(
            gap + self._c * traction, self._own, self._state, self._rule
        )
        left = traction - response.traction
        self._matrix.multiply(change, self._product)
        operator.force(traction, self._force)
        scale = max(float(v.norm()) for v in (self._product, self._force, self._b)) or 1.0
        unbalanced = self._product.duplicate()
        unbalanced.waxpy(1.0, self._force, self._product)
        unbalanced.axpy(-1.0, self._b)
        unbalanced.pointwiseMult(unbalanced, self._free)
        self._product.pointwiseMult(unbalanced, self._inverse)
        energy = float(self._product.dot(unbalanced))
        operator.force(left, self._force)
        forces = float(np.hypot(self._force.norm(), unbalanced.norm()))
        self._force.aypx(-1.0, unbalanced)
        self._force.pointwiseMult(self._force, self._free)
        rounding = 4.0 * EPS * self._matrix.norm * float(change.norm()) / scale
        joints, of_joints, more = self._in_joints(response, left, np.abs(gap), traction)
        return _Iterate(
            change=change,
            traction=traction,
            response=response,
            left=left,
            inverse=np.linalg.inv(np.eye(3) - response.tangent * self._c[:, None, :]),
            unbalanced=unbalanced,
            norm=float(np.sqrt(energy + more)),
            forces=forces,
            relative=np.array([joints, float(self._force.norm()) / scale]),
            rounding=np.minimum([of_joints, rounding], [1e-3, 1e-6]),
        )

    def _in_joints(
        self, response: Response, left: Floats, gap: Floats, traction: Floats
    ) -> tuple[float, float, float]:
        """What is left and what rounding leaves of the largest force; energy [J] (collective)."""
        reach = gap + np.abs(self._c * traction)
        exact = np.divide(reach, self._c, out=np.zeros_like(reach), where=self._c > 0.0)
        sizes = [self._areas * np.abs(each) for each in (left, response.traction, exact)]
        mine = [each.max(initial=0.0) for each in sizes]
        every = of_ranks(
            self._contact.operator.comm,
            np.array([*mine, np.sum(self._areas * self._c * left**2)]),
        )
        worst, largest, rounding = every[:, :3].max(axis=0)
        largest = largest or worst or 1.0
        return worst / largest, 64.0 * EPS * rounding / largest, float(every[:, 3].sum())

    def stiffness(self, at: _Iterate) -> Floats:
        """D = (I - T c)^-1 T of each point, shape (n, 3, 3), [Pa/m]."""
        found: Floats = at.inverse @ at.response.tangent
        return found

    def right(self, at: _Iterate) -> PETSc.Vec:
        """Right-hand side of (13b), its sign changed [N] (collective)."""
        traction = np.einsum("nij,nj->ni", at.inverse, at.left)
        force = self._contact.operator.force(traction, self._force)
        right = at.unbalanced.copy()
        right.axpy(-1.0, force)
        right.pointwiseMult(right, self._free)
        return right

    def search(self, at: _Iterate, correction: PETSc.Vec, cuts: int) -> _Iterate:
        """Take the correction, halved while it does not make the residual smaller (collective)."""
        gaps = self._contact.operator.jump(correction)
        back = np.einsum("nij,nj->ni", at.response.tangent, gaps) + at.left
        back = np.einsum("nij,nj->ni", at.inverse, back)
        smallest = np.inf
        for cut in range(cuts + 1):
            share, change = 0.5**cut, at.change.duplicate()
            change.waxpy(-share, correction, at.change)
            trial = self.evaluate(change, at.traction - share * back)
            if trial.norm < smallest or cut == 0:
                smallest, best = trial.norm, trial
            if trial.norm < at.norm:
                break
        return best
