# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Matrices A = m M + c C + k K with constraints, and their linear solvers."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.memory import factor_fits
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.diagnosis import NO_MEMORY, in_words, of_error, why_singular
from dolfinx_joints.solvers.multigrid import IterativeSolver, options_set

Floats = NDArray[np.float64]

# Columns that `DirectSolver.solve_block` is best given at once: fewer read the factor more often
# per column, more gain nothing (measurements in docs/design.md).
BLOCK = 64


# Linear solvers of the effective matrix.
LINEAR = ("auto", "direct", "mumps", "iterative")

# MUMPS' option for the per cent by which its workspace exceeds the estimate.
WORKSPACE = "mat_mumps_icntl_14"
MORE_WORKSPACE = 300

OUT_OF_MEMORY = int(PETSc.PC.FailedReason.FACTOR_OUTMEMORY)
ZERO_PIVOT = (
    int(PETSc.PC.FailedReason.FACTOR_STRUCT_ZEROPIVOT),
    int(PETSc.PC.FailedReason.FACTOR_NUMERIC_ZEROPIVOT),
)


@dataclass(frozen=True, kw_only=True)
class MatrixCoefficients:
    """Coefficients of A = mass M + damping C + stiffness K."""

    mass: float
    damping: float
    stiffness: float


# K alone.
STATIC = MatrixCoefficients(mass=0.0, damping=0.0, stiffness=1.0)


