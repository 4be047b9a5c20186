# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Iterative solver of A + K: multigrid levels of A, with the changing tangent K of the joints.

P^T K P is added to each of the `cut_levels` with prolongation P. It has few entries, only at joint
nodes. Smoothers treat nodes that joints tie as blocks. Levels and smoothers use a symmetric K,
without the effect of normal gaps on shear tractions. In coarse corrections this effect would grow
with the joint stiffness; in the products of GMRES the effect is included and does not grow.
"""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from typing import Any

from petsc4py import PETSc

from dolfinx_joints.joints.operator import JointTangent, TangentMatrix
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.modal_change import ModalChange
from dolfinx_joints.solvers.multigrid.bulk import IterativeSolver, not_converged, options_set
from dolfinx_joints.solvers.multigrid.coincident import BlockInverse, tie, tied_nodes
from dolfinx_joints.solvers.multigrid.cut_levels import CutLevel, cut_levels

# The bounds of the Chebyshev polynomials are estimated for each tangent.
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
    "mg_levels_ksp_chebyshev_esteig": "0,0.1,0,1.1",
    "mg_levels_ksp_chebyshev_esteig_steps": 10,
    "mg_levels_pc_type": "vpbjacobi",
    "mg_coarse_ksp_type": "preonly",
    "mg_coarse_pc_type": "redundant",
}


@dataclass(kw_only=True, eq=False)
class _Parts:
    """A, K and a modal change of A."""

    bulk: PETSc.Mat
    added: PETSc.Mat
    change: ModalChange | None


class _Products:
    """Products with A + K and with a modal change, as a PETSc matrix of type python.

    This object keeps only a weak reference to the parts. On several ranks PETSc frees the object in
    its garbage collection; a matrix that becomes garbage during this collection is never freed.
    """

    def __init__(self, parts: _Parts) -> None:
        """Store a weak reference to the parts, which the caller keeps."""
        self._parts = weakref.ref(parts)

    def mult(self, matrix: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Write the product with x to y (collective)."""
        parts = self._parts()
        assert parts is not None
        parts.bulk.mult(x, y)
        parts.added.multAdd(x, y, y)
        if parts.change is not None:
            parts.change.add_product(x, y)


def _is_stiff(added: PETSc.Mat, matrix: PETSc.Mat) -> bool:
    """Return True if K is stiff compared with A at some node (collective)."""
    share, diagonal = added.getDiagonal(), matrix.getDiagonal()
    share.pointwiseDivide(share, diagonal)
    return bool(share.max()[1] > limits.TIED_STIFFNESS)


class TangentMultigrid:
    """GMRES for A + K, preconditioned by the multigrid levels of A with P^T K P on each level.

    Args:
        bulk: Solver of A.
        added: K; only the sparsity pattern is used.
        product: Object that assembles K.
        change: Change of A by exact modes, which the coarse levels omit.

    Attributes:
        iterations: Iterations of the last solve.
    """

    def __init__(
        self,
        bulk: IterativeSolver,
        added: PETSc.Mat,
        product: TangentMatrix,
        change: ModalChange | None,
    ) -> None:
        """Compute the levels (collective)."""
        self._ksp = PETSc.KSP().create(added.comm)
        self._ksp.setOptionsPrefix("dolfinx_joints_tangent_")
        self._parts = [_Parts(bulk=bulk.for_products, added=added, change=change) for _ in range(2)]
        self._full, self._fine = (
            PETSc.Mat().createPython(added.getSizes(), _Products(parts), comm=added.comm)
            for parts in self._parts
        )
        matrix = bulk.matrix
        tied, count = tied_nodes(matrix, product.joints if _is_stiff(added, matrix) else None)
        ties = tie(tied, count, matrix.getBlockSize(), matrix.comm)
        self._inverse = BlockInverse(matrix, added, ties)
        ties.destroy()
        levels = cut_levels(matrix, tied, count, matrix.getNearNullSpace())
        self._levels: list[_Level] = []
        self._set_up, self._levels_are_new, self.iterations = False, True, 0
        pc = self._ksp.getPC()
        pc.setType("mg")
        pc.setMGLevels(len(levels) + 1)
        for below, level in enumerate(levels, 1):
            pc.setMGInterpolation(len(levels) + 1 - below, level.interpolation)
            joints = product if below == 1 and isinstance(product, JointTangent) else None
            self._levels.append(_Level(level, added, joints))
            added = self._levels[-1].added

    def add(self, added: PETSc.Mat, symmetric: PETSc.Mat) -> None:
        """Update products for a new K, and levels for a new symmetric K (collective)."""
        for parts, products, tangent in zip(
            self._parts, (self._full, self._fine), (added, symmetric), strict=True
        ):
            parts.added = tangent
            products.stateIncrease()
        self._inverse.update(symmetric)
        for level in self._levels:
            symmetric = level.add(symmetric)
        pc, coarse = self._ksp.getPC(), [level.total for level in self._levels]
        self._ksp.setOperators(self._full, self._full)
        pc.getMGSmoother(len(coarse)).setOperators(self._fine, self._inverse.matrix)
        for i, matrix in enumerate(reversed(coarse)):
            pc.getMGSmoother(i).setOperators(matrix, matrix)
        if not self._set_up:
            finest = {f"mg_levels_{len(coarse)}_pc_type": "mat"}
            with options_set(self._ksp.getOptionsPrefix(), OPTIONS | finest):
                self._ksp.setFromOptions()
                self._ksp.setUp()
            self._set_up = True

    def solve(self, b: PETSc.Vec, x: PETSc.Vec, tolerance: float) -> bool:
        """Solve (A + K) x = b; return True in the first solve with new levels (collective).

        Args:
            b: Right-hand side.
            x: Solution.
            tolerance: Residual relative to b.
        """
        self._ksp.setTolerances(rtol=tolerance)
        self._ksp.solve(b, x)
        self.iterations = int(self._ksp.getIterationNumber())
        if self._ksp.getConvergedReason() < 0:
            raise not_converged(self._ksp, b)
        new_levels, self._levels_are_new = self._levels_are_new, False
        return new_levels

    def destroy(self) -> None:
        """Free the levels."""
        self._ksp.destroy()
        self._inverse.destroy()
        for level in self._levels:
            level.destroy()
        self._full.destroy()
        self._fine.destroy()


class _Level:
    """Coarse level with the constant matrix P^T A P and the changing matrix P^T K P.

    Attributes:
        added: P^T K P.
        total: P^T A P + P^T K P.
    """

    def __init__(self, level: CutLevel, finer: PETSc.Mat, joints: JointTangent | None) -> None:
        """Store both matrices on one sparsity pattern (collective)."""
        self._interpolation = level.interpolation
        self._assemble = None if joints is None else joints.coarse(level.interpolation)
        self.added = self._assemble() if self._assemble else finer.PtAP(level.interpolation)
        self._base = self.added.copy()
        self._base.zeroEntries()
        self._base.axpy(1.0, level.matrix, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        self.total = self._base.copy()
        self.total.setVariableBlockSizes(level.blocks.astype(PETSc.IntType))

    def add(self, finer: PETSc.Mat) -> PETSc.Mat:
        """Update the sum from K on the next finer level; return K on this level (collective)."""
        if self._assemble:
            self._assemble()
        else:
            finer.PtAP(self._interpolation, result=self.added)
        self._base.copy(self.total, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self.total.axpy(1.0, self.added, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        return self.added

    def destroy(self) -> None:
        """Free the matrices."""
        for matrix in (self._base, self.added, self.total):
            matrix.destroy()
