# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solver of a matrix that differs from a factored one in a few modes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.mpi import summed


class Solver(Protocol):
    """Direct or iterative solver of A x = b."""

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve A x = b; return True if this call factored the matrix (collective)."""

    def solve_block(self, right_hand_sides: Floats) -> Floats:
        """Return the owned rows of X with A X = B (collective)."""


class ModalChange:
    """Change Psi delta Psi^T of a matrix, with Psi = M Phi, zero at constrained dofs.

    Args:
        columns: Owned rows of Psi, shape (local dofs, modes).
        delta: Diagonal, shape (modes,), [N/m].
        of_supports: Function of x: contribution of moving supports to delta Psi^T x.
        comm: Communicator of the ranks.
    """

    def __init__(
        self, columns: Floats, delta: Floats, of_supports: Callable[[PETSc.Vec], Floats], comm: Any
    ) -> None:
        self.columns, self.delta, self._comm = columns, delta, comm
        self._of_supports = of_supports

    def joined_with(self, other: ModalChange) -> ModalChange:
        """Return the sum of both changes."""
        return ModalChange(
            np.hstack([self.columns, other.columns]),
            np.append(self.delta, other.delta),
            lambda x: np.append(self._of_supports(x), other._of_supports(x)),
            self._comm,
        )

    def amounts(self, values: Floats) -> Floats:
        """Return Psi^T times the owned rows of values (collective)."""
        return summed(self._comm, self.columns.T @ values)

    def add_product(self, x: PETSc.Vec, to: PETSc.Vec) -> None:
        """Add the change times x to the unconstrained dofs of a vector (collective)."""
        amounts = self.delta * self.amounts(x.array_r) + self._of_supports(x)
        to.getArray()[:] += self.columns @ amounts


class ChangedSolver:
    """Solver with A + Psi delta Psi^T that uses a solver with A, by the Woodbury formula (34b).

    For each factor of A, Z = A^-1 Psi costs one back-substitution per mode. With y = A^-1 b and
    W = delta (I + Psi^T Z delta)^-1 the solution is y - Z W Psi^T y.

    Args:
        original: Solver of A.
        change: Psi and delta.
    """

    def __init__(self, original: Solver, change: ModalChange) -> None:
        """Store the parts; Z is computed at the first solve."""
        self._original, self._change = original, change
        self._parts: tuple[Floats, Floats] | None = None

    def solve(self, b: PETSc.Vec, x: PETSc.Vec, **options: float) -> bool:
        """Solve for x; return True if this call factored A (collective)."""
        factored = bool(self._original.solve(b, x, **options))
        if factored:
            self._parts = None
        correction = self._correction(x.array_r)
        x.getArray()[:] -= correction
        return factored

    def solve_block(self, right_hand_sides: Floats) -> Floats:
        """Return the owned rows of the solutions for several right-hand sides (collective)."""
        solutions = self._original.solve_block(right_hand_sides)
        return solutions - self._correction(solutions)

    def _correction(self, y: Floats) -> Floats:
        """Return the Woodbury correction, to be subtracted from y (collective)."""
        responses, small = self.parts()
        correction: Floats = responses @ (small @ self._change.amounts(y))
        return correction

    def parts(self) -> tuple[Floats, Floats]:
        """Return Z and W; the inverse of the changed matrix is A^-1 - Z W Z^T (collective)."""
        change = self._change
        if self._parts is None:
            responses = np.asfortranarray(self._original.solve_block(change.columns))
            small = np.eye(len(change.delta)) + change.amounts(responses) * change.delta
            self._parts = responses, change.delta[:, None] * np.linalg.inv(small)
        return self._parts
