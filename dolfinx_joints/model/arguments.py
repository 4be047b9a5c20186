# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a model and its stages are given, refused where it is something else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import ufl
from petsc4py import PETSc

from dolfinx_joints.body.damping import Rayleigh
from dolfinx_joints.body.elasticity import PLANES
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.parameters import (
    check_choice,
    check_flag,
    check_function,
    check_kind_of,
    offers,
    real,
    shown,
)
from dolfinx_joints.joints.quadrature import check_rule
from dolfinx_joints.mesh.jointed_mesh import JointedMesh

ADDED = "a WestergaardMass or a ReservoirMass"


def check_options(
    *,
    degree: Any,
    quadrature: Any,
    plane: Any,
    damping: Any,
    forms: Mapping[str, Any],
    flags: Mapping[str, Any],
) -> None:
    """Refuse options of a model that do not exist.

    Args:
        degree: Of the displacement, None for that of the mesh.
        quadrature: Rule on the joints.
        plane: Kind of plane problem.
        damping: Rayleigh damping, or None.
        forms: Bilinear forms of the user's own by name, None for none.
        flags: Truth values by name.

    Raises:
        ValueError: One does not.
    """
    if degree is not None and real(degree) not in (1.0, 2.0):
        raise ValueError(f"degree is {shown(degree)}; the displacement may be of degree 1 or 2.")
    check_rule(quadrature)
    check_choice("plane", plane, PLANES)
    given = damping is None or isinstance(damping, Rayleigh)
    check_kind_of("damping", damping, given, "a Rayleigh damping")
    for name, form in forms.items():
        if form is not None:
            check_function(name, form, "(u, v)")
    for name, flag in flags.items():
        check_flag(name, flag)


def check_joints(jointed: JointedMesh, joints: Any, initial_gaps: Any) -> None:
    """Refuse laws and gaps of joints where the mesh has none, and joints without a law.

    Raises:
        ValueError: They are neither laws nor gaps.
        MeshError: There are none, or laws are missing.
    """
    named = joints is None or isinstance(joints, Mapping) or offers(joints, "backward_euler")
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


def check_added(added_mass: Any) -> None:
    """Refuse what is no list of added masses.

    Raises:
        ValueError: It is not.
    """
    _check_list("added_mass", added_mass, "added masses")
    for added in added_mass:
        check_kind_of("An added mass", added, offers(added, "matrix"), ADDED)


def check_loads(jointed: JointedMesh, loads: Any) -> None:
    """Refuse what is no list of loads.

    Raises:
        ValueError: It is not, or a factor is no function.
        MeshError: There is no such group.
    """
    _check_list("loads", loads, "loads")
    for load in loads:
        check_kind_of("A load", load, offers(load, "patterns"), "Gravity, Traction or such")
        if hasattr(load, "group"):
            jointed.facets(load.group)
        factor = getattr(load, "factor", None)
        if factor is not None:
            check_function("factor", factor)


def _check_list(name: str, values: Any, of: str) -> None:
    check_kind_of(name, values, isinstance(values, list | tuple), f"a list of {of}")


def check_form(form: Any, arguments: int, what: str) -> None:
    """Refuse what is no UFL form with so many arguments.

    Raises:
        ValueError: It is not.
    """
    count = len(form.arguments()) if isinstance(form, ufl.Form) else 0
    if count != arguments:
        raise ValueError(f"{what}; this one has {count} arguments: {shown(form, str)}.")


def check_nodal(name: str, vector: Any, like: PETSc.Mat) -> None:
    """Refuse what is no vector of the model's unknowns (collective).

    Raises:
        ValueError: It is not.
    """
    wanted = like.getLocalSize()[0]
    fits = isinstance(vector, PETSc.Vec) and vector.handle != 0 and vector.getLocalSize() == wanted
    every: Sequence[bool] = like.comm.tompi4py().allgather(bool(fits))
    check_kind_of(name, vector, all(every), "a vector of the model's unknowns")
