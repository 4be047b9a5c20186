# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of a model's arguments that look at more than one of them, or at the mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import ufl
from petsc4py import PETSc

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.parameters import check_kind_of, offers, shown
from dolfinx_joints.laws.law import is_law
from dolfinx_joints.loads.load import FaceLoad
from dolfinx_joints.mesh.jointed_mesh import JointedMesh


def check_joints(jointed: JointedMesh, joints: Any, initial_gaps: Any) -> None:
    """Check that laws and gaps are given where the mesh has joints, and nowhere else.

    Raises:
        ValueError: They are neither laws nor gaps.
        MeshError: There are none, or laws are missing.
    """
    named = joints is None or isinstance(joints, Mapping) or is_law(joints)
    check_kind_of("joints", joints, named, "a joint law, or one per joint name")
    named = initial_gaps is None or isinstance(initial_gaps, Mapping)
    check_kind_of("initial_gaps", initial_gaps, named, "a gap per joint name")
    if jointed.joint_names and joints is None:
        raise MeshError(
            f"The mesh has joints ({', '.join(jointed.joint_names)}) but no law was given; "
            "pass joints=, or read the mesh with joints=[] for a monolithic body."
        )
    for what, given in (("laws", joints), ("initial gaps", initial_gaps)):
        if not jointed.joint_names and isinstance(given, Mapping) and given:
            names = ", ".join(shown(name, str) for name in given)
            raise MeshError(f"The mesh has no joints, but {what} were given for {names}.")


def check_added(added_mass: Sequence[Any]) -> None:
    """Check that added masses are some.

    Raises:
        ValueError: One is not.
    """
    for added in added_mass:
        check_kind_of(
            "An added mass", added, offers(added, "matrix"), "a WestergaardMass or a ReservoirMass"
        )


def check_loads(jointed: JointedMesh, loads: Any) -> None:
    """Check that loads are some, on groups of the mesh.

    Raises:
        ValueError: They are no list of loads.
        MeshError: There is no such group.
    """
    check_kind_of("loads", loads, isinstance(loads, list | tuple), "a list of loads")
    for load in loads:
        check_kind_of("A load", load, offers(load, "patterns"), "Gravity, Traction or such")
        if isinstance(load, FaceLoad):
            jointed.facets(load.group)


def check_form(form: Any, arguments: int, what: str) -> None:
    """Check the number of arguments of a UFL form.

    Raises:
        ValueError: It is no form, or has another number.
    """
    count = len(form.arguments()) if isinstance(form, ufl.Form) else 0
    if count != arguments:
        raise ValueError(f"{what}; this one has {count} arguments: {shown(form, str)}.")


def check_nodal(name: str, vector: Any, like: PETSc.Mat) -> None:
    """Check that a vector is one of the model's unknowns (collective).

    Raises:
        ValueError: It is not.
    """
    wanted = like.getLocalSize()[0]
    fits = isinstance(vector, PETSc.Vec) and vector.handle != 0 and vector.getLocalSize() == wanted
    every: Sequence[bool] = like.comm.tompi4py().allgather(bool(fits))
    check_kind_of(name, vector, all(every), "a vector of the model's unknowns")
