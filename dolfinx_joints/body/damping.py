# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Viscous damping of the bulk: Rayleigh damping C = a M + b K, and modal damping ratios."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated

import annotated_types as at
import numpy as np

from dolfinx_joints.common.declared import checked

Ratio = Annotated[float, at.Interval(ge=0, lt=1)]
Frequency = Annotated[float, at.Gt(0), at.Unit("Hz")]


@dataclass(frozen=True, kw_only=True)
@checked
class Rayleigh:
    """Rayleigh damping C = a M + b K with the bulk stiffness K without joints.

    The damping ratio of a mode of circular frequency omega is a/(2 omega) + b omega/2.

    Attributes:
        mass_factor: a [1/s].
        stiffness_factor: b [s].
    """

    mass_factor: Annotated[float, at.Ge(0), at.Unit("1/s")] = 0.0
    stiffness_factor: Annotated[float, at.Ge(0), at.Unit("s")] = 0.0

    @checked
    def ratio(self, frequency: Frequency) -> float:
        """Return the damping ratio of a mode of the given frequency [Hz]."""
        omega = 2.0 * math.pi * frequency
        return self.mass_factor / (2.0 * omega) + self.stiffness_factor * omega / 2.0


@dataclass(frozen=True, kw_only=True)
@checked
class ModalRatios:
    """Damping ratios of the lowest modes with closed joints: C = M Phi diag(c) Phi^T M, (34a).

    Method of Wilson and Penzien (1972). Higher modes have only the damping ``beyond``. In the
    lowest modes the ratio includes ``beyond``. Absorbing boundaries add further damping.

    Attributes:
        ratio: One damping ratio for the lowest modes, or one per mode, lowest first.
        modes: Number of modes.
        beyond: Rayleigh damping of the whole body.
    """

    ratio: Ratio | Sequence[float]
    modes: Annotated[int, at.Ge(1)]
    beyond: Rayleigh = field(default_factory=Rayleigh)

    def __post_init__(self) -> None:
        if np.ndim(self.ratio) and len(np.asarray(self.ratio)) != self.modes:
            raise ValueError(
                f"ModalRatios: ratio has {len(np.asarray(self.ratio))} values for {self.modes} "
                "modes; give one value for all modes or one per mode."
            )


@checked
def stiffness_proportional(*, ratio: Ratio, frequency: Frequency) -> Rayleigh:
    """Return C = b K of a damping ratio at one frequency [Hz], in the paper 2 % at 5 Hz.

    Example:
        >>> import dolfinx_joints as dj
        >>> damping = dj.stiffness_proportional(ratio=0.02, frequency=5.0)
        >>> round(damping.ratio(10.0), 6)  # twice the ratio at twice the frequency
        0.04
    """
    return Rayleigh(stiffness_factor=2.0 * ratio / (2.0 * math.pi * frequency))


@checked
def mass_proportional(*, ratio: Ratio, frequency: Frequency) -> Rayleigh:
    """Return C = a M of a damping ratio at one frequency [Hz]."""
    return Rayleigh(mass_factor=2.0 * ratio * (2.0 * math.pi * frequency))


@checked
def rayleigh(
    *,
    ratio: Ratio | tuple[float, float],
    frequencies: Annotated[tuple[float, float], at.Gt(0), at.Unit("Hz")],
) -> Rayleigh:
    """Return C = a M + b K of damping ratios at two frequencies [Hz].

    Args:
        ratio: One ratio for both frequencies, or one per frequency.
        frequencies: The two frequencies [Hz].

    Raises:
        ValueError: The frequencies are equal, or a or b would be negative.

    Example:
        >>> import dolfinx_joints as dj
        >>> damping = dj.rayleigh(ratio=0.05, frequencies=(4.0, 16.0))
        >>> [round(damping.ratio(f), 6) for f in (4.0, 8.0, 16.0)]  # smallest at 8 Hz
        [0.05, 0.04, 0.05]
    """
    first, second = (float(value) for value in np.broadcast_to(ratio, 2))
    one, two = (2.0 * math.pi * frequency for frequency in frequencies)
    if one == two:
        raise ValueError(f"Both frequencies are {frequencies[0]} Hz; they must differ.")
    # Solve (a / omega + b omega) / 2 = ratio at both frequencies.
    scale = 2.0 / ((two - one) * (two + one))
    b = scale * (second * two - first * one)
    a = scale * one * two * (first * two - second * one)
    smallest = -1e-14 * max(first, second)  # rounding error if a or b is zero
    if b * max(one, two) < smallest or a / max(one, two) < smallest:
        share = min(frequencies) / max(frequencies)
        raise ValueError(
            f"Damping ratios {first, second} at {frequencies} Hz require a negative factor of "
            f"{'K' if b < 0 else 'M'}; the second ratio divided by the first must be between "
            f"{share:.4g} and {1.0 / share:.4g} for these frequencies."
        )
    return Rayleigh(mass_factor=max(a, 0.0), stiffness_factor=max(b, 0.0))
