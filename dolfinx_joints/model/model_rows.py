# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A model in a screen of text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from dolfinx_joints.common.summary import Rows, names, number
from dolfinx_joints.loads.load import load_names


def model_rows(model: Any) -> Rows:
    """Unknowns, joints and laws, supports, loads and damping of a `Model`."""
    joints = model.jointed.joint_names
    degree = model.V.ufl_element().degree
    yield "unknowns", f"{number(model.num_dofs)} displacements, degree {degree}"
    yield "joints", f"{len(joints)}: {names(joints)}" if joints else "none"
    if model.contact is not None and model.operator is not None:
        kinds = dict.fromkeys(type(law).__name__ for law in model.contact.laws.values())
        yield "joint points", f"{number(model.operator.num_points)} of {names(kinds)}"
    yield "supports", names(_kinds(model.supports))
    yield "loads", names(load_names(model.loads))
    yield "added masses", names(_kinds(model.added_mass))
    if model.coupled is not None:
        unknowns = number(model.coupled.water.size)
        yield "reservoir", f"{names(_kinds([model.reservoir]))}, {unknowns} unknowns"
    alpha, beta = model.rayleigh.mass_factor, model.rayleigh.stiffness_factor
    terms = [f"{alpha:.4g} 1/s times M" if alpha else "", f"{beta:.4g} s times K" if beta else ""]
    if model.damped_modes is not None:
        terms.append(f"ratios of {model.damped_modes.asked.modes} modes")
    yield "damping", " + ".join(filter(None, terms))


def _kinds(every: Sequence[Any]) -> list[str]:
    """Kinds of objects with the groups that they act on."""
    groups = [getattr(each, "group", None) for each in every]
    kinds = [type(each).__name__ for each in every]
    return [kind + (f" ({g})" if g else "") for kind, g in zip(kinds, groups, strict=True)]
