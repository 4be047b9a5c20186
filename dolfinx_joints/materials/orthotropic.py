# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Orthotropic linear elasticity with nine constants, for example of concrete with lift joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import annotated_types as at
import numpy as np
from numpy.typing import ArrayLike

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.parameters import numbers_of, shown

Triple = tuple[float, float, float]

GLOBAL_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

# Pairs of axes in the order in which shear strains and stresses are stored.
_SHEARS = ((1, 2), (0, 2), (0, 1))


@dataclass(frozen=True, kw_only=True)
@checked
class Orthotropic:
    """Linear elastic material with three planes of symmetry.

    eps_11 = sigma_11/E_1 - nu_12 sigma_22/E_1 - nu_13 sigma_33/E_1 and so on, with
    nu_ij/E_i = nu_ji/E_j: contraction along j = nu_ij times extension along i, stress along i.

    Attributes:
        young: E_1, E_2, E_3.
        poisson: nu_12, nu_13, nu_23.
        shear: G_12, G_13, G_23.
        density: Mass density rho.
        axes: Material axes 1, 2, 3 in x, y, z: three orthogonal vectors of any length (default:
            the axes of the model).

    Raises:
        ValueError: The stiffness is not positive definite, or the axes are not orthogonal.
    """

    young: Annotated[Triple, at.Gt(0), at.Unit("Pa")]
    poisson: Triple
    shear: Annotated[Triple, at.Gt(0), at.Unit("Pa")]
    density: Annotated[float, at.Ge(0), at.Unit("kg/m^3")]
    axes: ArrayLike = GLOBAL_AXES

    def __post_init__(self) -> None:
        """Check that the axes are orthogonal and the stiffness is positive definite."""
        self._frame()
        scale = np.sqrt(np.asarray(self.young, float))
        smallest = np.linalg.eigvalsh(self._compliance()[:3, :3] * np.outer(scale, scale))[0]
        if smallest <= 1e-12:
            raise ValueError(
                f"Orthotropic: with poisson {tuple(self.poisson)} and young {tuple(self.young)} "
                "the stiffness is not positive definite; |nu_ij| must be below sqrt(E_i/E_j), and "
                "1 - nu12 nu21 - nu23 nu32 - nu31 nu13 - 2 nu21 nu32 nu13 above 0."
            )

    def stiffness_matrix(self) -> Floats:
        """Return C of stress = C strain in x, y, z, shape (6, 6), [Pa].

        The order is xx, yy, zz, yz, xz, xy; shear strains are the angles 2 eps_yz and so on.
        """
        local = np.linalg.inv(self._compliance())
        rotation = _strain_rotation(self._frame())
        matrix: Floats = rotation.T @ local @ rotation
        return 0.5 * (matrix + matrix.T)

    def _compliance(self) -> Floats:
        """Return S of strain = S stress in the material axes, shape (6, 6), [1/Pa]."""
        e1, e2, e3 = (1.0 / float(young) for young in self.young)
        nu12, nu13, nu23 = (float(nu) for nu in self.poisson)
        g12, g13, g23 = (1.0 / float(shear) for shear in self.shear)
        compliance = np.diag([e1, e2, e3, g23, g13, g12])
        for i, j, value in ((0, 1, -nu12 * e1), (0, 2, -nu13 * e1), (1, 2, -nu23 * e2)):
            compliance[i, j] = compliance[j, i] = value
        return compliance

    def _frame(self) -> Floats:
        """Return the unit vectors of the axes as rows, shape (3, 3).

        Raises:
            ValueError: ``axes`` is not three orthogonal vectors.
        """
        rows = numbers_of(self.axes)
        valid = rows is not None and rows.shape == (3, 3) and bool(np.isfinite(rows).all())
        lengths = np.linalg.norm(rows, axis=1) if valid and rows is not None else np.zeros(3)
        if rows is not None and np.all(lengths > 0.0) and np.all(np.isfinite(lengths)):
            frame: Floats = rows / lengths[:, None]
            if np.allclose(frame @ frame.T, np.eye(3), atol=1e-6):
                u, _, v = np.linalg.svd(frame)  # exactly orthogonal
                return u @ v
        raise ValueError(
            f"Orthotropic: axes is {shown(self.axes)}; it must be three orthogonal vectors in "
            "x, y, z."
        )


def _strain_rotation(frame: Floats) -> Floats:
    """Return the matrix that rotates strains from x, y, z to a frame (rows), shape (6, 6)."""
    rotation = np.empty((6, 6))
    for column in range(6):
        tensor = np.zeros((3, 3))
        if column < 3:
            tensor[column, column] = 1.0
        else:
            i, j = _SHEARS[column - 3]
            tensor[i, j] = tensor[j, i] = 0.5
        rotated = frame @ tensor @ frame.T
        rotation[:3, column] = np.diag(rotated)
        rotation[3:, column] = [2.0 * rotated[i, j] for i, j in _SHEARS]
    return rotation
