# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Isotropic linear elasticity: its two constants and the density."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.parameters import check_number, hold_floats


@dataclass(frozen=True, kw_only=True)
class Elastic:
    """Isotropic linear elastic material.

    Attributes:
        young: Young's modulus E [Pa], positive.
        poisson: Poisson's ratio nu, above -1 and below 0.5.
        density: Mass density rho [kg/m^3], not negative.

    Raises:
        ValueError: A parameter is out of its range.
    """

    young: float
    poisson: float
    density: float

    def __post_init__(self) -> None:
        """Check the parameters."""
        hold_floats(self)
        check_number("young", self.young, lambda v: v > 0, "positive and finite", unit="Pa")
        check_number("poisson", self.poisson, lambda v: -1 < v < 0.5, "above -1 and below 0.5")
        check_number(
            "density", self.density, lambda v: v >= 0, "zero or more and finite", unit="kg/m^3"
        )

    @property
    def shear_modulus(self) -> float:
        """Mu = E / (2 (1 + nu)) [Pa]."""
        return self.young / (2.0 * (1.0 + self.poisson))

    def first_lame(self, plane: str) -> float:
        """Lambda [Pa], in plane stress the value that makes the through-thickness stress vanish."""
        nu = self.poisson
        if plane == "stress":
            return self.young * nu / (1.0 - nu**2)
        return self.young * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))

    def stiffness_matrix(self) -> NDArray[np.float64]:
        """C with stress = C strain, shape (6, 6), [Pa].

        The order is xx, yy, zz, yz, xz, xy, shear strains are the angles 2 eps_yz, ...
        """
        matrix = np.zeros((6, 6))
        matrix[:3, :3] = self.first_lame("strain")
        matrix[range(6), range(6)] += self.shear_modulus * np.array([2.0, 2.0, 2.0, 1.0, 1.0, 1.0])
        return matrix
