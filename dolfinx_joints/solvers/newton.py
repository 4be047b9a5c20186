# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Monolithic reference solver of a step: Newton's method on A x + B^T (w t(g + B x)) = b (13).

Nonlinear cells add forces in the same way (`body.nonlinear_cells`).

x is the change of the displacement in the step, g the gap at the start of the step, t the traction,
w the areas of the joint points, and A = m M + c C + k K. The same code solves statics (k = 1) and
every time step. Small changes of large displacements lose no digits, because x is the change.
"""

from __future__ import annotations

from abc import ABC
from dataclasses import dataclass
from typing import Any, TypeVar

from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.errors import ConvergenceError, JointsError
from dolfinx_joints.common.mpi import free_petsc_garbage
from dolfinx_joints.laws.law import DISCRETE_GRADIENT, Response
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.effective_matrix import (
    Cache,
    EffectiveMatrix,
    iterates,
    unconstrained_dofs,
)
from dolfinx_joints.solvers.multigrid.bulk import IterativeSolver
from dolfinx_joints.solvers.newton_loop import Problem, forcing, newton
from dolfinx_joints.solvers.step_solver import (
    Solution,
    SolveReport,
    SolverOptions,
    StepEquation,
    StepSolver,
)
from dolfinx_joints.solvers.tangent import Tangent


class NewtonSolver(StepSolver):
    """Full Newton method with the consistent, unsymmetric tangent, factored or solved by multigrid.

    Without joints a solve is one back-substitution. The matrices and factors of the last few sets
    of coefficients are kept.

    Args:
        system: The system.
        options: Tolerances and limits.
        name: Name in reports, if there are joints.

    Attributes:
        unconstrained: 1 for free dofs, 0 for constrained ones.
    """

    def __init__(
        self,
        system: MatrixSystem,
        options: SolverOptions | None = None,
        *,
        name: str = "monolithic",
    ) -> None:
        """Prepare the cache of tangents (collective)."""
        self.system, internal_forces = system, system.internal_forces
        self.name = "linear" if internal_forces is None else name
        self.options = options or SolverOptions()
        self.unconstrained = free = unconstrained_dofs(system)
        product = None if internal_forces is None else internal_forces.tangent_matrix(free)
        iterated = iterates(system, self.options.linear)
        chosen = self.options  # capturing self in the cache would create a reference cycle
        self._tangents = Cache(
            lambda key: Tangent(
                EffectiveMatrix.of(system, key, linear=chosen.linear),
                product,
                chosen.linear_options,
            ),
            size=limits.FEWEST_KEPT if iterated else limits.TANGENTS_KEPT,
        )

    def _solve(self, equation: StepEquation) -> Solution:
        """Solve the equation of a step (collective)."""
        tangent: Tangent = self._tangents(equation.effective)
        matrix, linear = tangent.effective, (equation.b, equation.x, self.unconstrained)
        if self.system.internal_forces is None:
            tolerates_residual = matrix.inertia and matrix.change is None
            tolerates_residual = tolerates_residual and isinstance(matrix.solver, IterativeSolver)
            options = {"tolerance": limits.STEP_TOLERANCE} if tolerates_residual else {}
            factored = int(matrix.solve_linear(*linear, **options))
            return None, SolveReport(iterations=1, factorizations=factored, solver=self.name)
        if not self.follows_path:
            matrix.solve_linear(*linear)
        problem = self._problem(tangent, equation)
        at, norms = newton(problem, self.options, leaps=self.system.bulk is None)
        if problem.polishes and at.norm > 0.0:
            at = problem.polished(at)
            norms.append(at.norm)
        at.change.copy(equation.x)
        return at.response, SolveReport(
            iterations=len(norms) - 1,
            factorizations=problem.factorizations,
            residual=at.relative,
            counts=self.system.internal_forces.counts(at.response),
            residuals=tuple(norm / at.unit for norm in norms),
            solver=self.name,
        )

    def _problem(self, tangent: Tangent, equation: StepEquation) -> BodyProblem[Any]:
        """Return the equation of a step as a problem of Newton's method (collective)."""
        return _Displacement(self, tangent, equation)


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyIterate:
    """Displacement with its response and residual.

    Attributes:
        change: x [m].
        response: Response of the laws.
        unbalanced: A x + B^T (w t) - b at the unconstrained dofs [N].
        norm: Norm of the residual.
        unit: Unit of reported norms.
        relative: Residual relative to the forces.
        accepted: True if the residual is within the tolerance or rounding error.
        target: Share of the residual that should remain after a correction.
    """

    change: PETSc.Vec
    response: Response
    unbalanced: PETSc.Vec
    norm: float
    unit: float
    relative: float
    accepted: bool
    target: float


AnyIterate = TypeVar("AnyIterate", bound=BodyIterate)


