# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static step with an unknown load factor and a prescribed displacement c.x = q.

    K x + B^T (w t) = b + lambda f,   c.x = q                                                (28f)

K is the stiffness matrix, with springs if a block is unsupported, and B the gap operator, both with
constraints. With z = K^-1 f and y = K^-1 c, which are solved once, the factor lambda is eliminated:

    x = x' + z (q - c.x') / (c.z)   with   x' = K^-1 (b - B^T (w t)),
    G' = G - (B z) (B y)^T / (c.z).                                                          (28g)

G' replaces the compliance G of the joints. The own compliances of the points stay those of G.
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


class ControlledMatrix:
    """Matrix K whose solutions x have a prescribed c.x; its methods are those of K.

    Args:
        matrix: K, symmetric.
        load: f [N], zero at constrained dofs.
        direction: c, zero at constrained dofs.
        unconstrained: 1 at unconstrained dofs, 0 at constrained dofs.

    Raises:
        JointsError: Without joint forces, the load does not change c.x.
    """

    def __init__(
        self,
        matrix: EffectiveMatrix,
        load: PETSc.Vec,
        direction: PETSc.Vec,
        unconstrained: PETSc.Vec,
    ) -> None:
        """Solve for z and y (collective)."""
        self._matrix, self._load, self._direction = matrix, load, direction
        self._responses = []
        for force in (load, direction):
            response = load.duplicate()
            matrix.solve(force, response)
            matrix.refine(force, response, unconstrained)
            self._responses.append(response)
        self._change = float(direction.dot(self._responses[0]))
        works = float(load.dot(self._responses[0])) * float(direction.dot(self._responses[1]))
        if not abs(self._change) > limits.CONTROLLABLE * abs(works) ** 0.5:
            raise JointsError(
                "Without joint forces, the loads do not change the controlled quantity. Control a "
                "quantity that these loads change."
            )

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve for x with c.x = 0, see `EffectiveMatrix.solve` (collective)."""
        self._matrix.solve(b, x)
        self._impose(x, 0.0)

    def solve_linear(self, b: PETSc.Vec, x: PETSc.Vec, unconstrained: PETSc.Vec) -> None:
        """Solve for x with the given c.x, see `EffectiveMatrix.solve_linear` (collective)."""
        value = float(self._direction.dot(x))
        self._matrix.solve_linear(b, x, unconstrained)
        self._impose(x, value)

    def refine(self, b: PETSc.Vec, x: PETSc.Vec, unconstrained: PETSc.Vec) -> PETSc.Vec:
        """Refine x without changing c.x, see `EffectiveMatrix.refine` (collective)."""
        value, forces = float(self._direction.dot(x)), b.duplicate()
        self._matrix.full.mult(x, forces)
        forces.axpy(-1.0, b)
        # Balance x with its present factor first: refinement then only removes rounding errors.
        forces.waxpy(float(forces.dot(self._load)) / self._load.norm() ** 2, self._load, b)
        change = self._matrix.refine(forces, x, unconstrained)
        self._impose(change, 0.0)
        self._impose(x, value)
        return change

    def _impose(self, x: PETSc.Vec, value: float) -> None:
        """Change x along z so that c.x has a value [m] (collective)."""
        x.axpy((value - float(self._direction.dot(x))) / self._change, self._responses[0])

    def gaps(self, operator: PETSc.Mat, compliance: Compliance) -> tuple[Floats, Floats]:
        """Return B z and B y / (c.z), both scaled as S in (22), shape (m,) (collective)."""
        points, gaps = operator.createVecLeft(), []
        for response in self._responses:
            operator.mult(response, points)
            scaled = points.getArray(readonly=True) / compliance.scale
            gaps.append(np.where(compliance.dead.ravel(), 0.0, scaled))
        return gaps[0], gaps[1] / self._change
