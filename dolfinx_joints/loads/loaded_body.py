# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Protocol for the part of a `Model` that loads read."""

from __future__ import annotations

from typing import Any, Protocol

from dolfinx.fem import FunctionSpace
from petsc4py import PETSc

from dolfinx_joints.body.elasticity import ElasticBody
from dolfinx_joints.body.supports import Constraints
from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.joints.operator import JointOperator
from dolfinx_joints.mesh.jointed_mesh import JointedMesh


class LoadedBody(Protocol):
    """Body on a split mesh, its matrices and its joints.

    Forces and added masses have the layout of the mass matrix ``mass``. ``absorbing`` names the
    groups with a viscous boundary. Without joints, operator and contact are None.
    """

    jointed: JointedMesh
    gdim: int
    V: FunctionSpace
    body: ElasticBody
    mass: PETSc.Mat
    constraints: Constraints
    absorbing: tuple[str, ...]
    operator: JointOperator | None
    contact: Contact | None

    def assemble(self, form: Any) -> PETSc.Vec:
        """Return the nodal forces of a linear form, [N] (collective)."""

    def inertia_pattern(self, acceleration: Floats, *, body_only: bool = False) -> PETSc.Vec:
        """Return M times a uniform acceleration [m/s^2], [N] (collective).

        With ``body_only``, added masses are excluded, because they have no weight.
        """

    def joined(self, force: PETSc.Vec) -> PETSc.Vec:
        """Extend a body vector to all unknowns of a dynamic stage, such as water (collective)."""

    def nodes(self, group: str) -> Ints:
        """Return the owned nodes of a facet group as local numbers (collective)."""
