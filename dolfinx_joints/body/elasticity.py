# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear elasticity in UFL: stiffness and mass forms, stress recovery."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray

from dolfinx_joints.body.quadrature import law_degree, matrix_measure
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.materials.bulk_law import BulkLaw, Material, elastic_part
from dolfinx_joints.materials.elastic import Elastic
from dolfinx_joints.materials.orthotropic import Orthotropic
from dolfinx_joints.mesh.jointed_mesh import JointedMesh

# Positions of the 2-D strain components xx, yy, xy in xx, yy, zz, yz, xz, xy.
IN_PLANE = (0, 1, 5)

# Stress components in the order of VTK.
COMPONENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))


def strain(u: Any) -> Any:
    """Return the small strain tensor of a displacement (UFL)."""
    return ufl.sym(ufl.grad(u))


class ElasticBody:
    """Stiffness and mass of an elastic body with one material, or one per cell group.

    K: (lambda tr(eps(u)) I + 2 mu eps(u)) : eps(v) dx,   M: rho u . v dx

    The stress is C eps(u) if a material is orthotropic. Of nonlinear materials the elastic part is
    used. In 2-D ``plane`` is ``strain`` or ``stress``, with unit thickness; 3-D ignores it.

    Attributes:
        density: rho [kg/m^3].
        first_lame: lambda [Pa], NaN in orthotropic cells.
        shear_modulus: mu [Pa], NaN in orthotropic cells.
        strained_axes: Number of blocked normal strains of a clamped body: 2 in plane stress or 3.
    """

    def __init__(
        self, jointed: JointedMesh, material: Material | Mapping[str, Material], *, plane: str
    ) -> None:
        """Set the parameters of the cells (collective)."""
        mesh = jointed.mesh
        gdim = mesh.topology.dim
        plane = plane if gdim == 2 else "strain"
        self.strained_axes = 2 if plane == "stress" else 3
        self._jointed, self._matrix = jointed, None
        by_group = material if isinstance(material, Mapping) else {"": material}
        self.materials = dict(by_group)
        for item in by_group.values():
            if not isinstance(item, Elastic | Orthotropic | BulkLaw):
                raise ValueError(
                    f"material is {shown(item)}; it must be an Elastic, an Orthotropic or a "
                    "nonlinear material, or one of these per named cell group."
                )
        self._nonlinear = {group: isinstance(item, BulkLaw) for group, item in by_group.items()}
        elastic = {group: elastic_part(item) for group, item in by_group.items()}
        values = {group: _parameters(item, plane) for group, item in elastic.items()}
        is_orthotropic = any(not isinstance(item, Elastic) for item in elastic.values())
        if not isinstance(material, Mapping):
            self.first_lame, self.shear_modulus, self.density = (
                fem.Constant(mesh, value) for value in values[""]
            )
            if is_orthotropic:
                self._matrix = fem.Constant(mesh, _stiffness(elastic[""], gdim, plane))
            return
        if not material:
            raise ValueError("material is an empty mapping; give one material per cell group.")
        space = fem.functionspace(mesh, ("DG", 0))
        fields = [fem.Function(space) for _ in range(3)]
        count = fem.Function(space)
        for group, parameters in values.items():
            cells = jointed.cells(group)
            dofs = space.dofmap.list[cells, 0]
            count.x.array[dofs] += 1
            for field, value in zip(fields, parameters, strict=True):
                field.x.array[dofs] = value
        faulty = int(sum(mesh.comm.allgather(int((count.x.array != 1).sum()))))
        if faulty:
            raise ValueError(
                f"{faulty} cells have no material or more than one; the groups "
                f"{', '.join(material)} must cover the mesh without overlap."
            )
        self.first_lame, self.shear_modulus, self.density = fields
        if is_orthotropic:
            shape = (4, 3) if gdim == 2 else (6, 6)
            self._matrix = fem.Function(fem.functionspace(mesh, ("DG", 0, shape)))
            blocks = self._matrix.x.array.reshape(-1, *shape)
            for group, item in elastic.items():
                cells = self._matrix.function_space.dofmap.list[jointed.cells(group), 0]
                blocks[cells] = _stiffness(item, gdim, plane)

    def stress(self, u: Any) -> Any:
        """Return the Cauchy stress (UFL), [Pa], with the elastic part of nonlinear materials."""
        eps = strain(u)
        if self._matrix is not None:
            return _tensor(self._matrix * strain_vector(u), len(u))
        identity = ufl.Identity(len(u))
        return self.first_lame * ufl.tr(eps) * identity + 2.0 * self.shear_modulus * eps

    def stress_vector(self, u: Any) -> Any:
        """Return the stress (xx, yy, zz, xy, yz, xz) of a displacement (UFL), [Pa].

        In plane strain the result includes zz.
        """
        stress, zero = self.stress(u), ufl.as_ufl(0.0)
        if len(u) == 3:
            return ufl.as_vector([stress[i, j] for i, j in COMPONENTS])
        across = self.first_lame * ufl.tr(strain(u)) if self.strained_axes == 3 else zero
        if self._matrix is not None:
            across = (self._matrix * strain_vector(u))[3]
        return ufl.as_vector([stress[0, 0], stress[1, 1], across, stress[0, 1], zero, zero])

    def blocked_stress(self, strain: Any) -> Any:
        """Return the pressure due to a blocked isotropic strain, for example a thermal one (UFL).

        The pressure [Pa] is (3 lambda + 2 mu) times the strain, in plane stress (2 lambda + 2 mu).
        It is NaN in orthotropic cells, whose stress is not isotropic.
        """
        return (self.strained_axes * self.first_lame + 2.0 * self.shear_modulus) * strain

    def stiffness_form(self, u: Any, v: Any) -> Any:
        """Return the bilinear form of K; nonlinear cells use the quadrature points of their law."""
        density, shape = ufl.inner(self.stress(u), strain(v)), self._jointed.shape
        if not any(self._nonlinear.values()):
            return density * matrix_measure(shape)
        rule = law_degree(shape, u.ufl_function_space().ufl_element().degree)
        if "" in self._nonlinear:
            return density * ufl.dx(degree=rule)
        measures = (
            dx(degree=rule) if nonlinear else matrix_measure(shape, dx)
            for nonlinear, dx in ((n, self._jointed.dx(g)) for g, n in self._nonlinear.items())
        )
        return sum(density * measure for measure in measures)

    def mass_form(self, u: Any, v: Any) -> Any:
        """Return the bilinear form of M."""
        return self.density * ufl.inner(u, v) * matrix_measure(self._jointed.shape)


