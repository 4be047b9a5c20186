# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A plane wave that rises obliquely through a half space, and its reflections at the surface."""

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
from dolfinx_joints.loads.load import Load, TimeFactor
from dolfinx_joints.loads.loaded_body import LoadedBody
from dolfinx_joints.loads.rock import Layer, layers_along
from dolfinx_joints.loads.wave_levels import (
    LEVELS,
    check_groups,
    checked_base,
    extent_along,
    forces_of_levels,
    that_act,
)
from dolfinx_joints.mesh.cells import Floats


@dataclass(frozen=True, kw_only=True)
class PlaneWave:
    """Velocity d v(t - s.x) in a half space below z = 0, of an incident velocity v; s is in s/m."""

    motion: Floats
    slowness: Floats

    def traction(self, rock: Layer, normal: Floats) -> Floats:
        """Of a unit velocity on a plane, -(lambda (d.s) n + mu ((s.n) d + (d.n) s)) [Pa s/m]."""
        d, s = self.motion, self.slowness
        shear = rock.shear_modulus * ((s @ normal) * d + (d @ normal) * s)
        return np.asarray(-rock.first_lame * (d @ s) * normal - shear)


def plane_waves(kind: str, angle: float, azimuth: float, rock: Layer) -> list[PlaneWave]:
    """The incident P, SV or SH wave and those that the free surface z = 0 reflects, (12ab).

    The ray is at an angle with the vertical, its horizontal way at one from x to y [rad].

    Raises:
        ValueError: An SV wave arrives beyond the critical angle, where its P wave does not leave.
    """
    h, z = np.array([np.cos(azimuth), np.sin(azimuth), 0.0]), np.array([0.0, 0.0, 1.0])
    fast, slow = rock.pressure_speed, rock.shear_speed
    p = np.sin(angle) / (fast if kind == "P" else slow)

    def slowness(speed: float, way: float) -> Floats:
        """That of a wave that rises (way 1) or falls (-1)."""
        return np.asarray(p * h + way * np.sqrt(1.0 / speed**2 - p**2) * z, dtype=np.float64)

    def wave(speed: float, way: float, shear: bool) -> PlaneWave:
        s = slowness(speed, way)
        # S waves that rise and those that fall move forwards.
        across = way * ((s @ z) * h - (s @ h) * z)
        return PlaneWave(motion=speed * (across if shear else s), slowness=s)

    if kind == "SH":
        left = np.cross(z, h)
        return [PlaneWave(motion=left, slowness=slowness(slow, way)) for way in (1.0, -1.0)]
    if p * fast >= 1.0:
        critical = np.rad2deg(np.arcsin(slow / fast))
        raise ValueError(
            f"ObliqueFreeField: angle_deg is {np.rad2deg(angle):g}; of an SV wave in this rock it "
            f"must be below {critical:.4g}, beyond which no plane P wave is reflected."
        )
    incident = wave(fast, 1.0, False) if kind == "P" else wave(slow, 1.0, True)
    reflected = [wave(fast, -1.0, False), wave(slow, -1.0, True)]
    in_plane = np.stack([h, z])
    tractions = np.column_stack([in_plane @ each.traction(rock, z) for each in reflected])
    sizes = np.linalg.solve(tractions, -in_plane @ incident.traction(rock, z))
    pairs = zip(sizes, reflected, strict=True)
    return [incident, *(replace(each, motion=size * each.motion) for size, each in pairs)]


@dataclass(frozen=True, kw_only=True)
@checked
class ObliqueFreeField:
    """A plane wave that rises obliquely through rock and is reflected at its level surface.

    As `FreeField`, for a half space of one material; P and SV waves come back as both.

    Attributes:
        groups: Names of facet groups with a viscous boundary: the bottom, and all sides.
        wave: ``P``, moving along its ray; ``SV`` across it in the vertical plane of the ray,
            forwards; ``SH`` horizontally, to the left of the way. The plane has no SH.
        angle_deg: Angle of the ray with the vertical [degrees]; of SV below the critical one.
        azimuth_deg: Of its horizontal way, from x counterclockwise [degrees]; in the plane 0 or
            180.
        incident: Velocity of the incident wave at a time [s] where it first reaches the groups,
            zero until time zero, [m/s].
        surface: Height of the level ground, a coordinate along z (y in 2-D) [m].
        highest_frequency: Up to which delays between levels are resolved [Hz].
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
        """Tractions by level of phase, those of each plane wave (collective)."""
        velocity = self._velocity()
        spacing = 1.0 / (LEVELS * self.highest_frequency)
        found: list[tuple[PETSc.Vec, TimeFactor]] = []
        for motion, slowness, start in self._waves(model):
            forces = forces_of_levels(model, self.groups, motion, slowness, spacing, start=start)
            found += [(force, _delayed(velocity, late)) for late, force in forces]
        return that_act(found)

    def surface_velocity(self, model: LoadedBody) -> Callable[[float], Floats]:
        """Velocity of the level surface above the middle of the groups that nothing stands on.

        Shape (3,) at a time [s], [m/s] (collective).
        """
        waves, velocity = self._waves(model), self._velocity()
        middle = [np.mean(extent_along(model, self.groups, axis)) for axis in np.eye(model.gdim)]
        place = np.array([*middle[:-1], self.surface])

        def surface(time: float) -> Floats:
            found = np.zeros(3)
            for motion, slowness, start in waves:
                found[: model.gdim] += velocity(time - slowness @ place + start) * motion
            return found

        return surface

    def _waves(self, model: LoadedBody) -> list[tuple[Floats, Floats, float]]:
        """Motion, slowness and the phase without delay of each wave (collective)."""
        name = "ObliqueFreeField"
        base = checked_base(name, model, self.groups, self.surface, None)
        layers = layers_along(name, model, self.groups, base, self.surface)
        if len(layers) > 1:
            raise ValueError(
                f"{name}: the rock along {', '.join(self.groups)} has {len(layers)} layers; it "
                "must be of one material."
            )
        flat = model.gdim == 2
        if flat and (self.wave == "SH" or self.azimuth_deg not in (0.0, 180.0)):
            raise ValueError(
                f"{name}: wave is {self.wave} and azimuth_deg {self.azimuth_deg:g}; in the plane "
                "waves are P or SV with an azimuth of 0 or 180."
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
                # All waves have the same phase at the surface.
                first + (wave.slowness - incident)[2] * self.surface,
            )
            for wave in waves
        ]

    def _velocity(self) -> Callable[[float], float]:
        """Velocity of the incident wave, numbers only."""
        name = "ObliqueFreeField: incident"
        velocity = lru_cache(maxsize=512)(lambda t: number_at(name, self.incident, t, unit="m/s"))
        velocity(0.0)
        return velocity


# Loads that move the ground themselves.
Waves = FreeField | ObliqueFreeField


def rising_waves(loads: Sequence[Load]) -> list[Waves]:
    """The loads that are waves in the ground."""
    return [load for load in loads if isinstance(load, Waves)]


def _delayed(velocity: Callable[[float], Any], delay: float) -> TimeFactor:
    return lambda time: float(velocity(time - delay))
