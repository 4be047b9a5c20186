# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The system of a body that moves in few shapes, for the solvers and schemes of any system."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.joints.operator import GapOperator
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.interface.compliance import Compliance
from dolfinx_joints.solvers.interface.condensed import Condensed
from dolfinx_joints.solvers.reduced.basis import ReducedBasis

Floats = NDArray[np.float64]


def reduced_system(system: MatrixSystem, condensed: Condensed, basis: ReducedBasis) -> MatrixSystem:
    """M, K and C, loads, and joints with the same points, of the coordinates (collective).

    Args:
        system: The system of the whole body.
        condensed: The matrix of the steps and the joints' compliance.
        basis: Shapes.
    """
    full = system.contact
    assert full is not None
    given, mass = full.operator, _square(basis, basis.mass)
    operator = GapOperator(_gaps(basis, given), given.areas, given.joint, given.names)
    return replace(
        system,
        mass=mass,
        stiffness=_square(basis, basis.stiffness),
        contact=full.on(operator),
        patterns=[
            (basis.coordinate_vector(basis.loads[:, i]), factor)
            for i, (_, factor) in enumerate(system.patterns)
        ],
        constrained=np.empty(0, dtype=np.int64),
        components=1,
        shared=_Known(condensed),
    )


def _square(basis: ReducedBasis, whole: Floats) -> PETSc.Mat:
    """A matrix of coordinates (collective)."""
    like = basis.coordinate_vector(whole[:, 0])
    rows, size = slice(*like.getOwnershipRange()), (PETSc.DECIDE, basis.size)
    part = np.asfortranarray(whole[rows])
    matrix = PETSc.Mat().createDense((size, size), array=part, comm=like.comm)
    matrix.assemble()
    return matrix


def _gaps(basis: ReducedBasis, given: GapOperator) -> PETSc.Mat:
    """B V = [R, 0] (collective)."""
    first, last = given.matrix.getOwnershipRange()
    body = basis.body
    rows = {int(row): body.root[i, : i + 1] for i, row in enumerate(body.live)}
    rows |= {int(row): body.rest_root[i, :] for i, row in enumerate(body.rest)}
    none: Floats = np.empty(0)
    mine = [rows.get(row, none) for row in range(first, last)]
    counts = [len(row) for row in mine]
    columns = [np.arange(count) for count in counts]
    matrix = PETSc.Mat().createAIJ(
        ((last - first, None), (PETSc.DECIDE, basis.size)),
        csr=(
            np.cumsum([0, *counts], dtype=PETSc.IntType),
            np.concatenate([none, *columns]).astype(PETSc.IntType),
            np.concatenate([none, *mine]),
        ),
        comm=given.matrix.comm,
    )
    matrix.assemble()
    return matrix


class _Known:
    """In the place of a `SharedBulk`: A is 1, and the joints' compliance that of the whole body."""

    rounds = None

    def __init__(self, condensed: Condensed) -> None:
        """Keep what is known."""
        self._condensed = condensed
        self.lowest_modes: dict[int, Any] = {}

    def matrix(self, key: Hashable, make: Callable[[], Any]) -> _Identity:
        """A in the basis."""
        return _Identity()

    def halves(self, make: Callable[[], Any]) -> None:
        """None: its M and K are dense."""

    def compliance(self, key: Hashable, make: Callable[[], Compliance]) -> Compliance:
        """That of the whole body."""
        return self._condensed.compliance


class _Identity:
    """What the joints' iteration asks of an `EffectiveMatrix`, of A = 1."""

    rounds = None

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """X = b; nothing is factored."""
        b.copy(x)
        return False

    def solve_linear(self, b: PETSc.Vec, x: PETSc.Vec, unconstrained: PETSc.Vec) -> bool:
        """The same."""
        return self.solve(b, x)

    def destroy(self) -> None:
        """Nothing to free."""
