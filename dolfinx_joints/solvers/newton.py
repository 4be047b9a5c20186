# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The algebraic step, monolithic reference path: Newton on A x + B^T (w t(g + B x)) = b.

Plastic cells add forces of their own in the same way (`plastic_bulk`).

x is the change of the displacement in the step, g the gap at its start and A = m M + c C + k K;
statics (k = 1) and every time step are solved by the same code, which does not know what time is.
In changes, nothing is lost to the rounding of large displacements that hardly move.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.errors import ConvergenceError, JointsError
from dolfinx_joints.joints.internal_forces import InternalForces
from dolfinx_joints.laws.law import BACKWARD_EULER, DISCRETE_GRADIENT, JointState, Response, Rule
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.effective_matrix import (
    Cache,
    EffectiveMatrix,
    MatrixCoefficients,
    iterates,
    unconstrained_dofs,
)
from dolfinx_joints.solvers.line_search import LineSearch
from dolfinx_joints.solvers.multigrid.bulk import STEP_TOLERANCE, IterativeSolver
from dolfinx_joints.solvers.step_solver import SolveReport, SolverOptions, solve_failure
from dolfinx_joints.solvers.tangent import Tangent

Floats = NDArray[np.float64]

# Parts of the closed joints' stiffness tried in turn where a tangent is singular.
REGULARISATIONS = (0.0, 1e-4, 1e-2)

# A static solution accepted for rounding moves by no more than this part of it in a correction.
SETTLED = 1e-5

# Corrections of iterative solvers leave this part of the residual at first, the last one that.
INNER_TOLERANCE, POLISH = 0.1, 0.01


