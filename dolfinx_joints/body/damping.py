# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Constant viscous damping C = a M + b K of the bulk; joints are never damped by it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from dolfinx_joints.common.parameters import as_float, check_kind_of, check_number, hold_floats


@dataclass(frozen=True, kw_only=True)
class Rayleigh:
    """C = a M + b K with the bulk stiffness K alone.

    A mode of circular frequency omega gets the damping ratio a/(2 omega) + b omega/2.

    Attributes:
        mass_factor: a [1/s].
        stiffness_factor: b [s].

    Raises:
        ValueError: A factor is negative.
    """

    mass_factor: float = 0.0
    stiffness_factor: float = 0.0

    def __post_init__(self) -> None:
        """Check the factors."""
        hold_floats(self)
        for name in ("mass_factor", "stiffness_factor"):
            check_number(name, getattr(self, name), lambda v: v >= 0, "zero or more and finite")

    def ratio(self, frequency: float) -> float:
        """Damping ratio of a mode of the given frequency [Hz].

        Raises:
            ValueError: The frequency is not positive.
        """
        frequency = as_float(frequency)
        check_number("The frequency", frequency, lambda v: v > 0, "positive and finite", unit="Hz")
        omega = 2.0 * math.pi * frequency
        return self.mass_factor / (2.0 * omega) + self.stiffness_factor * omega / 2.0


def _checked(ratio: float, frequency: float) -> tuple[float, float]:
    """The ratio, and the angular frequency of a frequency [Hz], [rad/s]."""
    ratio, frequency = as_float(ratio), as_float(frequency)
    check_number("The damping ratio", ratio, lambda v: 0 <= v < 1, "at least 0 and below 1")
    check_number("The frequency", frequency, lambda v: v > 0, "positive and finite", unit="Hz")
    return ratio, 2.0 * math.pi * frequency


def stiffness_proportional(*, ratio: float, frequency: float) -> Rayleigh:
    """C = b K with a modal damping ratio at one frequency [Hz], as in the paper (2 % at 5 Hz).

    Raises:
        ValueError: The ratio or the frequency is out of its range.
    """
    zeta, omega = _checked(ratio, frequency)
    return Rayleigh(stiffness_factor=2.0 * zeta / omega)


def mass_proportional(*, ratio: float, frequency: float) -> Rayleigh:
    """C = a M with a modal damping ratio at one frequency [Hz].

    Raises:
        ValueError: The ratio or the frequency is out of its range.
    """
    zeta, omega = _checked(ratio, frequency)
    return Rayleigh(mass_factor=2.0 * zeta * omega)


def rayleigh(*, ratio: float | tuple[float, float], frequencies: tuple[float, float]) -> Rayleigh:
    """C = a M + b K with given damping ratios at two frequencies [Hz].

    Args:
        ratio: One ratio for both, or one for each.
        frequencies: The two frequencies [Hz].

    Raises:
        ValueError: A ratio or a frequency is out of its range, the frequencies are equal, or the
            ratios differ so much that a or b would be negative.
    """
    ratios, given = _pair(ratio, "ratio"), _pair(frequencies, "frequencies")
    one, two = (_checked(r, f)[1] for r, f in zip(ratios, given, strict=True))
    if one == two:
        raise ValueError(f"Both frequencies are {given[0]} Hz; they must differ.")
    # From (a / omega + b omega) / 2 = ratio at both.
    scale = 2.0 / ((two - one) * (two + one))
    b = scale * (ratios[1] * two - ratios[0] * one)
    a = scale * one * two * (ratios[0] * two - ratios[1] * one)
    smallest = -1e-14 * max(ratios)  # rounding where one of them is zero
    if b * max(one, two) < smallest or a / max(one, two) < smallest:
        share = min(given) / max(given)
        raise ValueError(
            f"ratio is {ratios} at {given} Hz, which needs a negative factor of "
            f"{'K' if b < 0 else 'M'}; the second over the first must be from {share:.4g} to "
            f"{1.0 / share:.4g} for these frequencies."
        )
    return Rayleigh(mass_factor=max(a, 0.0), stiffness_factor=max(b, 0.0))


def _pair(value: Any, name: str) -> tuple[Any, Any]:
    """Two values, or one for both where it is a ratio."""
    if name == "ratio" and not isinstance(value, list | tuple):
        return as_float(value), as_float(value)
    two = isinstance(value, list | tuple) and len(value) == 2
    wanted = "a number or a pair of numbers" if name == "ratio" else "a pair of numbers"
    check_kind_of(name, value, two, wanted)
    return as_float(value[0]), as_float(value[1])
