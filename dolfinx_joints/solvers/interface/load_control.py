# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static step with an unknown load factor and a prescribed displacement c.x = q (28f).

    K x + B^T (w t) = b + lambda f,   c.x = q

K is the stiffness matrix, with springs if a block is unsupported, and B the gap operator, both with
constraints. For each K, z = K^-1 f and y = K^-1 c are solved once. The factor lambda is eliminated:

    x = x' + z (q - c.x') / (c.z)   with   x' = K^-1 (b - B^T (w t)),
    G' = G - (B z) (B y)^T / (c.z).                                                          (28g)

G' replaces the compliance G of the joints. Its own compliances c of the points stay those of G.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.compliance.compliance import Compliance
from dolfinx_joints.solvers.effective_matrix import EffectiveMatrix

Floats = NDArray[np.float64]


class LoadControl:
    """Responses z and y of a body to its controlled load and to its controlled direction.

    Args:
        matrix: K, symmetric.
        operator: B with zero columns at constrained dofs.
        load: f [N].
        direction: c, zero at constrained dofs.
        unconstrained: 1 at unconstrained dofs, 0 at constrained dofs.

    Raises:
        JointsError: Without joint forces, the load does not change c.x.
    """

    def __init__(
        self,
        matrix: EffectiveMatrix,
        operator: PETSc.Mat,
        load: PETSc.Vec,
        direction: PETSc.Vec,
        unconstrained: PETSc.Vec,
    ) -> None:
        """Solve for z and y (collective)."""
        self._operator, self._direction = operator, direction
        self._of_load, self._of_direction = (load.duplicate() for _ in range(2))
        forces = load.duplicate()
        for force, response in ((load, self._of_load), (direction, self._of_direction)):
            forces.pointwiseMult(force, unconstrained)
            matrix.solve(forces, response)
            matrix.refine(forces, response, unconstrained)
        self._change = float(direction.dot(self._of_load))
        works = float(load.dot(self._of_load)) * float(direction.dot(self._of_direction))
        if not abs(self._change) > limits.CONTROLLABLE * abs(works) ** 0.5:
            raise JointsError(
                "The controlled loads do not change the controlled quantity if the joints are "
                "open. Control a quantity that these loads change in the body without joints."
            )

    def value(self, x: PETSc.Vec) -> float:
        """Return c.x [m] (collective)."""
        return float(self._direction.dot(x))

    def impose(self, x: PETSc.Vec, value: float) -> None:
        """Change x along z so that c.x has a value [m] (collective)."""
        x.axpy((value - self.value(x)) / self._change, self._of_load)

    def scaled(self, compliance: Compliance) -> tuple[Floats, Floats]:
        """Return B z and B y / (c.z), scaled as S in (22), shape (m,) each (collective)."""
        points = self._operator.createVecLeft()
        columns = []
        for response in (self._of_load, self._of_direction):
            self._operator.mult(response, points)
            gaps = points.getArray(readonly=True) / compliance.scale
            columns.append(np.where(compliance.dead.ravel(), 0.0, gaps))
        return columns[0], columns[1] / self._change

