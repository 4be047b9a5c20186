# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Constant viscous damping C = a M + b K of the bulk; joints are never damped by it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dolfinx_joints.checks import check_number


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
        for name in ("mass_factor", "stiffness_factor"):
            check_number(name, getattr(self, name), lambda v: v >= 0, "zero or more and finite")

    def ratio(self, frequency: float) -> float:
        """Damping ratio of a mode of the given frequency [Hz]."""
        omega = 2.0 * math.pi * frequency
        return self.mass_factor / (2.0 * omega) + self.stiffness_factor * omega / 2.0


def _checked(ratio: float, *frequencies: float) -> list[float]:
    check_number("The damping ratio", ratio, lambda v: 0 <= v < 1, "at least 0 and below 1")
    for value in frequencies:
        check_number("The frequency", value, lambda v: v > 0, "positive and finite", unit="Hz")
    return [2.0 * math.pi * frequency for frequency in frequencies]


def stiffness_proportional(*, ratio: float, frequency: float) -> Rayleigh:
    """C = b K with a modal damping ratio at one frequency [Hz], as in the paper (2 % at 5 Hz).

    Raises:
        ValueError: The ratio or the frequency is out of its range.
    """
    (omega,) = _checked(ratio, frequency)
    return Rayleigh(stiffness_factor=2.0 * ratio / omega)


def mass_proportional(*, ratio: float, frequency: float) -> Rayleigh:
    """C = a M with a modal damping ratio at one frequency [Hz].

    Raises:
        ValueError: The ratio or the frequency is out of its range.
    """
    (omega,) = _checked(ratio, frequency)
    return Rayleigh(mass_factor=2.0 * ratio * omega)


def rayleigh(*, ratio: float, frequencies: tuple[float, float]) -> Rayleigh:
    """C = a M + b K with one damping ratio at two frequencies [Hz].

    Raises:
        ValueError: The ratio or a frequency is out of its range, or the frequencies are equal.
    """
    one, two = _checked(ratio, *frequencies)
    if one == two:
        raise ValueError(f"Both frequencies are {frequencies[0]} Hz; they must differ.")
    return Rayleigh(
        mass_factor=2.0 * ratio * one * two / (one + two),
        stiffness_factor=2.0 * ratio / (one + two),
    )
