# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""User-defined forms in a model: their arguments, and the joints that they tie."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import ufl

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.mesh.jointed_mesh import JointedMesh

BilinearForm = Callable[[Any, Any], Any]


def check_form(form: Any, arguments: int, what: str) -> None:
    """Check the number of arguments of a UFL form, and that numbers of parts are tags."""
    found = len(form.arguments()) if isinstance(form, ufl.Form) else 0
    if found != arguments:
        raise ValueError(f"{what}; this one has {found} arguments: {shown(form, str)}.")
    for each in form.integrals():
        if each.subdomain_data() is None and each.subdomain_id() not in ("everywhere", "otherwise"):
            part = f"the part {shown(each.subdomain_id())} of a measure without tags"
            raise ValueError(f"{what}; this one integrates over {part}: take jointed.ds(NAME).")


def check_tied(jointed: JointedMesh, forms: list[Any]) -> None:
    """Check that forms in K integrate over every joint, where no joint has a law (collective).

    Raises:
        MeshError: They leave a joint out.
    """
    over = [jointed.joints_of(integral) or () for form in forms for integral in form.integrals()]
    tied = {position for positions in over for position in positions}
    left = [name for i, name in enumerate(jointed.joint_names) if i not in tied]
    if left:
        raise MeshError(
            f"The mesh has joints ({', '.join(left)}) but no law was given; pass joints=, tie them "
            "by an extra_stiffness over jointed.dS(), or read the mesh with joints=[] for a "
            "monolithic body."
        )


def check_joints(jointed: JointedMesh, joints: Any, initial_gaps: Any) -> None:
    """Check that laws and gaps are given where the mesh has joints."""
    for what, given in (("laws", joints), ("initial gaps", initial_gaps)):
        if not jointed.joint_names and isinstance(given, Mapping) and given:
            names = ", ".join(map(str, given))
            raise MeshError(f"The mesh has no joints, but {what} were given for {names}.")
    if not jointed.joint_names and joints is not None and not isinstance(joints, Mapping):
        raise MeshError(
            f"The mesh has no joints, but the law {type(joints).__name__} was given for them; name "
            "the surface group of each joint 'joint...' in the mesh or list it in joints= of the "
            "reader. A monolithic body takes no joints= in Model."
        )
