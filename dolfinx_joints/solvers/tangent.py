# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tangent matrix of the monolithic solver, factored only if it has changed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.joints.operator import TangentMatrix
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.diagnosis import SINGULAR
from dolfinx_joints.solvers.direct import DirectSolver
from dolfinx_joints.solvers.effective_matrix import EffectiveMatrix
from dolfinx_joints.solvers.modal_change import ChangedSolver, Solver
from dolfinx_joints.solvers.multigrid.bulk import IterativeSolver

if TYPE_CHECKING:
    from dolfinx_joints.solvers.multigrid.tangent import TangentMultigrid


class Tangent:
    """Constrained matrix A + B^T (w D) B; its sparsity pattern and LU solver are kept.

    Args:
        matrix: A.
        product: Assembles B^T (w D) B, D = dt/dg, plus the tangent of nonlinear cells; None without
            joints and nonlinear cells.
        options: PETSc options of the LU solver, without prefix.

    Attributes:
        effective: A.
    """

    def __init__(
        self,
        matrix: EffectiveMatrix,
        product: TangentMatrix | None,
        options: Mapping[str, Any] | None,
    ) -> None:
        """Store the parts; the first update adds them."""
        self.effective = matrix
        self._product, self._options = product, options
        self._sum: _Sum | TangentMultigrid | None = None
        self._last: Floats | None = None

    def update(self, values: Floats) -> _Sum | TangentMultigrid:
        """Return the solver for point tangents D, factored only if D has changed (collective)."""
        assert self._product is not None
        same = self._last is not None and np.array_equal(values, self._last)
        if self._sum is None or not min(self._product.comm.allgather(same)):
            added = self._product.assemble(values)
            self._sum = self._sum or self._sum_with(added)
            if isinstance(self._sum, _Sum):
                self._sum.add(added)
            else:
                self._sum.add(added, self._product.assemble(values, coupled=False))
            self._last = values.copy()
        return self._sum

    def _sum_with(self, added: PETSc.Mat) -> _Sum | TangentMultigrid:
        matrix = self.effective
        if isinstance(matrix.solver, IterativeSolver):
            from dolfinx_joints.solvers.multigrid.tangent import TangentMultigrid

            assert self._product is not None
            return TangentMultigrid(matrix.solver, added, self._product, matrix.change)
        return _Sum(matrix, added, self._options)

    def forget(self) -> None:
        """Factor anew at the next update, even if the point tangents are unchanged."""
        self._last = None

    def destroy(self) -> None:
        """Free matrices and factors."""
        if self._sum is not None:
            self._sum.destroy()
        self.effective.destroy()


def _random_forces(matrix: PETSc.Mat) -> PETSc.Vec:
    """Return random forces that do not depend on the number of ranks (collective)."""
    forces = matrix.createVecRight()
    start, end = forces.getOwnershipRange()
    forces.setArray(np.random.default_rng(1).standard_normal(end)[start:])
    return forces


class _Sum:
    """Sum of a constant and a changing matrix on the union of their sparsity patterns."""

    def __init__(
        self, effective: EffectiveMatrix, added: PETSc.Mat, options: Mapping[str, Any] | None
    ) -> None:
        self._base = added.copy()
        self._base.zeroEntries()
        self._base.axpy(1.0, effective.constrained, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        self._total = self._base.copy()
        self._direct = DirectSolver(self._total, symmetric=False, options=options, name="tangent")
        change = effective.change
        self._solver: Solver = (
            self._direct if change is None else ChangedSolver(self._direct, change)
        )
        self._probe = None if effective.inertia else _random_forces(self._total)

    def add(self, added: PETSc.Mat) -> None:
        """Update the sum; the next solve factors the matrix."""
        self._base.copy(self._total, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self._total.axpy(1.0, added, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        self._direct.refresh()

    def solve(self, b: PETSc.Vec, x: PETSc.Vec, tolerance: float) -> bool:
        """Solve directly, without the tolerance; return True if this call factored (collective).

        Raises:
            JointsError: The static matrix is singular within rounding error.
        """
        factored = self._solver.solve(b, x)
        if factored and self._probe is not None:
            self._check_regular(self._probe, x.duplicate())
        return factored

    def _check_regular(self, forces: PETSc.Vec, displacement: PETSc.Vec) -> None:
        """Check that random forces cause a bounded displacement (collective).

        The factorization of a singular matrix often succeeds, with pivots that are rounding errors.
        """
        self._solver.solve(forces, displacement)
        growth = float(self._total.norm(PETSc.NormType.NORM_INFINITY)) * float(displacement.norm())
        if not growth <= limits.SINGULAR_GROWTH * float(forces.norm()):
            raise JointsError(SINGULAR)

    def destroy(self) -> None:
        """Free matrices and factor."""
        self._direct.destroy()
        self._total.destroy()
        self._base.destroy()
