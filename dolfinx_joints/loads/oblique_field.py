# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plane wave at oblique incidence in a half space, with its reflections at the surface."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Any, Literal

import annotated_types as at
import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.parameters import number_at
from dolfinx_joints.loads.free_field import FreeField
from dolfinx_joints.loads.load import Load, LoadedBody, TimeFactor
from dolfinx_joints.loads.wave_levels import (
    LEVELS,
    Layer,
    check_groups,
    checked_base,
    extent_along,
    forces_of_levels,
    layers_along,
    without_rounding,
)
from dolfinx_joints.mesh.cells import Floats


@dataclass(frozen=True, kw_only=True)
class PlaneWave:
    """Velocity d v(t - s.x) in a half space z < 0: motion d, slowness s [s/m], incident wave v."""

    motion: Floats
    slowness: Floats

    def traction(self, rock: Layer, normal: Floats) -> Floats:
        """Return the traction per velocity, -(lambda (d.s) n + mu ((s.n) d + (d.n) s)) [Pa s/m]."""
        d, s = self.motion, self.slowness
        shear = rock.shear_modulus * ((s @ normal) * d + (d @ normal) * s)
        return np.asarray(-rock.first_lame * (d @ s) * normal - shear)


def plane_waves(kind: str, angle: float, azimuth: float, rock: Layer) -> list[PlaneWave]:
    """Return an incident P, SV or SH wave and its reflections at the free surface z = 0, (12ab).

    The angle is measured from the vertical to the ray, the azimuth from x towards y [rad].

    Raises:
        ValueError: An SV wave exceeds the critical angle, where no plane P wave is reflected.
    """
    h, z = np.array([np.cos(azimuth), np.sin(azimuth), 0.0]), np.array([0.0, 0.0, 1.0])
    fast, slow = rock.pressure_speed, rock.shear_speed
    p = np.sin(angle) / (fast if kind == "P" else slow)

    def slowness(speed: float, sign: float) -> Floats:
        """Return the slowness of a wave that rises (sign 1) or falls (sign -1)."""
        return np.asarray(p * h + sign * np.sqrt(1.0 / speed**2 - p**2) * z, dtype=np.float64)

    def wave(speed: float, sign: float, shear: bool) -> PlaneWave:
        s = slowness(speed, sign)
        # The horizontal motion of rising and falling S waves points forwards.
        across = sign * ((s @ z) * h - (s @ h) * z)
        return PlaneWave(motion=speed * (across if shear else s), slowness=s)

    if kind == "SH":
        sideways = np.cross(z, h)
        return [PlaneWave(motion=sideways, slowness=slowness(slow, sign)) for sign in (1.0, -1.0)]
    if p * fast >= 1.0:
        critical = np.rad2deg(np.arcsin(slow / fast))
        raise ValueError(
            f"ObliqueFreeField: angle_deg is {np.rad2deg(angle):g}; for an SV wave in this rock it "
            f"must be below the critical angle of {critical:.4g}, above which no plane P wave is "
            "reflected."
        )
    incident = wave(fast, 1.0, False) if kind == "P" else wave(slow, 1.0, True)
    reflected = [wave(fast, -1.0, False), wave(slow, -1.0, True)]
    in_plane = np.stack([h, z])
    tractions = np.column_stack([in_plane @ wave.traction(rock, z) for wave in reflected])
    sizes = np.linalg.solve(tractions, -in_plane @ incident.traction(rock, z))
    pairs = zip(sizes, reflected, strict=True)
    return [incident, *(replace(wave, motion=size * wave.motion) for size, wave in pairs)]


