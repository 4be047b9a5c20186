# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The algebraic step, monolithic reference path: Newton on A u + B^T (w t(B u)) = b.

A = m M + c C + k K; statics (k = 1) and every time step are solved by the same code, which does not
know what time is.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.contact import StatusCounts
from dolfinx_joints.errors import ConvergenceError, JointsError
from dolfinx_joints.joints import JointTangent
from dolfinx_joints.laws import JointState, Response
from dolfinx_joints.system import MatrixSystem

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class NewtonOptions:
    """When Newton stops, and what it may do on its way.

    Attributes:
        relative_tolerance: Residual against the largest of the forces in balance.
        max_iterations: Iterations before the solve is given up.
        max_cuts: Halvings of a Newton correction that the line search may try.
        linear_options: PETSc options of the direct solver of the tangent, without prefix.

    Raises:
        ValueError: A value is out of its range.
    """

    relative_tolerance: float = 1e-10
    max_iterations: int = 30
    max_cuts: int = 4
    linear_options: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        """Check the values."""
        if not 0 < self.relative_tolerance < 1:
            raise ValueError(
                f"relative_tolerance is {self.relative_tolerance}; it must lie between 0 and 1."
            )
        if self.max_iterations < 1 or self.max_cuts < 0:
            raise ValueError(
                f"max_iterations is {self.max_iterations} and max_cuts {self.max_cuts}; they must "
                "be at least 1 and 0."
            )


@dataclass(frozen=True, kw_only=True)
class Effective:
    """Coefficients of A = mass M + damping C + stiffness K."""

    mass: float
    damping: float
    stiffness: float


@dataclass(frozen=True, kw_only=True)
class SolveReport:
    """How a solve went.

    Attributes:
        iterations: Newton iterations (1 for a linear solve).
        factorizations: Matrices factored on the way.
        residual: Last residual, relative to the largest of the forces in balance.
        counts: Joint points by status, None without joints.
    """

    iterations: int
    factorizations: int
    residual: float
    counts: StatusCounts | None


