# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear elasticity in UFL: material parameters, stiffness and mass forms, stress recovery."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import ufl

from dolfinx_joints.checks import check_number
from dolfinx_joints.mesh import JointedMesh


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


def strain(u: Any) -> Any:
    """Small strain tensor of a displacement (UFL)."""
    return ufl.sym(ufl.grad(u))


class ElasticBody:
    """Stiffness and mass of an elastic body, with one material or one per cell group.

    K: (lambda tr(eps(u)) I + 2 mu eps(u)) : eps(v) dx,   M: rho u . v dx

    Args:
        jointed: The mesh with its cell groups.
        material: One material for all cells, or one per named cell group.
        plane: ``strain`` or ``stress`` in 2-D (unit thickness); ignored in 3-D.

    Raises:
        ValueError: ``plane`` is unknown, or some cells have no material or several.
        MeshError: A cell group does not exist.
    """

    def __init__(
        self, jointed: JointedMesh, material: Elastic | Mapping[str, Elastic], *, plane: str
    ) -> None:
        """Put the parameters on the cells (collective)."""
        from dolfinx import fem

        if plane not in ("strain", "stress"):
            raise ValueError(f"plane is {plane!r}; it must be 'strain' or 'stress'.")
        mesh = jointed.mesh
        plane = plane if mesh.topology.dim == 2 else "strain"
        self._strained_axes = 2 if plane == "stress" else 3
        if not isinstance(material, Elastic | Mapping):
            raise ValueError(
                f"material is {material!r}; it must be an Elastic, or one per named cell group."
            )
        if isinstance(material, Elastic):
            constants = (material.first_lame(plane), material.shear_modulus, material.density)
            self.first_lame, self.shear_modulus, self.density = (
                fem.Constant(mesh, float(value)) for value in constants
            )
            return
        if not material:
            raise ValueError("material names no cell group; give a material, or one per group.")
        space = fem.functionspace(mesh, ("DG", 0))
        fields = [fem.Function(space) for _ in range(3)]
        count = fem.Function(space)
        for group, parameters in material.items():
            cells = jointed.cells(group)
            dofs = space.dofmap.list[cells, 0]
            count.x.array[dofs] += 1
            fields[0].x.array[dofs] = parameters.first_lame(plane)
            fields[1].x.array[dofs] = parameters.shear_modulus
            fields[2].x.array[dofs] = parameters.density
        wrong = int(sum(mesh.comm.allgather(int((count.x.array != 1).sum()))))
        if wrong:
            raise ValueError(
                f"{wrong} cells have no material or several; the groups {', '.join(material)} "
                "must cover the mesh without overlap."
            )
        self.first_lame, self.shear_modulus, self.density = fields

    def stress(self, u: Any) -> Any:
        """Cauchy stress of a displacement (UFL), [Pa]."""
        eps = strain(u)
        identity = ufl.Identity(len(u))
        return self.first_lame * ufl.tr(eps) * identity + 2.0 * self.shear_modulus * eps

    def blocked_stress(self, strain: Any) -> Any:
        """Pressure that an isotropic strain such as a thermal one makes where it is held (UFL).

        (3 lambda + 2 mu) times the strain, 2 lambda + 2 mu in plane stress, [Pa].
        """
        return (self._strained_axes * self.first_lame + 2.0 * self.shear_modulus) * strain

    def stiffness_form(self, u: Any, v: Any) -> Any:
        """The bilinear form of K."""
        return ufl.inner(self.stress(u), strain(v)) * ufl.dx

    def mass_form(self, u: Any, v: Any) -> Any:
        """The bilinear form of M."""
        return self.density * ufl.inner(u, v) * ufl.dx
