# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Absorbing boundaries of the foundation: dashpots after Lysmer and Kuhlemeyer (1969)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import ufl

from dolfinx_joints.body.elasticity import ElasticBody
from dolfinx_joints.body.quadrature import matrix_measure
from dolfinx_joints.common.declared import checked
from dolfinx_joints.mesh.jointed_mesh import JointedMesh


@dataclass(frozen=True, kw_only=True)
@checked
class ViscousBoundary:
    """Dashpots on a facet group: rho c_p along the normal, rho c_s tangentially, per area.

    The integral of rho c_p (u.n)(v.n) + rho c_s (u_t . v_t) over the group is added to the damping
    form. The cell behind each facet gives the density rho and the wave speeds c_p and c_s; it must
    be isotropic. Massless cells do not contribute. Normally incident waves are absorbed completely.

    Attributes:
        group: Name of the facet group.
        in_statics: ``held``: the group is fixed in static stages, and its reactions act as a load
            in dynamic stages; or ``free``.
    """

    group: str
    in_statics: Literal["held", "free"] = "held"

    def form(self, jointed: JointedMesh, body: ElasticBody, u: Any, v: Any) -> Any:
        """Return the bilinear form of the dashpots."""
        ds = matrix_measure(jointed.shape, jointed.ds(self.group))
        return ufl.inner(impedance(jointed, body, u), v) * ds


def absorbing_groups(
    jointed: JointedMesh, body: ElasticBody, supports: Sequence[Any]
) -> tuple[str, ...]:
    """Return the groups with a viscous boundary, after a check of their cells (collective)."""
    groups = [support.group for support in supports if isinstance(support, ViscousBoundary)]
    if groups:
        facets = np.concatenate([jointed.facets(group) for group in groups])
        twice = len(facets) - len(np.unique(facets))
        if any(jointed.mesh.comm.allgather(twice > 0)):
            raise ValueError(
                f"The viscous boundaries on {', '.join(groups)} have common facets; a facet may "
                "belong to only one of them."
            )
        orthotropic = np.isnan(_shear_moduli(jointed, body, facets)).any()
        if any(jointed.mesh.comm.allgather(bool(orthotropic))):
            raise ValueError(
                f"The viscous boundaries on {', '.join(groups)} have orthotropic cells behind "
                "them, which have no single wave speeds; give these cells an Elastic material."
            )
    return tuple(groups)


def _shear_moduli(jointed: JointedMesh, body: ElasticBody, facets: Any) -> Any:
    """Return mu of the cell behind each facet, NaN if orthotropic, shape (n,), [Pa]."""
    field, topology = body.shear_modulus, jointed.mesh.topology
    if not hasattr(field, "function_space"):
        return np.full(len(facets), float(field.value))
    topology.create_connectivity(topology.dim - 1, topology.dim)
    cells = topology.connectivity(topology.dim - 1, topology.dim)
    behind = cells.array[cells.offsets[facets]]
    return field.x.array[field.function_space.dofmap.list[behind, 0]]


def impedance(jointed: JointedMesh, body: ElasticBody, velocity: Any) -> Any:
    """Return the dashpot traction for a velocity of the boundary (UFL), [Pa]."""
    n = ufl.FacetNormal(jointed.mesh)
    normal = ufl.inner(velocity, n) * n
    pressure_wave = ufl.sqrt(body.density * (body.first_lame + 2.0 * body.shear_modulus))
    shear_wave = ufl.sqrt(body.density * body.shear_modulus)
    return pressure_wave * normal + shear_wave * (velocity - normal)
