# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cholesky factor in node blocks, for one right-hand side at a time.

PETSc's factor of a symmetric block matrix (SBAIJ) reads one index for the four or nine entries of a
block and has no dense panels. If the columns of the factor are short, PETSc solves up to twice as
fast as CHOLMOD.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.solvers import limits

# Block sizes (dofs per node) for which PETSc has unrolled loops.
BLOCKS = (2, 3)


class NodeBlocks:
    """Cholesky factor in node blocks.

    Args:
        matrix: Symmetric positive definite AIJ matrix on one rank; block size: dofs per node.
    """

    def __init__(self, matrix: PETSc.Mat) -> None:
        """Order the nodes by minimum degree and factor the matrix."""
        blocks = matrix.convert("baij", PETSc.Mat())
        nodes, _ = blocks.getOrdering("amd")
        size = matrix.getBlockSize()
        dofs = PETSc.IS().createBlock(size, nodes.getIndices(), comm=matrix.comm)
        ordered = matrix.permute(dofs, dofs)
        ordered.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        half = ordered.convert("sbaij", PETSc.Mat())
        self._pc = PETSc.PC().create(matrix.comm)
        self._pc.setOptionsPrefix("dolfinx_joints_node_blocks_")
        self._pc.setOperators(half)
        self._pc.setType("cholesky")
        self._pc.setFactorSolverType("petsc")
        self._pc.setFactorOrdering("natural")
        self._pc.setUp()
        self._pc.viewFromOptions("-pc_view")
        self._factor = self._pc.getFactorMatrix()
        self._dofs = dofs.getIndices().astype(np.intp)
        self._places = np.argsort(self._dofs)
        self._right_hand_side, self._half, self._solution = (half.createVecLeft() for _ in range(3))
        for temporary in (blocks, nodes, dofs, ordered, half):
            temporary.destroy()

    @staticmethod
    def serves(matrix: PETSc.Mat, entries: float) -> bool:
        """Return True if node blocks are faster than a supernodal factor with so many entries."""
        size = matrix.getSize()[0]
        short = entries <= limits.NODE_BLOCK_COLUMN * size and size <= limits.NODE_BLOCK_ROWS
        return short and matrix.getBlockSize() in BLOCKS

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve A x = b."""
        self._solve(b.getArray(readonly=True), x.getArray())

    def solve_block(self, right_hand_sides: Floats, solutions: Floats) -> None:
        """Solve A X = B, shape (rows, columns), one column after the other."""
        for i in range(right_hand_sides.shape[1]):
            self._solve(right_hand_sides[:, i], solutions[:, i])

    def _solve(self, b: Floats, x: Floats) -> None:
        self._right_hand_side.setArray(b[self._dofs])
        # Separate forward and backward substitutions take two thirds of the time of PETSc's solve.
        self._factor.solveForward(self._right_hand_side, self._half)
        self._factor.solveBackward(self._half, self._solution)
        x[:] = self._solution.getArray(readonly=True)[self._places]

    def destroy(self) -> None:
        """Free the factor."""
        for owned in (self._factor, self._pc, self._right_hand_side, self._half, self._solution):
            owned.destroy()
