# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Heat conduction between blocks through joints.

The two faces of a joint have separate temperatures. The flux between them is q = h (T- - T+); its
weak form is \int h [T] [v] dA. The contact and the filling of an opening g act in series:

    1 / h = 1 / h_c + max(g, 0) / k_f.                                                     (12ad)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import annotated_types as at
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.parameters import check_kind_of, shown
from dolfinx_joints.mesh.joint_pairs import no_such_joint
from dolfinx_joints.mesh.jointed_mesh import JointedMesh


@dataclass(frozen=True, kw_only=True)
@checked
class JointConductance:
    """Thermal conductance of a joint, per area.

    Attributes:
        closed: Conductance h_c of the closed joint.
        film: Conductivity k_f of the filling: 0.025 for air, 0.6 for water, 0 for no conduction.
    """

    closed: Annotated[float, at.Gt(0), at.Unit("W/(m^2 K)")]
    film: Annotated[float, at.Ge(0), at.Unit("W/(m K)")] = 0.0

    def at(self, opening: Any) -> Any:
        """Return the conductance h (12ad) at a normal gap [m], a number or UFL."""
        if self.film == 0.0:
            return ufl.conditional(ufl.gt(opening, 0.0), 0.0, self.closed)
        return 1.0 / (1.0 / self.closed + ufl.max_value(opening, 0.0) / self.film)


Joints = Mapping[str, JointConductance]
Openings = Mapping[str, Any]


def joint_term(
    jointed: JointedMesh, joints: Joints | None, openings: Openings | None, t: Any, q: Any
) -> Any:
    """Return the weak form of the heat flux through the joints (UFL); 0 without joints.

    Openings are normal gaps [m], numbers or UFL scalars under `JointedMesh.dS`; zero by default.

    Raises:
        ValueError: A conductance is not a `JointConductance`, or is missing for an opening.
        MeshError: A joint does not exist.
    """
    joints, openings = joints or {}, openings or {}
    if missing := [name for name in openings if name not in joints]:
        raise ValueError(f"openings has {shown(missing[0])}, which has no conductance in joints.")
    term = 0
    for name, conductance in joints.items():
        if name not in jointed.joint_names:
            raise MeshError(no_such_joint(name, jointed.joint_names))
        valid = isinstance(conductance, JointConductance)
        check_kind_of(f"The conductance of {name!r}", conductance, valid, "a JointConductance")
        opening = openings.get(name, 0.0)
        if not isinstance(opening, Expr):
            opening = fem.Constant(jointed.mesh, float(opening))
        term += conductance.at(opening) * ufl.inner(ufl.jump(t), ufl.jump(q)) * jointed.dS(name)
    return term
