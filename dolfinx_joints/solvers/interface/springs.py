# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Artificial springs across the joints, which stabilise unsupported blocks in statics.

Their forces are subtracted from the result: (K + B^T w s B) x + B^T w t' = b is solved (27), with
t' = t - s (g - g0). K is the stiffness matrix, B the gap operator, w the areas, x the displacement,
b the load, t the tractions of the laws and g the gaps, g0 at the start of the increment. The spring
stiffness s is sigma in docs/theory, which has the equations (27) and (28). A point has the
compliance c, springs included, so g = h - c t' with the gap h without its own traction. The law is
evaluated without the springs, on c' and h' (28):

    g = h' - c' t,   c' = c / (1 - c s),   h' = (h - c s g0) / (1 - c s).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.joints.operator import diagonal_compliance
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers import limits


class JointSprings:
    """Springs as stiff as the joints and the adjacent elements in series.

    Args:
        system: The system.

    Attributes:
        stiffness: s of each local point, normal and tangential, shape (n, 2), [Pa/m].
        matrix: B^T w s B [N/m].
        largest_compliance: Upper limit of c at each local point, shape (n, 2), [m/Pa].
    """

    def __init__(self, system: MatrixSystem) -> None:
        """Estimate the elements' stiffness from the diagonal of K (collective)."""
        assert system.contact is not None
        operator = system.contact.operator
        compliance = diagonal_compliance(operator.matrix, system.stiffness.getDiagonal())
        elements = operator.areas[:, None] * compliance.reshape(-1, 3).max(axis=1)[:, None]
        joint = system.contact.firm_stiffness()
        joint = np.where(elements > 0.0, joint, 0.0)  # a joint that ends inside the body
        with np.errstate(divide="ignore"):  # zero stiffness gives no spring
            self.stiffness: NDArray[Any] = 1.0 / (elements + 1.0 / joint)
        rows, work = operator.matrix.createVecLeft(), operator.matrix.copy()
        rows.setArray((operator.areas[:, None] * self._in_three_directions(self.stiffness)).ravel())
        work.diagonalScale(L=rows)
        self.matrix: PETSc.Mat = operator.matrix.transposeMatMult(work)
        with np.errstate(divide="ignore"):
            self.largest_compliance: Floats = limits.SPRING_COMPLIANCE / self.stiffness

    @staticmethod
    def _in_three_directions(values: Floats) -> Floats:
        """Return normal and tangential values, shape (n, 2), for three directions, shape (n, 3)."""
        return np.repeat(values, (1, 2), axis=1)

    def compliance_without_springs(self, compliance: Floats) -> Floats:
        """Return the compliance c' of the law, shape (n, 2), [m/Pa].

        Args:
            compliance: c, normal and tangential, shape (n, 2), [m/Pa].
        """
        return compliance / (1.0 - self.stiffness * compliance)

    def trial_gap_without_springs(
        self, trial_gap: Floats, compliance: Floats, before: Floats
    ) -> Floats:
        """Return the trial gap h' of the law, shape (n, 3), [m].

        Args:
            trial_gap: h, shape (n, 3), [m].
            compliance: c, normal and tangential, shape (n, 2), [m/Pa].
            before: g0, shape (n, 3), [m].
        """
        share = self._in_three_directions(self.stiffness * compliance)
        return (trial_gap - share * before) / (1.0 - share)

    def traction_without_springs(
        self, traction: Floats, tangent: Floats, gap: Floats, compliance: Floats, before: Floats
    ) -> tuple[Floats, Floats]:
        """Return the traction t' and its derivative by h, shapes (n, 3) and (n, 3, 3).

        Args:
            traction: t of the law, shape (n, 3), [Pa].
            tangent: d t / d h', shape (n, 3, 3), [Pa/m].
            gap: Gap at the end of the increment, shape (n, 3), [m].
            compliance: c, normal and tangential, shape (n, 2), [m/Pa].
            before: g0, shape (n, 3), [m].
        """
        s = self._in_three_directions(self.stiffness)
        share = 1.0 - s * self._in_three_directions(compliance)
        derivative = tangent / share[:, :, None]
        derivative[:, [0, 1, 2], [0, 1, 2]] -= (1.0 - limits.SPRING_REGULARISATION) * s
        return traction - s * (gap - before), derivative / share[:, None, :]
