# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Products and back-substitutions with the whole body, for columns of which ranks own rows."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.linalg import cholesky, lapack, solve_triangular

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.mpi import summed
from dolfinx_joints.model.system import MatrixSystem, as_aij
from dolfinx_joints.solvers.direct import BLOCK, DirectSolver, multiplied
from dolfinx_joints.solvers.interface.compliance import Compliance
from dolfinx_joints.solvers.interface.condensed import Condensed
from dolfinx_joints.solvers.interface.row_matrix import Parts

Floats = NDArray[np.float64]

# Part of a joint unknown's compliance below which others hold it.
DEPENDENT = 1e-9


class WholeBody:
    """M, A and B of a body whose A is factored.

    Args:
        system: The system, with joints.
        condensed: A and the compliance at the joints.

    Attributes:
        mass: M.
        matrix: A.
        live: Numbers of the joint unknowns that can move and do not depend on each other, as they
            do where there are more points than nodes.
        root: Lower triangle R, R R^T = B A^-1 B^T over these.
        rest: Numbers of those that depend on them.
        rest_root: Their rows of R, shape (rest, live).
        comm: Communicator of the ranks.

    Raises:
        JointsError: A is not factored.
    """

    def __init__(self, system: MatrixSystem, condensed: Condensed) -> None:
        """Factor the compliance (collective)."""
        self._bulk, self._fixed = condensed.matrix, system.constrained
        if not isinstance(self._bulk.solver, DirectSolver):
            raise JointsError(
                "reduced needs a factor of the body, for which there is not memory enough; run "
                "without it."
            )
        self.mass, self.matrix = as_aij(system.mass), self._bulk.full
        self.comm: Any = system.mass.comm.tompi4py()
        assert system.contact is not None
        self.jump = system.contact.operator.matrix
        self._pushed = self.jump.transpose(PETSc.Mat())
        forces = _unit_forces(condensed.compliance, self.comm)
        self.live = _independent(forces)
        self.root: Floats = cholesky(forces[np.ix_(self.live, self.live)], lower=True)
        self.rest = np.setdiff1d(np.flatnonzero(forces.diagonal() > 0.0), self.live)
        right = forces[np.ix_(self.live, self.rest)]
        self.rest_root: Floats = solve_triangular(self.root, right, lower=True).T

    def vector(self, rows: Floats) -> PETSc.Vec:
        """A vector from the rank's rows."""
        vector = self.mass.createVecRight()
        vector.setArray(rows)
        return vector

    def gaps(self, columns: Floats) -> Floats:
        """Gaps of the unknowns ``live`` (collective)."""
        mine = multiplied(self.jump, columns)
        every = mine if self.comm.size == 1 else np.concatenate(self.comm.allgather(mine))
        found: Floats = every[self.live]
        return found

    def of_forces(self, forces: Floats) -> Floats:
        """Nodal forces of forces on the unknowns ``live`` (collective)."""
        every = np.zeros((self.jump.getSize()[0], forces.shape[1]))
        every[self.live] = forces
        rows = every[slice(*self.jump.getOwnershipRange())]
        return self.unconstrained(multiplied(self._pushed, rows))

    def solved(self, right: Floats) -> Floats:
        """A^-1 of columns (collective)."""
        found = np.empty_like(right, order="F")
        for first in range(0, right.shape[1], BLOCK):
            part = slice(first, first + BLOCK)
            found[:, part] = self._bulk.solve_block(right[:, part])
        return self.unconstrained(found)

    def unconstrained(self, columns: Floats) -> Floats:
        """The columns, made zero at constrained dofs."""
        columns = columns if columns.flags.writeable else columns.copy()
        columns[self._fixed] = 0.0
        return columns

    def sum(self, parts: Floats) -> Floats:
        """Sum over the ranks, the same on each (collective)."""
        return summed(self.comm, parts)


def _unit_forces(compliance: Compliance, comm: Any) -> Floats:
    """B A^-1 B^T from its scaled form, on every rank (collective)."""
    split = compliance.split.whole()
    assert split is not None
    mine = np.where(compliance.dead.ravel(), 0.0, compliance.scale)
    scale = Parts(len(mine), comm).all_of(mine)
    forces = split * scale
    forces[np.diag_indices(len(forces))] += scale
    forces *= scale[:, None]
    return forces


def _independent(forces: Floats) -> NDArray[np.int64]:
    """Numbers of unknowns whose gaps do not depend on those of others, ascending."""
    live = np.flatnonzero(forces.diagonal() > 0.0)
    scale = forces.diagonal()[live] ** -0.5
    scaled = scale[:, None] * forces[np.ix_(live, live)] * scale
    _, order, rank, _ = lapack.dpstrf(np.asfortranarray(scaled), lower=1, tol=DEPENDENT)
    return np.sort(live[order[:rank] - 1])


def as_columns(vectors: Iterable[PETSc.Vec], *, like: PETSc.Vec) -> Floats:
    """Owned rows of vectors, shape (local dofs, k), of the size of another if there is none."""
    columns = [vector.array_r for vector in vectors]
    return np.column_stack(columns) if columns else np.zeros((like.getLocalSize(), 0))