@dataclass(frozen=True, kw_only=True)
@checked
class ObliqueFreeField:
    """Plane wave at oblique incidence that is reflected at the horizontal ground surface.

    It acts like `FreeField`, in rock of one material. P and SV waves are reflected as P and SV.

    Attributes:
        groups: Names of facet groups with a viscous boundary: the bottom and all sides.
        wave: ``P``: motion along the ray. ``SV``: motion normal to the ray in its vertical plane,
            positive forwards. ``SH``: horizontal, positive to the left of the ray; not in 2-D.
        angle_deg: Angle between ray and vertical [degrees]; for SV below the critical angle.
        azimuth_deg: Azimuth of the ray, from x counterclockwise [degrees]; in 2-D 0 or 180.
        incident: Velocity [m/s] of the incident wave at a time [s], at the point of the groups that
            the wave reaches first; must be zero before time zero.
        surface: Height of the ground surface, a coordinate along z (y in 2-D) [m].
        highest_frequency: Highest frequency for which delays along the boundary are resolved [Hz].
    """

    groups: Annotated[Sequence[str], at.MinLen(1)]
    wave: Literal["P", "SV", "SH"]
    angle_deg: Annotated[float, at.Interval(ge=0.0, lt=90.0)]
    incident: Callable[[float], float]
    surface: Annotated[float, at.Unit("m")]
    azimuth_deg: float = 0.0
    highest_frequency: Annotated[float, at.Gt(0), at.Unit("Hz")] = 25.0

    def __post_init__(self) -> None:
        check_groups("ObliqueFreeField", self.groups)

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Return the forces of each plane wave at each phase level (collective)."""
        velocity = self._velocity()
        spacing = 1.0 / (LEVELS * self.highest_frequency)
        patterns: list[tuple[PETSc.Vec, TimeFactor]] = []
        for motion, slowness, start in self._waves(model):
            forces = forces_of_levels(model, self.groups, motion, slowness, spacing, start=start)
            patterns += [(force, _delayed(velocity, delay)) for delay, force in forces]
        return without_rounding(patterns)

    def surface_velocity(self, model: LoadedBody) -> Callable[[float], Floats]:
        """Return the free-field velocity of the surface, (3,) at a time [s], [m/s] (collective).

        The surface point is above the middle of the groups.
        """
        waves, velocity = self._waves(model), self._velocity()
        middle = [np.mean(extent_along(model, self.groups, axis)) for axis in np.eye(model.gdim)]
        place = np.array([*middle[:-1], self.surface])

        def surface(time: float) -> Floats:
            result = np.zeros(3)
            for motion, slowness, start in waves:
                result[: model.gdim] += velocity(time - slowness @ place + start) * motion
            return result

        return surface

    def _waves(self, model: LoadedBody) -> list[tuple[Floats, Floats, float]]:
        """Return motion, slowness and phase of zero delay for each wave (collective)."""
        name = "ObliqueFreeField"
        base = checked_base(name, model, self.groups, self.surface, None)
        layers = layers_along(name, model, self.groups, base, self.surface)
        if len(layers) > 1:
            raise ValueError(
                f"{name}: the rock along {', '.join(self.groups)} has {len(layers)} layers; it "
                "must be one material."
            )
        flat = model.gdim == 2
        if flat and (self.wave == "SH" or self.azimuth_deg not in (0.0, 180.0)):
            raise ValueError(
                f"{name}: wave is {self.wave} and azimuth_deg {self.azimuth_deg:g}; in 2-D, wave "
                "must be P or SV and azimuth_deg 0 or 180."
            )
        angle, azimuth = np.deg2rad([self.angle_deg, self.azimuth_deg])
        axes = [0, 2] if flat else [0, 1, 2]
        waves = plane_waves(self.wave, angle, azimuth, layers[0])
        incident = waves[0].slowness
        first, _ = extent_along(model, self.groups, incident[axes])
        return [
            (
                wave.motion[axes],
                wave.slowness[axes],
                # At the surface, reflected waves have the phase of the incident wave.
                first + (wave.slowness - incident)[2] * self.surface,
            )
            for wave in waves
        ]

    def _velocity(self) -> Callable[[float], float]:
        """Return the velocity function of the incident wave, which checks and caches its values."""
        name = "ObliqueFreeField: incident"
        velocity = lru_cache(maxsize=512)(lambda t: number_at(name, self.incident, t, unit="m/s"))
        velocity(0.0)
        return velocity


# Loads that prescribe the ground motion as an incident wave.
Waves = FreeField | ObliqueFreeField


def rising_waves(loads: Sequence[Load]) -> list[Waves]:
    """Return the loads that are incident waves."""
    return [load for load in loads if isinstance(load, Waves)]


def _delayed(velocity: Callable[[float], Any], delay: float) -> TimeFactor:
    return lambda time: float(velocity(time - delay))
