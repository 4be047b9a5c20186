# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The body that loads act on, as far as they read it; a `Model` is one."""

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
    """A body on a split mesh, its matrices and its joints.

    M, whose layout forces and added masses have, is ``mass``; groups with a viscous boundary are
    ``absorbing``; without joints operator and contact are None.
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
        """Nodal forces of a linear form, [N] (collective)."""

    def inertia_pattern(self, acceleration: Floats, *, body_only: bool = False) -> PETSc.Vec:
        """M times a uniform acceleration [m/s^2], [N] (collective).

        With ``body_only`` without added masses, which have no weight.
        """

    def joined(self, force: PETSc.Vec) -> PETSc.Vec:
        """A vector of the body's unknowns among those of a dynamic stage (collective)."""

    def nodes(self, group: str) -> Ints:
        """Owned nodes of a facet group, local numbers (collective)."""
