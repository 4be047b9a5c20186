# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction of a law, given as an angle or as a coefficient."""

from __future__ import annotations

import math
from typing import Any


def set_friction(law: Any) -> tuple[float, float]:
    """Coefficient and angle [degrees] of a law that was given one of them; the other is set.

    Both are taken where they agree, as ``dataclasses.replace`` gives them.

    Raises:
        ValueError: Both are missing, or contradict each other.
    """
    angle, mu, name = law.friction_angle_deg, law.friction_coefficient, type(law).__name__
    if angle is None and mu is None:
        raise ValueError(
            f"{name}: friction_angle_deg and friction_coefficient are both None; give one of them."
        )
    if angle is None:
        angle = math.degrees(math.atan(mu))
        object.__setattr__(law, "friction_angle_deg", angle)
    if mu is None:
        mu = math.tan(math.radians(angle))
        object.__setattr__(law, "friction_coefficient", mu)
    if not math.isclose(angle, math.degrees(math.atan(mu)), rel_tol=1e-9):
        raise ValueError(
            f"{name}: friction_angle_deg is {angle:g} degrees and friction_coefficient is {mu:g}; "
            "give one of them, and None for the other."
        )
    return mu, angle


def coefficient_of(law: Any) -> float:
    """Coefficient of friction of a law that has taken its friction."""
    return float(law.friction_coefficient)


def cosine_and_sine(angle_deg: float) -> tuple[float, float]:
    """Of an angle from zero to 90 degrees, where the cosine is zero."""
    angle = math.radians(angle_deg)
    return (0.0, 1.0) if angle_deg == 90.0 else (math.cos(angle), math.sin(angle))
