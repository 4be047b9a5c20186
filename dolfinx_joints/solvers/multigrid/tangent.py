# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Iterative solver of A + K, A solved by multigrid and K the tangent of joints, which changes.

The levels are those of A: aggregates do not reach across joints, so that open joints are as well
represented as closed ones. To each level its part of the tangent is added, P^T K P, which is small:
only nodes of the joints are in it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from petsc4py import PETSc

from dolfinx_joints.joints.operator import JointTangent
from dolfinx_joints.solvers.modal_change import ModalChange
from dolfinx_joints.solvers.multigrid.bulk import IterativeSolver, gave_up, options_set

# The bounds of Chebyshev's polynomials are estimated anew for each tangent: in fewer products than
# PETSc makes, with more to spare.
OPTIONS: dict[str, Any] = {
    "ksp_type": "gmres",
    "ksp_pc_side": "right",
    "ksp_gmres_restart": 50,
    "ksp_max_it": 500,
    "pc_type": "mg",
    "pc_mg_cycle_type": "w",
    "pc_use_amat": True,
    "pc_mg_galerkin": "none",
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_ksp_chebyshev_esteig": "0,0.1,0,1.2",
    "mg_levels_ksp_chebyshev_esteig_steps": 5,
    "mg_levels_pc_type": "jacobi",
    "mg_coarse_ksp_type": "preonly",
    "mg_coarse_pc_type": "redundant",
}


class _Products:
    """A + K by their products, and what a modal change adds, as a PETSc matrix of type python."""

    def __init__(self, bulk: PETSc.Mat, added: PETSc.Mat, change: ModalChange | None) -> None:
        """Keep the parts."""
        self._bulk, self._added, self._change = bulk, added, change
        self._diagonal = added.createVecLeft()

    def mult(self, matrix: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Multiply (collective)."""
        self._bulk.mult(x, y)
        self._added.multAdd(x, y, y)
        if self._change is not None:
            self._change.add_product(x, y)

    def getDiagonal(self, matrix: PETSc.Mat, out: PETSc.Vec) -> None:
        """Give the diagonal of A + K."""
        self._bulk.getDiagonal(out)
        self._added.getDiagonal(self._diagonal)
        out.axpy(1.0, self._diagonal)


class TangentMultigrid:
    """GMRES on A + K with the multigrid of A, each level with its part of K.

    Args:
        bulk: Solver of A.
        added: K, by its pattern.
        change: What exact modes add to A, not seen by the coarse levels.
        joints: What made K, where that are joints alone.

    Attributes:
        iterations: Iterations of the last solve.
    """

    _made = 0

    def __init__(
        self,
        bulk: IterativeSolver,
        added: PETSc.Mat,
        change: ModalChange | None,
        joints: JointTangent | None = None,
    ) -> None:
        """Take over the levels of A (collective)."""
        TangentMultigrid._made += 1
        self._ksp = PETSc.KSP().create(added.comm)
        self._ksp.setOptionsPrefix(f"dolfinx_joints_gmres_{TangentMultigrid._made}_")
        fine, levels = bulk.levels()
        self._fine = PETSc.Mat().createPython(
            added.getSizes(), _Products(fine, added, change), comm=added.comm
        )
        self._fine.setUp()
        self._levels: list[_Level] = []
        self._set_up, self._made_now, self.iterations = False, True, 0
        pc = self._ksp.getPC()
        pc.setType("mg")
        pc.setMGLevels(len(levels) + 1)
        for below, (interpolation, matrix) in enumerate(levels, 1):
            pc.setMGInterpolation(len(levels) + 1 - below, interpolation)
            made = joints.coarse(interpolation) if joints and below == 1 else None
            self._levels.append(_Level(interpolation, matrix, added, made))
            added = self._levels[-1].added

    def add(self, added: PETSc.Mat) -> None:
        """Renew the levels for the values of K (collective)."""
        for level in self._levels:
            added = level.add(added)
        self._fine.stateIncrease()
        pc, matrices = self._ksp.getPC(), [self._fine, *(level.total for level in self._levels)]
        self._ksp.setOperators(self._fine, self._fine)
        for i, matrix in enumerate(reversed(matrices)):
            pc.getMGSmoother(i).setOperators(matrix, matrix)
        if not self._set_up:
            with options_set(self._ksp.getOptionsPrefix(), OPTIONS):
                self._ksp.setFromOptions()
                self._ksp.setUp()
            self._set_up = True

    def solve(self, b: PETSc.Vec, x: PETSc.Vec, tolerance: float) -> bool:
        """Solve (A + K) x = b; whether levels were made for it (collective).

        Args:
            b: Right-hand side.
            x: Solution.
            tolerance: Residual relative to b.
        """
        self._ksp.setTolerances(rtol=tolerance)
        self._ksp.solve(b, x)
        self.iterations = int(self._ksp.getIterationNumber())
        if self._ksp.getConvergedReason() < 0:
            raise gave_up(self._ksp, b)
        made, self._made_now = self._made_now, False
        return made

    def destroy(self) -> None:
        """Free the levels."""
        self._ksp.destroy()
        for level in self._levels:
            level.destroy()
        self._fine.destroy()


class _Level:
    """A coarse level: P^T A P, which stays, and P^T K P.

    Attributes:
        added: P^T K P.
        total: Their sum.
    """

    def __init__(
        self,
        interpolation: PETSc.Mat,
        matrix: PETSc.Mat,
        finer: PETSc.Mat,
        made: Callable[[], PETSc.Mat] | None,
    ) -> None:
        """Put both on one pattern (collective)."""
        self._interpolation, self._made = interpolation, made
        self.added = made() if made else finer.PtAP(interpolation)
        self._base = self.added.copy()
        self._base.zeroEntries()
        self._base.axpy(1.0, matrix, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        self.total = self._base.copy()

    def add(self, finer: PETSc.Mat) -> PETSc.Mat:
        """Renew the sum from K on the next finer level; K on this one (collective)."""
        if self._made:
            self._made()
        else:
            finer.PtAP(self._interpolation, result=self.added)
        self._base.copy(self.total, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self.total.axpy(1.0, self.added, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        return self.added

    def destroy(self) -> None:
        """Free the matrices."""
        for matrix in (self._base, self.added, self.total):
            matrix.destroy()
