# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Iterative solver of symmetric positive definite matrices too large for a factor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.solvers import limits

Floats = NDArray[np.float64]

OPTIONS: dict[str, Any] = {
    "ksp_type": "cg",
    "ksp_norm_type": "unpreconditioned",
    "ksp_rtol": limits.MULTIGRID_TOLERANCE,
    "ksp_max_it": 500,
    "pc_type": "gamg",
    "pc_mg_cycle_type": "w",  # on larger bodies V-cycles take more iterations
    "pc_use_amat": True,
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_pc_type": "pbjacobi",
}

# P^T A P on several ranks without copies of A P and P, which would double what levels take. It is
# slower where products are made again and again.
PTAP = {"matptap_via": "allatonce"}


@contextmanager
def options_set(prefix: str, options: Mapping[str, Any]) -> Iterator[None]:
    """Set PETSc options under a prefix for a while, except those that the user has set."""
    database = PETSc.Options()
    own = [key for key in options if not database.hasName(prefix + key)]
    for key in own:
        database.setValue(prefix + key, options[key])
    try:
        yield
    finally:
        for key in own:
            database.delValue(prefix + key)


def made_once(comm: PETSc.Comm) -> AbstractContextManager[None]:
    """PETSc options for matrices of levels that are not made again."""
    return options_set("", PTAP if comm.size > 1 else {})


def gave_up(ksp: PETSc.KSP, b: PETSc.Vec) -> JointsError:
    """Error for an iteration that did not converge (collective)."""
    return JointsError(
        f"The iterative linear solver gave up after {ksp.getIterationNumber()} iterations, its "
        f"residual {ksp.getResidualNorm():.3g} against a load of {b.norm():.3g}: is every block "
        "restrained by supports, springs or a closed joint, and no cell much longer than thick?"
    )


class IterativeSolver:
    """Conjugate gradients with smoothed-aggregation multigrid, in the place of a `DirectSolver`.

    Needs memory in proportion to the matrix. The rigid-body modes, the matrix's near null space,
    are taken into the coarse levels where the matrix has them. Products on the finest level, most
    of the work, are made with a copy in blocks of the unknowns of a node.

    Args:
        matrix: Symmetric positive definite matrix, in PETSc's AIJ format.

    Attributes:
        matrix: The matrix.
        iterations: Iterations of the last solve.
    """

    def __init__(self, matrix: PETSc.Mat) -> None:
        """Create the solver; it is set up at the first solve."""
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
        """Solve A x = b; whether the preconditioner was set up for it (collective).

        Args:
            b: Right-hand side.
            x: Solution.
            tolerance: Residual relative to b.
        """
        renewed = self._set_up()
        self._ksp.setTolerances(rtol=tolerance)
        self._ksp.solve(b, x)
        self.iterations = int(self._ksp.getIterationNumber())
        if self._ksp.getConvergedReason() < 0 and not self._as_rounding_lets(b, x):
            raise gave_up(self._ksp, b)
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
        """The matrix, in blocks where it has any (collective when first asked for)."""
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

    def _as_rounding_lets(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Whether the residual is what rounding of the product leaves."""
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
