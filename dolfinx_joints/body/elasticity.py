# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear elasticity in UFL: material parameters, stiffness and mass forms, stress recovery."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import basix
import numpy as np
import ufl
from numpy.typing import NDArray

from dolfinx_joints.common.parameters import check_choice, check_number, hold_floats, offers, shown
from dolfinx_joints.mesh.cells import CellShape
from dolfinx_joints.mesh.jointed_mesh import JointedMesh

if TYPE_CHECKING:
    from dolfinx_joints.materials.drucker_prager import BulkLaw
    from dolfinx_joints.materials.orthotropic import Orthotropic

# Rows of a 6 x 6 stiffness that a plane body has: xx, yy, xy of xx, yy, zz, yz, xz, xy.
IN_PLANE = (0, 1, 5)

PLANES = ("strain", "stress")


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


Material: TypeAlias = "Elastic | Orthotropic | BulkLaw"


def strain(u: Any) -> Any:
    """Small strain tensor of a displacement (UFL)."""
    return ufl.sym(ufl.grad(u))


class ElasticBody:
    """Stiffness and mass of an elastic body, with one material or one per cell group.

    K: (lambda tr(eps(u)) I + 2 mu eps(u)) : eps(v) dx,   M: rho u . v dx

    and C eps(u) in the place of the stress where some material is orthotropic. Of a plastic
    material only its elastic part is seen here.

    Args:
        jointed: The mesh with its cell groups.
        material: One material for all cells, or one per named cell group.
        plane: ``strain`` or ``stress`` in 2-D (unit thickness); ignored in 3-D.

    Attributes:
        density: rho [kg/m^3].
        first_lame: lambda [Pa], NaN in orthotropic cells.
        shear_modulus: mu [Pa], NaN in orthotropic cells.

    Raises:
        ValueError: ``plane`` is unknown, some cells have no material or several, or an orthotropic
            material does not fit a plane body.
        MeshError: A cell group does not exist.
    """

    def __init__(
        self, jointed: JointedMesh, material: Material | Mapping[str, Material], *, plane: str
    ) -> None:
        """Put the parameters on the cells (collective)."""
        from dolfinx import fem

        check_choice("plane", plane, PLANES)
        mesh = jointed.mesh
        gdim = mesh.topology.dim
        plane = plane if gdim == 2 else "strain"
        self._strained_axes = 2 if plane == "stress" else 3
        self._jointed, self._matrix = jointed, None
        by_group = material if isinstance(material, Mapping) else {"": material}
        self.materials = dict(by_group)
        for given in by_group.values():
            if not _is_material(given):
                raise ValueError(
                    f"material is {shown(given)}; it must be an Elastic, an Orthotropic or a "
                    "plastic material, or one of these per named cell group."
                )
        self._plastic = {group: is_plastic(given) for group, given in by_group.items()}
        elastic = {group: elastic_part(given) for group, given in by_group.items()}
        values = {group: _parameters(given, plane) for group, given in elastic.items()}
        needed = any(not isinstance(given, Elastic) for given in elastic.values())
        if not isinstance(material, Mapping):
            self.first_lame, self.shear_modulus, self.density = (
                fem.Constant(mesh, value) for value in values[""]
            )
            if needed:
                self._matrix = fem.Constant(mesh, _reduced(elastic[""], gdim, plane))
            return
        if not material:
            raise ValueError("material names no cell group; give a material, or one per group.")
        space = fem.functionspace(mesh, ("DG", 0))
        fields = [fem.Function(space) for _ in range(3)]
        count = fem.Function(space)
        for group, parameters in values.items():
            cells = jointed.cells(group)
            dofs = space.dofmap.list[cells, 0]
            count.x.array[dofs] += 1
            for field, value in zip(fields, parameters, strict=True):
                field.x.array[dofs] = value
        wrong = int(sum(mesh.comm.allgather(int((count.x.array != 1).sum()))))
        if wrong:
            raise ValueError(
                f"{wrong} cells have no material or several; the groups {', '.join(material)} "
                "must cover the mesh without overlap."
            )
        self.first_lame, self.shear_modulus, self.density = fields
        if needed:
            size = len(IN_PLANE) if gdim == 2 else 6
            self._matrix = fem.Function(fem.functionspace(mesh, ("DG", 0, (size, size))))
            blocks = self._matrix.x.array.reshape(-1, size, size)
            for group, given in elastic.items():
                cells = self._matrix.function_space.dofmap.list[jointed.cells(group), 0]
                blocks[cells] = _reduced(given, gdim, plane)

    def stress(self, u: Any) -> Any:
        """Cauchy stress of a displacement (UFL), [Pa]; elastic in plastic cells as well."""
        eps = strain(u)
        if self._matrix is not None:
            return _tensor(self._matrix * strain_vector(u), len(u))
        identity = ufl.Identity(len(u))
        return self.first_lame * ufl.tr(eps) * identity + 2.0 * self.shear_modulus * eps

    def blocked_stress(self, strain: Any) -> Any:
        """Pressure that an isotropic strain such as a thermal one makes where it is held (UFL).

        (3 lambda + 2 mu) times the strain, 2 lambda + 2 mu in plane stress, [Pa]. NaN in
        orthotropic cells, where it is no pressure.
        """
        return (self._strained_axes * self.first_lame + 2.0 * self.shear_modulus) * strain

    def stiffness_form(self, u: Any, v: Any) -> Any:
        """The bilinear form of K, plastic cells integrated at the points of their law."""
        density = ufl.inner(self.stress(u), strain(v))
        if not any(self._plastic.values()):
            return density * ufl.dx
        rule = law_degree(self._jointed.shape, u.ufl_function_space().ufl_element().degree)
        if "" in self._plastic:
            return density * ufl.dx(degree=rule)
        measures = (
            self._jointed.dx(group)(degree=rule) if plastic else self._jointed.dx(group)
            for group, plastic in self._plastic.items()
        )
        return sum(density * measure for measure in measures)

    def mass_form(self, u: Any, v: Any) -> Any:
        """The bilinear form of M."""
        return self.density * ufl.inner(u, v) * ufl.dx


