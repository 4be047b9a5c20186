# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint laws whose strength is divided by a factor, for factors of safety (31c) of docs/theory."""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass, replace
from typing import Any

from dolfinx_joints.laws.law import AnyLaw

# Parameters that are divided, and friction angles whose tangent is divided.
STRENGTHS = ("friction_coefficient", "cohesion", "adhesion", "tensile_strength", "tooth_cohesion")
ANGLES = ("tooth_friction_angle_deg",)


def divided(law: AnyLaw, factor: float) -> AnyLaw:
    """Return a law with tan(phi), cohesion, adhesion and tensile strength divided by a factor F.

    Stiffnesses, fracture energies and shapes do not change. The dilatancy angle is at most the
    reduced friction angle, and f_t at most c / tan(phi), which a factor below 1 may exceed.

    Raises:
        ValueError: The law has no parameter of strength.
    """
    inner = getattr(law, "law", None)  # A law with dashpots contains another law.
    if inner is not None and is_dataclass(law) and not isinstance(law, type):
        return replace(law, law=divided(inner, factor))
    names = [f.name for f in fields(law)] if is_dataclass(law) else []
    given = {name: getattr(law, name) for name in names}
    changed: dict[str, Any] = {n: given[n] / factor for n in STRENGTHS if given.get(n)}
    for name in ANGLES:
        if given.get(name):
            tangent = math.tan(math.radians(given[name])) / factor
            changed[name] = math.degrees(math.atan(tangent))
    if not {*STRENGTHS, *ANGLES} & {*names}:
        raise ValueError(
            f"{type(law).__name__} has no strength that can be divided; choose joints whose laws "
            f"have one of these parameters: {', '.join((*STRENGTHS, *ANGLES))}."
        )
    if mu := changed.get("friction_coefficient"):
        changed["friction_angle_deg"] = None
        if given.get("dilatancy_angle_deg"):
            reduced = math.degrees(math.atan(mu))
            changed["dilatancy_angle_deg"] = min(given["dilatancy_angle_deg"], reduced)
        if "tensile_strength" in changed:
            limit = changed.get("cohesion", 0.0) / mu
            changed["tensile_strength"] = min(changed["tensile_strength"], limit)
    return replace(law, **changed)  # type: ignore[type-var]