class BodyProblem(Problem[AnyIterate, PETSc.Vec], ABC):
    """Problem whose corrections of x are solved with the matrix A + B^T (w D) B.

    Args:
        solver: Solver of the step.
        tangent: The matrix.
        equation: Equation of the step.

    Attributes:
        polishes: True if the solution is corrected once more (`polished`).
        factorizations: Number of matrices factored so far.
    """

    polishes = False

    def __init__(self, solver: NewtonSolver, tangent: Tangent, equation: StepEquation) -> None:
        """Allocate the work vectors (collective)."""
        assert solver.system.internal_forces is not None
        assert equation.state is not None
        self.internal_forces, self.state = solver.system.internal_forces, equation.state
        self._solver, self._tangent, self.matrix = solver, tangent, tangent.effective
        self.free, self.wanted = solver.unconstrained, solver.options.relative_tolerance
        self.b, self.x, self.rule, self.factorizations = equation.b, equation.x, equation.rule, 0
        self.force, self._correction = (equation.b.duplicate() for _ in range(2))

    def accepted(self, at: AnyIterate) -> AnyIterate:
        """Return the iterate unchanged; free the vectors of rejected iterates (collective)."""
        free_petsc_garbage(at.change.comm.tompi4py())
        return at

    def solved(self, at: AnyIterate, before: AnyIterate | None, *, last: bool) -> bool:
        """Return True if the residual is small enough.

        In statics a residual within rounding error needs one more `correction` to be accepted.
        """
        return at.accepted if self.matrix.inertia else at.relative <= self.wanted

    def correction(self, at: AnyIterate, before: AnyIterate | None) -> PETSc.Vec | None:
        """Return Newton's correction of x (collective).

        In statics return None if the residual is within rounding error and the correction is small;
        the corrections of an unsupported block stay large.
        """
        reduction = 1.0 if before is None else at.norm / before.norm
        correction = self._correct(at, forcing(limits.BODY_FORCING, reduction, at.target))
        settled = at.accepted and correction.norm() <= limits.SETTLED * at.change.norm()
        return None if settled else correction

    def polished(self, at: AnyIterate) -> AnyIterate:
        """Correct once more if the residual decreases, to balance the energy (collective)."""
        better = self.trial(at, self._correct(at, limits.POLISH), 1.0)
        return better if better.norm < at.norm else at

    def failure(
        self, at: AnyIterate, before: AnyIterate | None, iterations: int
    ) -> ConvergenceError:
        """Return the error of an iteration that did not converge (collective)."""
        return self._solver.failure(at.response, self.state, iterations, at.relative)

    def stiffness(self, at: AnyIterate, part: float) -> Floats:
        """Return D of all points, plus a share of the stiffness of closed joints."""
        return self.internal_forces.tangent(at.response, part)

    def right_hand_side(self, at: AnyIterate, tolerance: float) -> tuple[PETSc.Vec, float]:
        """Return the right-hand side of a correction [N] and the tolerance of its solution."""
        return at.unbalanced, tolerance

    def _correct(self, at: AnyIterate, tolerance: float) -> PETSc.Vec:
        """Return Newton's correction of x (collective).

        The tangent may be singular if a block has neither a support nor a sticking point, or if
        cells yield. A small share of the stiffness of closed joints and elastic cells is then added
        to the tangent. The correction depends on this share, the equilibrium does not.
        """
        load, tolerance = self.right_hand_side(at, tolerance)
        for part in limits.REGULARISATIONS:
            try:
                solver = self._tangent.update(self.stiffness(at, part))
                self.factorizations += int(solver.solve(load, self._correction, tolerance))
                # Iterative solvers leave small values at constrained dofs; reset them to zero.
                self._correction.pointwiseMult(self._correction, self.free)
                return self._correction
            except JointsError as error:
                self._tangent.forget()
                failure = error
        facts = self.internal_forces.failure(at.response, self.state)
        if facts.get("law"):
            raise ConvergenceError(**facts) from failure
        raise failure


class _Displacement(BodyProblem[BodyIterate]):
    """Residual A x + B^T (w t(g + B x)) - b, relative to the forces at the start and at x."""

    def __init__(self, solver: NewtonSolver, tangent: Tangent, equation: StepEquation) -> None:
        """Allocate the work vectors (collective)."""
        super().__init__(solver, tangent, equation)
        self.polishes = equation.rule.name == DISCRETE_GRADIENT.name
        self._yields, self._first_scale = solver.system.bulk is not None, 0.0

    def start(self) -> BodyIterate:
        """Return the first iterate (collective)."""
        start = self._evaluate(self.x.copy())
        self._first_scale = start.unit
        return start

    def trial(self, at: BodyIterate, correction: PETSc.Vec, share: float) -> BodyIterate:
        """Return the iterate after subtracting a share of a correction (collective)."""
        change = at.change.duplicate()
        change.waxpy(-share, correction, at.change)
        return self._evaluate(change)

    def _evaluate(self, change: PETSc.Vec) -> BodyIterate:
        """Return the iterate of a displacement (collective)."""
        response = self.internal_forces.respond(change, self.state, self.rule)
        self.internal_forces.force(response, self.force)
        unbalanced = change.duplicate()
        self.matrix.multiply(change, unbalanced)
        sizes = [unbalanced.norm(), self.force.norm(), self.b.norm()]
        unbalanced.axpy(1.0, self.force)
        if self._yields:
            # In yielding cells K x and the excess force grow without bound; their sum does not.
            sizes[:2] = [unbalanced.norm()]
        unbalanced.axpy(-1.0, self.b)
        unbalanced.pointwiseMult(unbalanced, self.free)
        norm, scale = float(unbalanced.norm()), max(self._first_scale, *sizes) or 1.0
        largest = float(change.norm(PETSc.NormType.NORM_INFINITY))
        of_laws = self.internal_forces.rounding(response, largest)
        rounding = limits.PRODUCT_ROUNDING * (self.matrix.norm * float(change.norm()) + of_laws)
        tolerance = max(self.wanted, min(rounding / scale, limits.LARGEST_ROUNDING))
        return BodyIterate(
            change=change,
            response=response,
            unbalanced=unbalanced,
            norm=norm,
            unit=scale,
            relative=norm / scale,
            accepted=norm <= tolerance * scale,
            target=tolerance * scale / (norm or 1.0),
        )