def strain_vector(u: Any) -> Any:
    """Return the strain (UFL): (xx, yy, zz, 2 yz, 2 xz, 2 xy), in 2-D (xx, yy, 2 xy)."""
    eps = strain(u)
    if len(u) == 2:
        return ufl.as_vector([eps[0, 0], eps[1, 1], 2.0 * eps[0, 1]])
    shear = [2.0 * eps[i, j] for i, j in ((1, 2), (0, 2), (0, 1))]
    return ufl.as_vector([*(eps[i, i] for i in range(3)), *shear])


def _tensor(stress: Any, dimension: int) -> Any:
    """Return the tensor (UFL) of a stress vector in the order of `strain_vector`."""
    if dimension == 2:
        return ufl.as_tensor([[stress[0], stress[2]], [stress[2], stress[1]]])
    xx, yy, zz, yz, xz, xy = (stress[i] for i in range(6))
    return ufl.as_tensor([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _parameters(solid: Elastic | Orthotropic, plane: str) -> tuple[float, float, float]:
    """Return first Lame parameter, shear modulus and density."""
    if isinstance(solid, Elastic):
        return float(solid.first_lame(plane)), float(solid.shear_modulus), float(solid.density)
    return float("nan"), float("nan"), float(solid.density)


def _stiffness(solid: Elastic | Orthotropic, dimension: int, plane: str) -> NDArray[np.float64]:
    """Return the stiffness in the order of `strain_vector`; in 2-D the last row gives zz."""
    matrix = solid.stiffness_matrix()
    if dimension == 3:
        return matrix
    coupled = float(np.abs(matrix[np.ix_((0, 1, 2, 5), (3, 4))]).max())
    if coupled > 1e-9 * float(np.abs(matrix).max()):
        raise ValueError(
            "An orthotropic material has axes inclined to the plane of a 2-D model; one axis must "
            "be (0, 0, 1)."
        )
    rows = np.ix_(IN_PLANE, IN_PLANE)
    if plane == "strain":
        return np.vstack([matrix[rows], matrix[2, IN_PLANE]])
    return np.vstack([np.linalg.inv(np.linalg.inv(matrix)[rows]), np.zeros(3)])
