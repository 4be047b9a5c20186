# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Iterative solver of symmetric positive definite matrices that are too large for a factor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.solvers import limits

OPTIONS: dict[str, Any] = {
    "ksp_type": "cg",
    "ksp_norm_type": "unpreconditioned",
    "ksp_rtol": limits.MULTIGRID_TOLERANCE,
    "ksp_max_it": 500,
    "pc_type": "gamg",
    "pc_mg_cycle_type": "w",  # V-cycles take more iterations on larger bodies
    "pc_use_amat": True,
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_pc_type": "pbjacobi",
}

# Compute P^T A P on several ranks without copies of A P and P, which would double the memory of the
# levels. This algorithm is slower if a product is repeated.
PTAP = {"matptap_via": "allatonce"}


@contextmanager
def options_set(prefix: str, options: Mapping[str, Any]) -> Iterator[None]:
    """Set PETSc options under a prefix temporarily, except those that the user has set."""
    database = PETSc.Options()
    unset = [key for key in options if not database.hasName(prefix + key)]
    for key in unset:
        database.setValue(prefix + key, options[key])
    try:
        yield
    finally:
        for key in unset:
            database.delValue(prefix + key)


def made_once(comm: PETSc.Comm) -> AbstractContextManager[None]:
    """Return a context with PETSc options for matrices of levels that are computed only once."""
    return options_set("", PTAP if comm.size > 1 else {})


def not_converged(ksp: PETSc.KSP, b: PETSc.Vec) -> JointsError:
    """Return the error of an iteration that did not converge (collective)."""
    return JointsError(
        "The iterative linear solver did not converge in "
        f"{ksp.getIterationNumber()} iterations: the residual is {ksp.getResidualNorm():.3g}, the "
        f"load {b.norm():.3g}. Check that every block is restrained by supports, springs or a "
        "closed joint, and that no cell is much longer than it is thick."
    )


class IterativeSolver:
    """Conjugate gradients with smoothed-aggregation multigrid, used like a `DirectSolver`.

    The memory is proportional to the size of the matrix. The coarse levels contain the rigid-body
    modes if these are the near null space of the matrix. Most of the work is products on the finest
    level, which use a copy of the matrix in node blocks.

    Args:
        matrix: Symmetric positive definite matrix, in PETSc's AIJ format.

    Attributes:
        matrix: The matrix.
        iterations: Iterations of the last solve.
    """

    def __init__(self, matrix: PETSc.Mat) -> None:
        """Create the solver; the first solve sets up the preconditioner."""
        self.matrix = matrix
        self._blocked: PETSc.Mat | None = None
        self._ksp = PETSc.KSP().create(matrix.comm)
        self._ksp.setOptionsPrefix("dolfinx_joints_bulk_")
        self._stale = True
        self.iterations = 0

    def refresh(self) -> None:
        """Set the preconditioner up anew at the next solve."""
        self._stale = True

    def solve(
        self, b: PETSc.Vec, x: PETSc.Vec, tolerance: float = limits.MULTIGRID_TOLERANCE
    ) -> bool:
        """Solve A x = b; return True if this call set up the preconditioner (collective).

        Args:
            b: Right-hand side.
            x: Solution.
            tolerance: Residual relative to b.
        """
        renewed = self._set_up()
        self._ksp.setTolerances(rtol=tolerance)
        self._ksp.solve(b, x)
        self.iterations = int(self._ksp.getIterationNumber())
        if self._ksp.getConvergedReason() < 0 and not self._is_solved_to_rounding(b, x):
            raise not_converged(self._ksp, b)
        return renewed

    def solve_block(self, right_hand_sides: Floats) -> Floats:
        """Solve A X = B column by column; see `DirectSolver.solve_block` (collective)."""
        b, x = self.matrix.createVecLeft(), self.matrix.createVecRight()
        solution = np.empty_like(right_hand_sides)
        for column in range(right_hand_sides.shape[1]):
            b.setArray(right_hand_sides[:, column])
            self.solve(b, x)
            solution[:, column] = x.getArray(readonly=True)
        return solution

    @property
    def for_products(self) -> PETSc.Mat:
        """Matrix in node blocks if a node has several unknowns (collective on first use)."""
        if self._blocked is None and self.matrix.getBlockSize() > 1:
            self._blocked = self.matrix.convert("baij", PETSc.Mat())
        return self._blocked or self.matrix

    def _set_up(self) -> bool:
        if not self._stale:
            return False
        self._free_blocked()
        with options_set(self._ksp.getOptionsPrefix(), OPTIONS), made_once(self.matrix.comm):
            self._ksp.setOperators(self.for_products, self.matrix)
            self._ksp.setFromOptions()
            self._ksp.setUp()
        self._stale = False
        return True

    def _is_solved_to_rounding(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Return True if the residual is within the rounding error of the product A x."""
        residual = b.duplicate()
        self.matrix.mult(x, residual)
        residual.axpy(-1.0, b)
        norm = self.matrix.norm(PETSc.NormType.NORM_INFINITY)
        return bool(residual.norm() <= limits.EPSILON * norm * x.norm())

    def _free_blocked(self) -> None:
        if self._blocked is not None:
            self._blocked.destroy()
            self._blocked = None

    def destroy(self) -> None:
        """Free the preconditioner."""
        self._ksp.destroy()
        self._free_blocked()