class DirectSolver:
    """A PETSc direct solver under a prefix of its own.

    Args:
        matrix: Matrix to be factored.
        symmetric: Use Cholesky (CHOLMOD in serial where PETSc has it, else MUMPS) instead of LU.
        options: PETSc options without prefix that replace the defaults.
    """

    _made = 0

    def __init__(
        self, matrix: PETSc.Mat, *, symmetric: bool, options: Mapping[str, Any] | None = None
    ) -> None:
        """Set the solver up; nothing is factored yet."""
        DirectSolver._made += 1
        self._ksp = PETSc.KSP().create(matrix.comm)
        self._ksp.setOptionsPrefix(f"dolfinx_joints_{DirectSolver._made}_")
        self._matrix = matrix
        serial = matrix.comm.size == 1
        package = "cholmod" if symmetric and serial and _has_cholmod() else "mumps"
        chosen: dict[str, Any] = {
            "ksp_type": "preonly",
            "pc_type": "cholesky" if symmetric else "lu",
            "pc_factor_mat_solver_type": package,
        }
        if package == "mumps":
            chosen["mat_mumps_icntl_14"] = 60
        self._apply(chosen | dict(options or {}))
        self._stale = True

    def _apply(self, options: Mapping[str, Any]) -> None:
        """Set options under the own prefix and leave the global database clean."""
        database = PETSc.Options()
        prefix = self._ksp.getOptionsPrefix()
        for key, value in options.items():
            database.setValue(prefix + key, value)
        self._ksp.setOperators(self._matrix)
        self._ksp.setFromOptions()
        self._ksp.getPC().setFromOptions()
        self._names = [prefix + key for key in options]

    def refresh(self) -> None:
        """Factor the matrix anew at the next solve."""
        self._stale = True

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve A x = b; whether the matrix was factored for it (collective).

        Raises:
            JointsError: The factorization failed.
        """
        factored = self._stale
        if factored:
            self._ksp.setOperators(self._matrix)
            self._factor()
            self._stale = False
        self._ksp.solve(b, x)
        reason = self._ksp.getConvergedReason()
        if reason < 0:
            self._stale = True
            raise JointsError(
                "The direct solver failed (the matrix is singular: is every block held by supports "
                f"or by a closed joint?); PETSc's reason is {reason}."
            )
        return factored

    def _factor(self) -> None:
        try:
            self._ksp.setUp()
        except PETSc.Error as exc:
            raise JointsError(
                "The matrix could not be factored (singular, or not positive definite: is every "
                f"block held by supports?); PETSc's error code is {exc.ierr}."
            ) from None
        database = PETSc.Options()
        for name in self._names:
            database.delValue(name)
        self._names = []

    def destroy(self) -> None:
        """Free the factor."""
        self._ksp.destroy()


def _has_cholmod() -> bool:
    return bool(PETSc.Sys.hasExternalPackage("cholmod"))


class _Operators:
    """Matrices of one set of coefficients: A, A with constraints, and the joint tangent's sum."""

    def __init__(self, system: MatrixSystem, effective: Effective, options: NewtonOptions) -> None:
        self.full = system.stiffness.copy()
        self.full.scale(effective.stiffness)
        for factor, matrix in (
            (effective.mass, system.mass),
            (effective.damping, system.damping),
        ):
            if factor:
                self.full.axpy(factor, matrix, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        self.held = self.full.copy()
        start = self.held.getOwnershipRange()[0]
        rows = (system.constrained + start).astype(PETSc.IntType)
        self.held.zeroRowsColumns(rows, diag=_mean_diagonal(self.full))
        self.tangent: PETSc.Mat | None = None
        self.newton: DirectSolver | None = None
        self._linear: DirectSolver | None = None
        self._symmetric = system.symmetric
        self._options = options
        self._last: Floats | None = None

    @property
    def linear(self) -> DirectSolver:
        """Direct solver of A with its constraints, without joints."""
        if self._linear is None:
            self._linear = DirectSolver(self.held, symmetric=self._symmetric)
        return self._linear

    def update(self, product: JointTangent, values: Floats) -> DirectSolver:
        """Direct solver of A + B^T (w D) B, factored anew only where D changed."""
        changed = self._last is None or not np.array_equal(values, self._last)
        if not self.full.comm.tompi4py().allreduce(int(changed)):
            return self.newton
        added = product.assemble(values)
        if self.tangent is None:
            # The union of both patterns, once; then sums are plain copies and additions.
            union = added.copy()
            union.zeroEntries()
            union.axpy(1.0, self.held, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
            self.held.destroy()
            self.held = union
            self.tangent = union.copy()
            self.newton = DirectSolver(
                self.tangent, symmetric=False, options=self._options.linear_options
            )
        self.held.copy(self.tangent, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self.tangent.axpy(1.0, added, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        self.newton.refresh()
        self._last = values.copy()
        return self.newton

    def destroy(self) -> None:
        """Free matrices and factors."""
        if self._linear is not None:
            self._linear.destroy()
        if self.newton is not None:
            self.newton.destroy()
            self.tangent.destroy()
        self.full.destroy()
        self.held.destroy()


def _mean_diagonal(matrix: PETSc.Mat) -> float:
    diagonal = matrix.getDiagonal()
    return float(diagonal.norm(PETSc.NormType.NORM_1) / max(matrix.getSize()[0], 1)) or 1.0


class NewtonSolver:
    """Full Newton on the consistent, unsymmetric tangent with a PETSc direct solver.

    Without joints, or with nothing but a linear system, one back-substitution per solve with a
    factor that is kept. Matrices and factors are kept for the last few sets of coefficients.

    Args:
        system: What is to be solved.
        options: Tolerances and limits.
    """

    _kept = 4

    def __init__(self, system: MatrixSystem, options: NewtonOptions | None = None) -> None:
        """Make the work vectors (collective)."""
        self.system = system
        self.options = options or NewtonOptions()
        self._operators: OrderedDict[Effective, _Operators] = OrderedDict()
        self._force = system.stiffness.createVecRight()
        self._residual = self._force.duplicate()
        self._correction = self._force.duplicate()
        self._trial = self._force.duplicate()
        self._free = self._force.duplicate()
        self._free.set(1.0)
        self._free.getArray()[system.constrained] = 0.0
        self._product: JointTangent | None = None
        if system.contact is not None:
            self._product = JointTangent(system.contact.operator, self._free)

    def solve(
        self, effective: Effective, b: PETSc.Vec, u: PETSc.Vec, state: JointState | None
    ) -> tuple[Response | None, PETSc.Vec, SolveReport]:
        """Solve for ``u`` in place, starting from it (collective).

        Args:
            effective: Coefficients of A.
            b: Right-hand side [N].
            u: Start of the iteration, with the constrained dofs at their values already.
            state: Joint state at the start of the step, None without joints.

        Returns:
            The joints' response, the reactions (zero at free dofs) [N], and the report.

        Raises:
            ConvergenceError: Newton did not converge; ``u`` is then of no use.
            JointsError: A factorization failed.
        """
        operators = self._get(effective)
        if self.system.contact is None:
            return self._solve_linear(operators, b, u)
        return self._iterate(operators, b, u, state)

    def _get(self, effective: Effective) -> _Operators:
        if effective not in self._operators:
            while len(self._operators) >= self._kept:
                self._operators.popitem(last=False)[1].destroy()
            self._operators[effective] = _Operators(self.system, effective, self.options)
        self._operators.move_to_end(effective)
        return self._operators[effective]

    def _solve_linear(
        self, operators: _Operators, b: PETSc.Vec, u: PETSc.Vec
    ) -> tuple[None, PETSc.Vec, SolveReport]:
        operators.full.mult(u, self._residual)
        self._residual.axpy(-1.0, b)
        self._residual.pointwiseMult(self._residual, self._free)
        factored = operators.linear.solve(self._residual, self._correction)
        u.axpy(-1.0, self._correction)
        operators.full.mult(u, self._residual)
        self._residual.axpy(-1.0, b)
        reaction = self._residual.copy()
        self._residual.pointwiseMult(self._residual, self._free)
        reaction.axpy(-1.0, self._residual)
        residual = self._residual.norm() / (b.norm() or 1.0)
        report = SolveReport(
            iterations=1, factorizations=int(factored), residual=residual, counts=None
        )
        return None, reaction, report

    def _evaluate(
        self, operators: _Operators, b: PETSc.Vec, u: PETSc.Vec, state: JointState
    ) -> tuple[Response, float, float]:
        """Residual at ``u`` (kept, all dofs), its norm at the free dofs, and the force scale."""
        contact = self.system.contact
        response = contact.trial(u, state)
        operators.full.mult(u, self._residual)
        contact.operator.force(response.traction, self._force)
        scale = max(self._residual.norm(), self._force.norm(), b.norm())
        self._residual.axpy(1.0, self._force)
        self._residual.axpy(-1.0, b)
        self._force.pointwiseMult(self._residual, self._free)
        return response, float(self._force.norm()), float(scale)

    def _iterate(
        self, operators: _Operators, b: PETSc.Vec, u: PETSc.Vec, state: JointState
    ) -> tuple[Response, PETSc.Vec, SolveReport]:
        options = self.options
        response, norm, scale = self._evaluate(operators, b, u, state)
        factorizations, iteration = 0, 0
        while norm > options.relative_tolerance * scale:
            if iteration == options.max_iterations or not np.isfinite(norm):
                raise self._failure(response, state, iteration, norm / scale)
            direct = operators.update(self._product, response.tangent)
            self._force.pointwiseMult(self._residual, self._free)
            factorizations += direct.solve(self._force, self._correction)
            response, norm, scale = self._search(operators, b, u, state, norm)
            iteration += 1
        reaction = self._residual.copy()
        self._force.pointwiseMult(self._residual, self._free)
        reaction.axpy(-1.0, self._force)
        report = SolveReport(
            iterations=iteration,
            factorizations=factorizations,
            residual=norm / (scale or 1.0),
            counts=self.system.contact.counts(response.status),
        )
        return response, reaction, report

    def _search(
        self,
        operators: _Operators,
        b: PETSc.Vec,
        u: PETSc.Vec,
        state: JointState,
        norm: float,
    ) -> tuple[Response, float, float]:
        """Take the correction, halved while that makes the residual smaller than before."""
        best, length = (np.inf, 1.0), 1.0
        for _ in range(self.options.max_cuts + 1):
            self._trial.waxpy(-length, self._correction, u)
            response, trial_norm, scale = self._evaluate(operators, b, self._trial, state)
            best = min(best, (trial_norm, length))
            if trial_norm < norm:
                break
            length *= 0.5
        else:
            length = best[1]
            self._trial.waxpy(-length, self._correction, u)
            response, trial_norm, scale = self._evaluate(operators, b, self._trial, state)
        self._trial.copy(u)
        return response, trial_norm, scale

    def _failure(
        self, response: Response, state: JointState, iteration: int, residual: float
    ) -> ConvergenceError:
        contact = self.system.contact
        counts = contact.counts(response.status)
        jump = np.abs(response.state.gap - state.gap).sum(axis=1)
        return ConvergenceError(
            iteration=iteration,
            residual=residual,
            tolerance=self.options.relative_tolerance,
            open=counts.open,
            stick=counts.stick,
            slip=counts.slip,
            joint=contact.worst_joint(jump),
        )
