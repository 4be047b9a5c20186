# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of a model's arguments that look at more than one of them, or at the mesh."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import ufl

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.parameters import check_kind_of, offers, shown
from dolfinx_joints.loads.load import FaceLoad
from dolfinx_joints.mesh.jointed_mesh import JointedMesh


def check_joints(jointed: JointedMesh, joints: Any, initial_gaps: Any) -> None:
    """Check that laws and gaps are given where the mesh has joints, and nowhere else."""
    if jointed.joint_names and joints is None:
        raise MeshError(
            f"The mesh has joints ({', '.join(jointed.joint_names)}) but no law was given; "
            "pass joints=, or read the mesh with joints=[] for a monolithic body."
        )
    for what, given in (("laws", joints), ("initial gaps", initial_gaps)):
        if not jointed.joint_names and isinstance(given, Mapping) and given:
            names = ", ".join(map(str, given))
            raise MeshError(f"The mesh has no joints, but {what} were given for {names}.")


def check_loads(jointed: JointedMesh, loads: Any) -> None:
    """Check that loads are some, on groups of the mesh."""
    check_kind_of("loads", loads, isinstance(loads, list | tuple), "a list of loads")
    for load in loads:
        check_kind_of("A load", load, offers(load, "patterns"), "Gravity, Traction or such")
        if isinstance(load, FaceLoad):
            jointed.facets(load.group)


def check_form(form: Any, arguments: int, what: str) -> None:
    """Check the number of arguments of a UFL form."""
    count = len(form.arguments()) if isinstance(form, ufl.Form) else 0
    if count != arguments:
        raise ValueError(f"{what}; this one has {count} arguments: {shown(form, str)}.")