class DirectSolver:
    """A PETSc direct solver under a prefix of its own.

    Args:
        matrix: Matrix to be factored.
        symmetric: Use Cholesky (CHOLMOD in serial where PETSc has it, else MUMPS) instead of LU.
        mumps: Use MUMPS everywhere.
        options: PETSc options without prefix that replace the defaults.

    Attributes:
        package: PETSc's name of the package that factors.
    """

    _made = 0

    def __init__(
        self,
        matrix: PETSc.Mat,
        *,
        symmetric: bool,
        mumps: bool = False,
        options: Mapping[str, Any] | None = None,
    ) -> None:
        """Choose the package; nothing is factored yet."""
        self._matrix = matrix
        cholmod = symmetric and not mumps and matrix.comm.size == 1 and _has_cholmod()
        package = "cholmod" if cholmod else "mumps"
        self._options: dict[str, Any] = {
            "ksp_type": "preonly",
            "pc_type": "cholesky" if symmetric else "lu",
            "pc_factor_mat_solver_type": package,
        }
        if package == "cholmod":
            self._options["mat_cholmod_print"] = 0  # its failures are raised, not printed
        if package == "mumps":
            self._options[WORKSPACE] = 60
        self._options |= dict(options or {})
        self.package = str(self._options["pc_factor_mat_solver_type"])
        self._create()
        self._stale = True

    def _create(self) -> None:
        DirectSolver._made += 1
        self._ksp = PETSc.KSP().create(self._matrix.comm)
        self._ksp.setOptionsPrefix(f"dolfinx_joints_{DirectSolver._made}_")

    def refresh(self) -> None:
        """Factor the matrix anew at the next solve."""
        self._stale = True

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve A x = b; whether the matrix was factored for it (collective).

        Raises:
            JointsError: The factorization failed.
        """
        factored = self._factor_if_stale()
        with self._told():
            self._ksp.solve(b, x)
        if self._ksp.getConvergedReason() < 0 or (factored and not self._solves(b, x)):
            self._stale = True
            raise JointsError(why_singular(self._matrix))
        return factored

    def solve_block(self, right: Floats) -> Floats:
        """Solve A X = B for many right-hand sides at once (collective).

        A factor is read once per block and not once per column, which makes a column several
        times cheaper; `BLOCK` columns are a good number.

        Args:
            right: Owned rows of B, shape (local rows, columns), [N]; all ranks give as many
                columns.

        Returns:
            Owned rows of X, of the same shape, [m].

        Raises:
            JointsError: The factorization failed.
        """
        factored = self._factor_if_stale()
        if right.shape[1] == 0:
            return right.copy()
        b, x = self._dense(right), self._dense(np.empty_like(right))
        with self._told():
            self._ksp.getPC().getFactorMatrix().matSolve(b, x)
        if factored and not self._solves_block(b, x):
            self._stale = True
            raise JointsError(why_singular(self._matrix))
        solution = x.getDenseArray(readonly=True).copy()
        b.destroy()
        x.destroy()
        return solution

    def _dense(self, rows: Floats) -> PETSc.Mat:
        """A dense matrix of the ranks' rows."""
        size = (self._matrix.getSizes()[0], (PETSc.DECIDE, rows.shape[1]))
        return PETSc.Mat().createDense(size, array=np.asfortranarray(rows), comm=self._matrix.comm)

    def _solves(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Whether a new factor gives a solution: LU of a singular matrix may end without error."""
        residual = b.duplicate()
        self._matrix.mult(x, residual)
        residual.axpy(-1.0, b)
        return bool(residual.norm() <= 1e-2 * b.norm())

    def _solves_block(self, b: PETSc.Mat, x: PETSc.Mat) -> bool:
        """The same for a block."""
        residual = self._matrix.matMult(x)
        residual.axpy(-1.0, b)
        solves = bool(residual.norm() <= 1e-2 * b.norm())
        residual.destroy()
        return solves

    def _factor_if_stale(self) -> bool:
        """Factor the matrix if it has changed; whether it has."""
        if not self._stale:
            return False
        failure = self._factor()
        if failure == OUT_OF_MEMORY:
            # MUMPS guesses its workspace before it knows the pivots: once with far more.
            self._ksp.destroy()
            self._create()
            self._options[WORKSPACE] = MORE_WORKSPACE
            failure = self._factor()
        if failure == OUT_OF_MEMORY:
            raise JointsError(f"{NO_MEMORY}{in_words(self._ksp.getPC())}.")
        if failure in ZERO_PIVOT:
            why = why_singular(self._matrix)
            raise JointsError(why[:-1] + in_words(self._ksp.getPC()) + why[-1])
        if failure:
            told = in_words(self._ksp.getPC()) or f"; PETSc's reason is {failure}"
            raise JointsError(f"The matrix could not be factored{told}.")
        self._stale = False
        return True

    def _factor(self) -> int:
        """Factor the matrix; PETSc's reason of a failure, or 0."""
        with options_set(self._ksp.getOptionsPrefix(), self._options):
            self._ksp.setOperators(self._matrix)
            with self._told():
                self._ksp.setFromOptions()
                self._ksp.setUp()
        return int(self._ksp.getPC().getFailedReason())

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Say an error of PETSc in a sentence (collective)."""
        try:
            yield
        except PETSc.Error as exc:
            self._stale = True
            raise JointsError(of_error(exc, self._matrix)) from None

    def destroy(self) -> None:
        """Free the factor."""
        self._ksp.destroy()


class EffectiveMatrix:
    """A = m M + c C + k K of a system, without and with its constraints.

    Args:
        system: Where M, C, K and the constraints come from.
        effective: The coefficients.
        linear: ``direct``, ``mumps`` (direct, without CHOLMOD), ``iterative``, or ``auto``:
            iterative where A is symmetric and its factor is not expected to fit into memory,
            direct elsewhere.
        added: What A holds besides.

    Attributes:
        full: A.
        held: A with rows and columns of constrained dofs replaced by a diagonal.
        norm: Infinity norm of A.
        symmetric: Whether A is.
    """

    def __init__(
        self,
        system: MatrixSystem,
        effective: MatrixCoefficients,
        *,
        linear: str = "auto",
        added: PETSc.Mat | None = None,
    ) -> None:
        """Add the matrices up (collective).

        Raises:
            ValueError: ``linear`` is unknown, or ``iterative`` and A is not symmetric.
        """
        check_linear(linear, symmetric=system.symmetric)
        self.full = system.combined(effective.mass, effective.damping, effective.stiffness)
        if added is not None:
            self.full.axpy(1.0, added, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        self.held = self.full.copy()
        rows = (system.constrained + self.held.getOwnershipRange()[0]).astype(PETSc.IntType)
        self.held.zeroRowsColumns(rows, diag=_mean_diagonal(self.full))
        self.norm = float(self.full.norm(PETSc.NormType.NORM_INFINITY))
        self.symmetric, self._moves = system.symmetric, system.values is not None
        self._linear, self._components = linear, system.components
        self._near = system.stiffness.getNearNullSpace()
        self._solver: DirectSolver | IterativeSolver | None = None

    @property
    def solver(self) -> DirectSolver | IterativeSolver:
        """Solver of ``held``, made when first asked for and then kept (collective)."""
        if self._solver is None:
            self._solver = self._made()
        return self._solver

    def _made(self) -> DirectSolver | IterativeSolver:
        if not self._iterates():
            mumps = self._linear == "mumps"
            return DirectSolver(self.held, symmetric=self.symmetric, mumps=mumps)
        self.held.setNearNullSpace(self._near)
        return IterativeSolver(self.held)

    def _iterates(self) -> bool:
        if self._linear != "auto":
            return self._linear == "iterative"
        if not self.symmetric:
            return False
        comm = self.held.comm.tompi4py()
        return not factor_fits(comm, self.held.getSize()[0], self._components)

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
            factored = self.solver.solve(right, x)
            x.pointwiseMult(x, free)  # iterations leave rounding there: clamped points would open
            return factored
        held, pushed = x.duplicate(), b.duplicate()
        held.pointwiseMult(x, free)
        held.aypx(-1.0, x)
        self.full.mult(held, pushed)
        pushed.pointwiseMult(pushed, free)
        right.axpy(-1.0, pushed)
        factored = self.solver.solve(right, x)
        x.pointwiseMult(x, free)
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

    def items(self) -> list[tuple[Any, Any]]:
        """Keys and things kept, the one used last at the end."""
        return list(self._kept.items())


def check_linear(linear: str, *, symmetric: bool) -> None:
    """Refuse a linear solver that does not exist or does not fit.

    Raises:
        ValueError: It is not one of `LINEAR`, or ``iterative`` and the matrices not symmetric.
    """
    if linear not in LINEAR:
        raise ValueError(f"linear is {linear!r}; it must be one of {', '.join(LINEAR)}.")
    if linear == "iterative" and not symmetric:
        raise ValueError(
            "linear is 'iterative', which needs symmetric matrices; take 'direct' or 'auto'."
        )


def unconstrained_dofs(system: MatrixSystem) -> PETSc.Vec:
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
