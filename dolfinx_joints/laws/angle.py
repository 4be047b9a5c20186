# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction parameter of a law, given as an angle or as a coefficient."""

from __future__ import annotations

import math
from typing import Any


def set_friction(law: Any) -> tuple[float, float]:
    """Return friction coefficient and angle [degrees] of a law; set the parameter that is missing.

    Both parameters may be given if they agree, because ``dataclasses.replace`` passes both.

    Raises:
        ValueError: Both are missing, or they contradict each other.
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
    """Return the friction coefficient of a law after `set_friction`."""
    return law.friction_coefficient


def cosine_and_sine(angle_deg: float) -> tuple[float, float]:
    """Return cosine and sine of an angle in [0, 90] degrees, with cos(90) exactly zero."""
    angle = math.radians(angle_deg)
    return (0.0, 1.0) if angle_deg == 90.0 else (math.cos(angle), math.sin(angle))
