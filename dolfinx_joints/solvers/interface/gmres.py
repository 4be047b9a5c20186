# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""GMRES of PETSc for the small systems of the joints, which differ from the identity by little."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

Floats = NDArray[np.float64]


class _Products:
    """A matrix given by its product with a vector, as PETSc calls it."""

    apply: Callable[[Floats], Floats] | None = None
    count = 0

    def mult(self, matrix: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Multiply: y = A x."""
        assert self.apply is not None
        self.count += 1
        y.setArray(self.apply(x.getArray(readonly=True)))


class Gmres:
    """GMRES without restarts (Saad and Schultz 1986), the same on every rank.

    PETSc's objects are kept as long as systems are of one size.
    """

    def __init__(self) -> None:
        """Nothing is made yet."""
        self._products, self._size = _Products(), -1

    def solve(
        self, apply: Callable[[Floats], Floats], right: Floats, *, tolerance: float, most: int
    ) -> tuple[Floats, int]:
        """Solve A x = b from x = 0.

        Args:
            apply: A times a vector.
            right: b, shape (n,).
            tolerance: Largest residual accepted, relative to b in the 2-norm.
            most: Products spent at most; the best solution found is then returned.

        Returns:
            x, and the number of products.
        """
        if not right.any():
            return right.copy(), 0
        if len(right) != self._size:
            self._make(len(right))
        most = min(most, self._size)
        self._ksp.setGMRESRestart(most)
        self._ksp.setTolerances(rtol=tolerance, atol=0.0, divtol=PETSc.INFINITY, max_it=most)
        self._right.setArray(right)
        self._products.apply, self._products.count = apply, 0
        self._ksp.solve(self._right, self._solution)
        self._products.apply = None  # it may hold much memory
        if self._ksp.getConvergedReason() == PETSc.KSP.ConvergedReason.DIVERGED_NANORINF:
            self._solution.set(np.nan)
        return self._solution.getArray().copy(), self._products.count

    def _make(self, size: int) -> None:
        self._size, comm = size, PETSc.COMM_SELF
        matrix = PETSc.Mat().createPython((size, size), self._products, comm=comm)
        matrix.setUp()
        self._solution, self._right = matrix.createVecs()
        self._ksp = PETSc.KSP().create(comm)
        self._ksp.setType(PETSc.KSP.Type.GMRES)
        self._ksp.getPC().setType(PETSc.PC.Type.NONE)
        self._ksp.setOperators(matrix)