class NewtonSolver:
    """Full Newton on the consistent, unsymmetric tangent, factored or solved by multigrid.

    Without joints, one back-substitution per solve with a factor that is kept. Matrices and
    factors are kept for the last few sets of coefficients.

    Args:
        system: The system.
        options: Tolerances and limits.
        name: What reports call it where there are joints.
    """

    def __init__(
        self,
        system: MatrixSystem,
        options: SolverOptions | None = None,
        *,
        name: str = "monolithic",
    ) -> None:
        """Make the work vectors (collective)."""
        self.system = system
        self._internal_forces = system.internal_forces
        self.name = "linear" if self._internal_forces is None else name
        self.options = options or SolverOptions()
        self.unconstrained = unconstrained_dofs(system)
        self._correction = self.unconstrained.duplicate()
        internal_forces = self._internal_forces
        product = (
            None if internal_forces is None else internal_forces.tangent_matrix(self.unconstrained)
        )
        kept = 2 if iterates(system, self.options.linear) else 4  # large, and soon made anew
        newton = self.options  # a reference to self in the cache would keep it alive
        self._tangents = Cache(
            lambda key: Tangent(
                EffectiveMatrix.of(system, key, linear=newton.linear),
                product,
                newton.linear_options,
            ),
            size=kept,
        )

    def solve(
        self,
        effective: MatrixCoefficients,
        b: PETSc.Vec,
        x: PETSc.Vec,
        state: JointState | None,
        rule: Rule = BACKWARD_EULER,
    ) -> tuple[Response | None, SolveReport]:
        """Solve for ``x`` in place, starting from it (collective).

        Args:
            effective: Coefficients of A.
            b: Right-hand side [N].
            x: Start of the iteration, with the constrained dofs at their values already [m].
            state: Joint state at the start of the step, None without joints and plastic cells.
            rule: Response that the laws are asked for.

        Returns:
            The joints' response and the report.
        """
        tangent: Tangent = self._tangents(effective)
        internal_forces = self._internal_forces
        if internal_forces is None:
            return None, solve_without_joints(tangent.effective, b, x, self.unconstrained)
        assert state is not None
        balance = _Balance(self, tangent.effective, internal_forces, b, x, state, rule)
        response, report = self._iterate(tangent, balance)
        balance.change.copy(x)
        return response, report

    def matrix(self, effective: MatrixCoefficients) -> EffectiveMatrix:
        """Return A of some coefficients, without the joints (collective)."""
        tangent: Tangent = self._tangents(effective)
        return tangent.effective

    def state_dict(self) -> dict[str, Any]:
        """Empty: every solve starts from its arguments alone."""
        return {}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Keep nothing: there is no state."""

    def _iterate(self, tangent: Tangent, balance: _Balance) -> tuple[Response, SolveReport]:
        options, internal_forces, state = self.options, balance.internal_forces, balance.state
        response, norm = balance.evaluate(balance.change)
        balance.accept()
        factorizations, iteration, norms = 0, 0, [norm]
        line_search = LineSearch(options.max_cuts, leaps=self.system.bulk is None)
        while not norm <= (balance.tolerance if balance.inertia else balance.wanted):
            if iteration == options.max_iterations or not np.isfinite(norm):
                residual = norm / balance.scale
                raise solve_failure(internal_forces, response, state, iteration, residual, options)
            inner = _inner_tolerance(norms, balance.tolerance)
            factorizations += self._correct(tangent, response, balance, inner)
            if norm <= balance.tolerance and self._settled(balance.change):
                break
            response, norm = self._search(balance, norm, line_search.cuts(norm))
            balance.accept()
            iteration += 1
            norms.append(norm)
        if balance.rule.name == DISCRETE_GRADIENT.name and norm > 0.0:
            factorizations += self._correct(tangent, response, balance, POLISH)
            response, norm = self._polish(balance, response, norm)
            iteration += 1
            norms.append(norm)
        return response, SolveReport(
            iterations=iteration,
            factorizations=factorizations,
            residual=norm / (balance.scale or 1.0),
            counts=internal_forces.counts(response),
            residuals=tuple(each / (balance.scale or 1.0) for each in norms),
            solver=self.name,
        )

    def _correct(
        self, tangent: Tangent, response: Response, balance: _Balance, tolerance: float
    ) -> int:
        """Newton's correction; factorizations it took (collective).

        Where the tangent is singular, because on the way a block is supported by no closed and
        sticking point or because plastic cells flow, a small part of the stiffness of closed joints
        and elastic cells is added: the correction only, not the equilibrium, depends on it.
        """
        for part in REGULARISATIONS:
            values = balance.internal_forces.tangent(response, part)
            try:
                solver = tangent.update(values)
                factored = solver.solve(balance.out_of_balance, self._correction, tolerance)
                # Iterations leave rounding there: clamped points would open.
                self._correction.pointwiseMult(self._correction, self.unconstrained)
                return int(factored)
            except JointsError as error:
                tangent.forget()
                failure = error
        facts = balance.internal_forces.failure(response, balance.state)
        if facts.get("law"):
            raise ConvergenceError(**facts) from failure
        raise failure

    def _settled(self, change: PETSc.Vec) -> bool:
        """Whether the correction is small: a block that nothing holds would go on and on."""
        return bool(self._correction.norm() <= SETTLED * change.norm())

    def _polish(self, balance: _Balance, response: Response, norm: float) -> tuple[Response, float]:
        """One more correction, kept if it is one: energy is balanced to rounding, not to less."""
        start = balance.change.copy()
        balance.change.waxpy(-1.0, self._correction, start)
        better, left = balance.evaluate(balance.change)
        if left < norm:
            return better, left
        start.copy(balance.change)
        return response, norm

    def _search(self, balance: _Balance, norm: float, cuts: int) -> tuple[Response, float]:
        """Take the correction, halved while it does not make the residual smaller."""
        start, tried = balance.change.copy(), []
        for cut in range(cuts + 1):
            balance.change.waxpy(-(0.5**cut), self._correction, start)
            answer = balance.evaluate(balance.change)
            tried.append((answer[1], 0.5**cut))
            if answer[1] < norm:
                return answer
        balance.change.waxpy(-min(tried)[1], self._correction, start)
        return balance.evaluate(balance.change)


def _inner_tolerance(norms: list[float], accepted: float) -> float:
    """Part of the residual that an iterative solver may leave of it (Eisenstat and Walker 1996)."""
    last = norms[-1]
    fallen = 1.0 if len(norms) == 1 else last / norms[-2]
    return max(min(INNER_TOLERANCE, fallen**2), 0.3 * accepted / last)


class _Balance:
    """The residual A x + B^T (w t(g + B x)) - b of a solve."""

    def __init__(
        self,
        solver: NewtonSolver,
        matrix: EffectiveMatrix,
        internal_forces: InternalForces,
        b: PETSc.Vec,
        x: PETSc.Vec,
        state: JointState,
        rule: Rule,
    ) -> None:
        self._matrix, self.internal_forces = matrix, internal_forces
        self.state, self.rule = state, rule
        self._unconstrained, self._right = solver.unconstrained, b
        self._relative = solver.options.relative_tolerance
        self._force = b.duplicate()
        self.change = x.copy()
        self.out_of_balance = b.duplicate()
        self.scale, self._trial_scale, self._first_scale = 0.0, 0.0, 0.0
        self._rounding, self.inertia = 0.0, matrix.inertia
        self._flows = solver.system.bulk is not None

    def evaluate(self, change: PETSc.Vec) -> tuple[Response, float]:
        """Response to a change, and the norm of the residual at the unconstrained dofs."""
        left = self.out_of_balance
        response = self.internal_forces.respond(change, self.state, self.rule)
        self.internal_forces.force(response, self._force)
        self._matrix.multiply(change, left)
        sizes = [left.norm(), self._force.norm(), self._right.norm()]
        left.axpy(1.0, self._force)
        if self._flows:
            # Of cells that flow both grow without end; their stress does not.
            sizes[:2] = [left.norm()]
        self._trial_scale = max(sizes)
        self._rounding = self._rounding_error(response, change)
        left.axpy(-1.0, self._right)
        left.pointwiseMult(left, self._unconstrained)
        return response, float(left.norm())

    def accept(self) -> None:
        """Measure from here on against the forces at the start and at this change."""
        self._first_scale = self._first_scale or self._trial_scale
        self.scale = max(self._first_scale, self._trial_scale)

    def _rounding_error(self, response: Response, change: PETSc.Vec) -> float:
        """Rounding error of A x, and of forces that follow from laws."""
        largest = float(change.norm(PETSc.NormType.NORM_INFINITY))
        laws = self.internal_forces.rounding(response, largest)
        bulk = self._matrix.norm * float(change.norm())
        return 4.0 * float(np.finfo(float).eps) * (bulk + laws)

    @property
    def wanted(self) -> float:
        """Largest residual that is wanted, relative to the forces."""
        return self._relative * self.scale

    @property
    def tolerance(self) -> float:
        """Largest residual accepted: that, or what rounding leaves."""
        return max(self.wanted, min(self._rounding, 1e-6 * self.scale))


def solve_without_joints(
    matrix: EffectiveMatrix, b: PETSc.Vec, x: PETSc.Vec, unconstrained: PETSc.Vec
) -> SolveReport:
    """A linear solve with the report of `NewtonSolver.solve` (collective)."""
    options = {}
    if matrix.inertia and matrix.change is None and isinstance(matrix.solver, IterativeSolver):
        options["tolerance"] = STEP_TOLERANCE
    factored = matrix.solve_linear(b, x, unconstrained, **options)
    return SolveReport(
        iterations=1, factorizations=int(factored), residual=0.0, counts=None, solver="linear"
    )
