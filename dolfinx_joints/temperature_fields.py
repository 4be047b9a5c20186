# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Temperatures in a body from those of its faces: steady, and over the year.

Steady: div grad T = 0. Over the year, T = T_m + T_c cos(w t) + T_s sin(w t) with w of one year and
the diffusivity kappa,

    w T_s = kappa div grad T_c,   -w T_c = kappa div grad T_s,

so that a body takes part in the season as far as its thickness lets it. Nothing flows through
faces without a given temperature, nor from block to block through a joint.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import ufl
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.checks import check_kind_of, check_number
from dolfinx_joints.parallel import raised_together
from dolfinx_joints.thermal import Temperature

if TYPE_CHECKING:
    from dolfinx_joints.mesh import JointedMesh

Floats = NDArray[np.float64]
Parts = tuple[Floats, Floats, Floats]

DAY = 86400.0  # s
YEAR = 365.25 * DAY
MONTH = YEAR / 12.0
FREQUENCY = 2.0 * math.pi / YEAR  # rad/s

# A field of ones that is met worse than this belongs to a block without a given temperature.
ISOLATED = 1e-6


@dataclass(frozen=True, kw_only=True)
class AnnualWave:
    """A temperature that swings with the seasons, such as that of the air.

    Attributes:
        mean: Over the year [degrees C].
        amplitude: Half of what lies between summer and winter, not negative [K].
        warmest_day: Day of the year at which it is highest, 0 being its first.

    Raises:
        ValueError: A parameter is out of its range.
    """

    mean: float
    amplitude: float
    warmest_day: float = 201.0

    def __post_init__(self) -> None:
        """Check the parameters."""
        check_number("AnnualWave: mean", self.mean, lambda _: True, "finite")
        check_number("AnnualWave: amplitude", self.amplitude, lambda v: v >= 0, "zero or more")
        _check_day("AnnualWave: warmest_day", self.warmest_day)

    def parts(self, points: Floats, day: float) -> Parts:
        """Mean, cosine and sine parts at points (n, 3) [m], each (n,), t = 0 being a day."""
        ones = np.ones(len(points))
        return _swing(self.mean * ones, self.amplitude * ones, 0.0 * ones, self.warmest_day - day)


@dataclass(frozen=True, kw_only=True)
class ReservoirTemperature:
    """Water below a level, air above it; deep reservoirs after Zhu (1997).

    At a depth y the mean is c + (m - c) exp(-0.04 y), the amplitude A exp(-0.018 y), and the water
    is warmest 2.15 - 1.30 exp(-0.085 y) months after the air, y in m.

    Attributes:
        level: Height of the surface along the last axis [m].
        air: The air above it.
        surface_mean: m, of the water at the surface over the year [degrees C].
        surface_amplitude: A, there [K].
        deep_mean: c, of the water far below [degrees C].

    Raises:
        ValueError: A parameter is out of its range.
    """

    level: float
    air: AnnualWave
    surface_mean: float
    surface_amplitude: float
    deep_mean: float

    def __post_init__(self) -> None:
        """Check the parameters."""
        for name in ("level", "surface_mean", "deep_mean"):
            value = getattr(self, name)
            check_number(f"ReservoirTemperature: {name}", value, lambda _: True, "finite")
        amplitude = self.surface_amplitude
        what = "ReservoirTemperature: surface_amplitude"
        check_number(what, amplitude, lambda v: v >= 0, "zero or more", unit="K")
        good = isinstance(self.air, AnnualWave)
        check_kind_of("ReservoirTemperature: air", self.air, good, "an AnnualWave")

    def parts(self, points: Floats, day: float) -> Parts:
        """Mean, cosine and sine parts at points (n, gdim) [m], each (n,), t = 0 being a day."""
        depth = self.level - points[:, -1]
        y = np.maximum(depth, 0.0)
        mean = self.deep_mean + (self.surface_mean - self.deep_mean) * np.exp(-0.04 * y)
        amplitude = self.surface_amplitude * np.exp(-0.018 * y)
        lag = (2.15 - 1.30 * np.exp(-0.085 * y)) * MONTH / DAY
        water = _swing(mean, amplitude, lag, self.air.warmest_day - day)
        dry = self.air.parts(points, day)
        mean, cosine, sine = (
            np.where(depth > 0.0, w, a) for w, a in zip(water, dry, strict=True)
        )
        return mean, cosine, sine


Face = float | Callable[[Floats], Floats] | AnnualWave | ReservoirTemperature


def steady_temperature(jointed: JointedMesh, faces: Mapping[str, Face]) -> Any:
    """Temperature of a body whose faces have kept theirs for long (collective).

    Args:
        jointed: The mesh.
        faces: Temperature of each facet group that has one: a number, or a function of points
            (n, gdim) [m] that gives (n,); of what swings with the seasons the mean counts. Where
            groups meet the later one goes before.

    Returns:
        A DOLFINx function of the degree of the mesh, a `Temperature.value` [degrees C].

    Raises:
        ValueError: No face is given, a value is not finite, or a block has no such face.
        MeshError: There is no such group.
    """
    (mean,) = _solve(jointed, faces, 0.0, [lambda parts: parts[0][:, None]], diffusivity=None)
    return mean


def seasonal_temperatures(
    jointed: JointedMesh,
    faces: Mapping[str, Face],
    *,
    reference: float | Mapping[str, float],
    expansion: float,
    diffusivity: float = 1e-6,
    day: float = 15.0,
) -> list[Temperature]:
    """Loads of a body that follows the seasons, mean and swing (collective).

    Args:
        jointed: The mesh. Cells should resolve sqrt(2 kappa / w), 3.2 m by default.
        faces: As in `steady_temperature`, `AnnualWave` and `ReservoirTemperature` with their swing.
        reference: Temperature at which the joints were closed, or one per cell group [degrees C].
        expansion: Coefficient of linear thermal expansion [1/K].
        diffusivity: kappa [m^2/s].
        day: Day of the year at t = 0.

    Returns:
        Three loads, for `Model`: the mean less the reference, and the swing's cosine and sine.

    Raises:
        ValueError: A parameter is out of its range, or as in `steady_temperature`.
        MeshError: There is no such group.
    """
    check_number("diffusivity", diffusivity, lambda v: v > 0, "positive", unit="m^2/s")
    _check_day("day", day)
    mean = _solve(jointed, faces, day, [lambda p: p[0][:, None]], diffusivity=None)[0]
    swing = [lambda p: np.column_stack([p[1], p[2]])]
    cosine, sine = _solve(jointed, faces, day, swing, diffusivity=diffusivity)[0].split()
    return [
        Temperature(value=mean, reference=reference, expansion=expansion),
        Temperature(value=cosine, reference=0.0, expansion=expansion, factor=_cosine),
        Temperature(value=sine, reference=0.0, expansion=expansion, factor=_sine),
    ]