def law_degree(shape: CellShape, degree: int) -> int:
    """Degree of the rule at whose points plastic laws are asked.

    The least that integrates the stiffness of straight cells exactly: degree + 1 points along each
    axis of quadrilaterals and hexahedra.

    Args:
        shape: The cells.
        degree: Degree of the displacement.
    """
    simplex = shape.type in (basix.CellType.triangle, basix.CellType.tetrahedron)
    return 2 * (degree - 1) if simplex else 2 * degree + 1


def strain_vector(u: Any) -> Any:
    """(xx, yy, zz, 2 yz, 2 xz, 2 xy) of the strain of a displacement (UFL); (xx, yy, 2 xy) in 2-D.

    Args:
        u: Displacement.
    """
    eps = strain(u)
    if len(u) == 2:
        return ufl.as_vector([eps[0, 0], eps[1, 1], 2.0 * eps[0, 1]])
    shear = [2.0 * eps[i, j] for i, j in ((1, 2), (0, 2), (0, 1))]
    return ufl.as_vector([*(eps[i, i] for i in range(3)), *shear])


def _tensor(stress: Any, dimension: int) -> Any:
    """A stress in the order of `strain_vector` as a tensor (UFL)."""
    if dimension == 2:
        return ufl.as_tensor([[stress[0], stress[2]], [stress[2], stress[1]]])
    xx, yy, zz, yz, xz, xy = (stress[i] for i in range(6))
    return ufl.as_tensor([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def is_plastic(material: Material) -> bool:
    """Whether a material has a law of its own beyond its elastic part."""
    return offers(material, "backward_euler")


def elastic_part(material: Material) -> Elastic | Orthotropic:
    """The material itself, or what a plastic one is below its limit."""
    return material.elastic if is_plastic(material) else material  # type: ignore[union-attr, return-value]


def _is_material(given: Any) -> bool:
    return offers(given) and offers(getattr(given, "elastic", given), "stiffness_matrix")


def _parameters(given: Elastic | Orthotropic, plane: str) -> tuple[float, float, float]:
    """First Lame parameter, shear modulus and density."""
    if isinstance(given, Elastic):
        return float(given.first_lame(plane)), float(given.shear_modulus), float(given.density)
    return float("nan"), float("nan"), float(given.density)


def _reduced(given: Elastic | Orthotropic, dimension: int, plane: str) -> NDArray[np.float64]:
    """Stiffness in the order of `strain_vector`, that of a plane body in 2-D.

    Raises:
        ValueError: The plane is no plane of symmetry of the material.
    """
    matrix = given.stiffness_matrix()
    if dimension == 3:
        return matrix
    coupled = float(np.abs(matrix[np.ix_((0, 1, 2, 5), (3, 4))]).max())
    if coupled > 1e-9 * float(np.abs(matrix).max()):
        raise ValueError(
            "The axes of an orthotropic material are inclined to the plane of a 2-D model; one of "
            "them must be (0, 0, 1)."
        )
    rows = np.ix_(IN_PLANE, IN_PLANE)
    if plane == "strain":
        return matrix[rows]
    return np.linalg.inv(np.linalg.inv(matrix)[rows])
