# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Direct solver of matrices that are symmetric once some rows change their sign."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.solvers.direct import DirectSolver

Floats = NDArray[np.float64]


class SignedSolver(DirectSolver):
    """L D L^T of D_s A, D_s the signs, instead of L U of A: half the memory and factorization.

    A has a positive symmetric part and a skew one that couples the two kinds of rows, so that D_s A
    is quasi-definite: its factors exist in any order of the unknowns (Vanderbei 1995).

    Args:
        matrix: A.
        signs: 1 or -1 for each row.
    """

    def __init__(self, matrix: PETSc.Mat, signs: PETSc.Vec) -> None:
        """Change the signs in a copy (collective)."""
        signed = matrix.copy()
        signed.diagonalScale(L=signs)
        self._signs = signs
        super().__init__(signed, symmetric=True, mumps=True)

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve A x = b; whether the matrix was factored for it (collective)."""
        right = b.duplicate()
        right.pointwiseMult(b, self._signs)
        return super().solve(right, x)

    def solve_block(self, right: Floats) -> Floats:
        """Solve A X = B for many right-hand sides at once (collective)."""
        return super().solve_block(self._signs.getArray(readonly=True)[:, None] * right)

    def destroy(self) -> None:
        """Free the factor and the copy."""
        super().destroy()
        self._matrix.destroy()
