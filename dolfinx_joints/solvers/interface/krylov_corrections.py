# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton's corrections d of the joint forces, (I + T S) d = r (24), by PETSc's GMRES.

The symbols are those of `joint_step`. Used in statics, where corrections must be accurate; if S is
not stored, or compressed and not symmetric; and if rigid joints meet, because their sticking points
tie each other. With a controlled load, S also has the change of rank one of (28g).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.kernels import njit
from dolfinx_joints.common.mpi import summed
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.compliance.compliance import Compliance, Rows, Split
from dolfinx_joints.solvers.compliance.row_matrix import RowMatrix
from dolfinx_joints.solvers.interface.corrections import Correction

Floats = NDArray[np.float64]


class KrylovCorrections:
    """Solver of the corrections by products with S.

    Args:
        compliance: S and its scale.
        rigid: True if some joint is rigid.
        comm: Communicator of the ranks.

    Attributes:
        controlled: Vectors of `ControlledMatrix.gaps`, None without a controlled load.
    """

    rough = 0.0  # relative error of S d
    controlled: tuple[Floats, Floats] | None = None

    def __init__(self, compliance: Compliance, rigid: bool, comm: Any) -> None:
        """Set up the solver (collective)."""
        self._split, self._comm = compliance.split, comm
        self._inner, self._finest = compliance.split, 0.0
        if compliance.rough is not None and not isinstance(compliance.split, RowMatrix):
            self._inner, self._finest = compliance.rough, limits.FINEST_COMPRESSED
        self._diagonal = 1.0 + limits.RIGID_DAMPING * rigid
        self._all_rows = np.arange(self._split.local)
        sizes = (self._split.local, self._split.size)
        self._matrix = PETSc.Mat().createPython((sizes, sizes), self, comm=comm)
        self._solver = PETSc.KSP().create(comm)
        self._solver.setOptionsPrefix("dolfinx_joints_corrections_")
        self._solver.setOperators(self._matrix)
        self._solver.setType(PETSc.KSP.Type.GMRES)
        self._solver.setGMRESRestart(limits.MOST_PRODUCTS)
        self._solver.getPC().setType(PETSc.PC.Type.NONE)
        self._solver.setFromOptions()
        self._right_hand_side, self._solution = self._matrix.createVecs()

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Write (I + T S) x to y (collective)."""
        values = x.getArray(readonly=True)
        coupled = self._times(self._inner, values, self._all_rows)
        y.setArray(self._diagonal * values + _times_blocks(self._tangent, coupled))

    def solve(
        self, residual: Floats, tangent: Floats, smallest: float, tolerance: float, *, couples: bool
    ) -> Correction:
        """Solve (I + T S) d = r; see `CompiledCorrections.solve` (collective)."""
        self._tangent = tangent
        self._right_hand_side.setArray(np.where(np.abs(residual) > smallest, residual, 0.0))
        largest_count = min(limits.MOST_PRODUCTS, self._split.size)
        rtol = max(tolerance, self._finest)
        self._solver.setTolerances(rtol=rtol, atol=0.0, divtol=np.inf, max_it=largest_count)
        self._solver.solve(self._right_hand_side, self._solution)
        step = self._solution.getArray().copy()
        return Correction(step, self.product(step), 0.0)

    def product(self, values: Floats) -> Floats:
        """Return S times a vector, shape (m,) (collective)."""
        return self._times(self._split, values, np.flatnonzero(values))

    def _times(self, split: Split, values: Floats, rows: Rows) -> Floats:
        """Return S times a vector; ``split`` is S without the controlled load (collective)."""
        coupled = split.product(values, rows)
        if self.controlled is None:
            return coupled
        column, row = self.controlled
        return coupled - column * summed(self._comm, np.array(row @ values))

    def state_dict(self) -> dict[str, Any]:
        """Return an empty state: corrections do not depend on earlier ones."""
        return {}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Do nothing: there is no state."""

    def free(self) -> None:
        """Free the solver (collective)."""
        for owned in (self._solver, self._matrix, self._right_hand_side, self._solution):
            owned.destroy()


@njit(cache=True)
def _times_blocks(tangent: Floats, values: Floats) -> Floats:
    """Return blocks (n, 3, 3) times a vector (3 n,)."""
    out = np.empty_like(values)
    for i in range(len(tangent)):
        t, a, b, c = tangent[i], values[3 * i], values[3 * i + 1], values[3 * i + 2]
        out[3 * i] = t[0, 0] * a + t[0, 1] * b + t[0, 2] * c
        out[3 * i + 1] = t[1, 0] * a + t[1, 1] * b + t[1, 2] * c
        out[3 * i + 2] = t[2, 0] * a + t[2, 1] * b + t[2, 2] * c
    return out
