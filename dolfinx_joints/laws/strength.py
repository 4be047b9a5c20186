# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint laws with divided strength, for factors of safety."""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass, replace
from typing import Any

# Parameters that are divided by F; friction angles follow the coefficient.
STRENGTHS = ("friction_coefficient", "cohesion", "adhesion", "tensile_strength", "tooth_cohesion")
# Parameters that are divided by F^2, so that a bond does not gain at the same load R.
ENERGIES = ("fracture_energy", "shear_fracture_energy")


def divided(law: Any, factor: float, joint: str) -> Any:
    """Return the law of a joint with its strength divided by a factor (31c).

    The dilatancy angle is at most the new friction angle, f_t at most c / tan(phi).

    Raises:
        ValueError: The law has no parameter of strength.
    """
    if hasattr(law, "law"):  # A law with dashpots contains another law.
        return replace(law, law=divided(law.law, factor, joint))
    names = [f.name for f in fields(law)] if is_dataclass(law) else []
    given = {name: getattr(law, name) for name in names}
    if not given.keys() & {*STRENGTHS}:
        raise ValueError(
            f"Joint {joint!r}: {type(law).__name__} has no strength that can be divided; choose "
            f"joints whose laws have one of these parameters: {', '.join(STRENGTHS)}."
        )
    changed = {name: given[name] / factor for name in STRENGTHS if name in given}
    changed |= {name: given[name] / factor**2 for name in ENERGIES if name in given}
    if mu := changed.get("friction_coefficient"):
        changed["friction_angle_deg"] = angle = math.degrees(math.atan(mu))
        if "dilatancy_angle_deg" in given:
            changed["dilatancy_angle_deg"] = min(given["dilatancy_angle_deg"], angle)
            limit = changed["cohesion"] / mu
            changed["tensile_strength"] = min(changed["tensile_strength"], limit)
    if given.get("tooth_friction_angle_deg"):
        mu = math.tan(math.radians(given["tooth_friction_angle_deg"])) / factor
        changed["tooth_friction_angle_deg"] = math.degrees(math.atan(mu))
    return replace(law, **changed)
