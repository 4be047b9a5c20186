# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Effective matrices A = m M + c C + k K with constraints, and their direct solvers."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from petsc4py import PETSc

from dolfinx_joints.errors import JointsError
from dolfinx_joints.system import MatrixSystem


@dataclass(frozen=True, kw_only=True)
class Effective:
    """Coefficients of A = mass M + damping C + stiffness K."""

    mass: float
    damping: float
    stiffness: float


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
        if package == "cholmod":
            chosen["mat_cholmod_print"] = 0  # its failures are raised, not printed
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
        if self._ksp.getConvergedReason() < 0 or (factored and not self._solves(b, x)):
            self._stale = True
            raise JointsError(
                "The matrix is singular to working precision: is every block held by supports, "
                "springs or a closed joint?"
            )
        return factored

    def _solves(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Whether a new factor gives a solution: LU of a singular matrix may end without error."""
        residual = b.duplicate()
        self._matrix.mult(x, residual)
        residual.axpy(-1.0, b)
        return bool(residual.norm() <= 1e-2 * b.norm())

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


class EffectiveMatrix:
    """A = m M + c C + k K of a system, without and with its constraints.

    Args:
        system: Where M, C, K and the constraints come from.
        effective: The coefficients.

    Attributes:
        full: A.
        held: A with rows and columns of constrained dofs replaced by a diagonal.
        norm: Infinity norm of A.
    """

    def __init__(self, system: MatrixSystem, effective: Effective) -> None:
        """Add the matrices up (collective)."""
        self.full = system.combined(effective.mass, effective.damping, effective.stiffness)
        self.held = self.full.copy()
        rows = (system.constrained + self.held.getOwnershipRange()[0]).astype(PETSc.IntType)
        self.held.zeroRowsColumns(rows, diag=_mean_diagonal(self.full))
        self.norm = float(self.full.norm(PETSc.NormType.NORM_INFINITY))
        self._symmetric, self._moves = system.symmetric, system.values is not None
        self._solver: DirectSolver | None = None

    @property
    def solver(self) -> DirectSolver:
        """Direct solver of ``held``, made when first asked for and then kept."""
        if self._solver is None:
            self._solver = DirectSolver(self.held, symmetric=self._symmetric)
        return self._solver

    def solve_linear(self, b: PETSc.Vec, x: PETSc.Vec, free: PETSc.Vec) -> bool:
        """Solve A x = b in place, x holding the values of the constrained dofs (collective).

        Args:
            b: Right-hand side [N].
            x: Values of the constrained dofs, the others replaced by the solution [m].
            free: 1 for free and 0 for constrained dofs.

        Returns:
            Whether the matrix was factored for it.
        """
        right = b.duplicate()
        right.pointwiseMult(b, free)
        if not self._moves:
            x.set(0.0)
            return self.solver.solve(right, x)
        held, pushed = x.duplicate(), b.duplicate()
        held.pointwiseMult(x, free)
        held.aypx(-1.0, x)
        self.full.mult(held, pushed)
        pushed.pointwiseMult(pushed, free)
        right.axpy(-1.0, pushed)
        factored = self.solver.solve(right, x)
        x.axpy(1.0, held)
        return factored

    def destroy(self) -> None:
        """Free matrices and factor."""
        if self._solver is not None:
            self._solver.destroy()
        self.full.destroy()
        self.held.destroy()


class Cache:
    """The last few things made, by key; what is pushed out is destroyed."""

    def __init__(self, make: Any, *, size: int = 4) -> None:
        """``make`` gives the thing for a key."""
        self._make, self._size = make, size
        self._kept: OrderedDict[Any, Any] = OrderedDict()

    def __call__(self, key: Any) -> Any:
        """The thing for a key, made if need be."""
        if key not in self._kept:
            while len(self._kept) >= self._size:
                self._kept.popitem(last=False)[1].destroy()
            self._kept[key] = self._make(key)
        self._kept.move_to_end(key)
        return self._kept[key]


def free_dofs(system: MatrixSystem) -> PETSc.Vec:
    """1 for free and 0 for constrained dofs."""
    free = system.stiffness.createVecRight()
    free.set(1.0)
    free.getArray()[system.constrained] = 0.0
    return free


def _mean_diagonal(matrix: PETSc.Mat) -> float:
    diagonal = matrix.getDiagonal()
    return float(diagonal.norm(PETSc.NormType.NORM_1) / max(matrix.getSize()[0], 1)) or 1.0


def _has_cholmod() -> bool:
    return bool(PETSc.Sys.hasExternalPackage("cholmod"))
