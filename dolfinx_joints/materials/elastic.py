# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Isotropic linear elasticity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import annotated_types as at
import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.declared import checked


@dataclass(frozen=True, kw_only=True)
@checked
class Elastic:
    """Isotropic linear elastic material.

    Attributes:
        young: Young's modulus E.
        poisson: Poisson's ratio nu.
        density: Mass density rho.

    Example:
        >>> import dolfinx_joints as dj
        >>> concrete = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> concrete.shear_modulus  # E / (2 (1 + nu)) [Pa]
        10000000000.0
    """

    young: Annotated[float, at.Gt(0), at.Unit("Pa")]
    poisson: Annotated[float, at.Gt(-1), at.Lt(0.5)]
    density: Annotated[float, at.Ge(0), at.Unit("kg/m^3")]

    @property
    def shear_modulus(self) -> float:
        """Mu = E / (2 (1 + nu)) [Pa]."""
        return self.young / (2.0 * (1.0 + self.poisson))

    def first_lame(self, plane: str) -> float:
        """Return lambda [Pa], in plane stress reduced for zero through-thickness stress."""
        nu = self.poisson
        if plane == "stress":
            return self.young * nu / (1.0 - nu**2)
        return self.young * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))

    def stiffness_matrix(self) -> Floats:
        """Return C of stress = C strain, shape (6, 6), [Pa].

        The order is xx, yy, zz, yz, xz, xy; shear strains are the angles 2 eps_yz and so on.
        """
        matrix = np.zeros((6, 6))
        matrix[:3, :3] = self.first_lame("strain")
        matrix[range(6), range(6)] += self.shear_modulus * np.array([2.0, 2.0, 2.0, 1.0, 1.0, 1.0])
        return matrix
