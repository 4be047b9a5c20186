# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shape of an arch dam in formulas: circular arches of varying radius, thickness, position.

A point of the dam has the coordinates s in [-1, 1] across the valley (the abutments are s = -1 and
s = 1), ta in [0, 1] from the upstream to the downstream face, and zeta = z/height in [0, 1].
The axis x points downstream, y across the valley and z up.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Annotated

import annotated_types as at
import numpy as np
from numpy.typing import ArrayLike

from dolfinx_joints.common.declared import checked
from dolfinx_joints.geometry.meshing.arguments import Length
from dolfinx_joints.geometry.meshing.extrusion import FloatArray

HalfAngle = Annotated[float, at.Interval(gt=0, lt=90), at.Unit("degrees")]


class CircularArches(ABC):
    """Dam, or its half s >= 0, with circular horizontal sections about y = 0.

    Attributes:
        height: H [m].
    """

    height: float

    @abstractmethod
    def half_angle(self, zeta: ArrayLike) -> FloatArray:
        """Return phi, the angle from the crown to the abutment [radians]."""

    @abstractmethod
    def radius(self, zeta: ArrayLike) -> FloatArray:
        """Return R, the radius of the upstream face [m]."""

    @abstractmethod
    def thickness(self, zeta: ArrayLike, s: ArrayLike) -> FloatArray:
        """Return t, measured towards the centre of the upstream face [m]."""

    @abstractmethod
    def centre(self, zeta: ArrayLike) -> FloatArray:
        """Return the x coordinate of the centre of the upstream face [m]."""

    def point(self, s: ArrayLike, ta: ArrayLike, zeta: ArrayLike) -> FloatArray:
        """Return points (x, y, z), shape (..., 3), [m]; the arguments are broadcast."""
        r = self.radius(zeta) - np.asarray(ta) * self.thickness(zeta, s)
        alpha = np.asarray(s) * self.half_angle(zeta)
        x = self.centre(zeta) - r * np.cos(alpha)
        z = self.height * np.asarray(zeta)
        return np.stack(np.broadcast_arrays(x, r * np.sin(alpha), z), axis=-1)


@dataclass(frozen=True)
@checked
class ArchDam(CircularArches):
    """Arch dam with circular horizontal sections; the defaults resemble Ambiesta dam.

    At the relative height zeta the upstream face is an arc of half-angle phi and radius R. Its
    crown overhangs towards upstream by o, and the thickness is t:

        phi(zeta)  = phi_0 + (phi_1 - phi_0) zeta
        w(zeta)    = w_0 + (w_1 - w_0) zeta^n                       half-chord, R = w/sin(phi)
        t(zeta, s) = (t_0 + (t_1 - t_0) zeta) (1 + c (1 - d zeta) s^2)
        o(zeta)    = e H zeta (1 - f zeta)
        x = -o + R - (R - ta t) cos(s phi),   y = (R - ta t) sin(s phi),   z = H zeta

    The default height (57.0 m) and crest length (144.6 m) are published values of the dam. The
    other defaults are fitted to its published frequencies; they are not from drawings.

    Args:
        height: H, height of the crest above the base [m].
        base_half_angle: phi_0, half-angle of the arch at the base [degrees].
        crest_half_angle: phi_1, half-angle of the arch at the crest [degrees].
        base_half_chord: w_0, half-chord at the base [m].
        crest_half_chord: w_1, half-chord at the crest [m].
        chord_exponent: n, exponent of the chord; a smaller value makes a wider valley.
        base_thickness: t_0, thickness of the crown at the base [m].
        crest_thickness: t_1, thickness of the crown at the crest [m].
        thickening: c, relative increase of thickness from the crown to the abutments at the base.
        thickening_decay: d, relative decrease of ``thickening`` from base to crest.
        overhang: e, overhang of the crown relative to the height.
        overhang_return: f, decrease of the overhang; above 1/2 the crown leans downstream again
            near the crest.

    Raises:
        ValueError: if a number, or the thickness at some level, is out of range.
    """

    height: Length = 57.0
    base_half_angle: HalfAngle = 21.5
    crest_half_angle: HalfAngle = 50.0
    base_half_chord: Length = 12.0
    crest_half_chord: Length = 63.47
    chord_exponent: Annotated[float, at.Gt(0)] = 0.6
    base_thickness: Length = 9.0
    crest_thickness: Length = 2.0
    thickening: float = 0.3
    thickening_decay: float = 0.6
    overhang: float = 0.36
    overhang_return: float = 0.62

    def __post_init__(self) -> None:
        if self.crest_half_chord <= self.base_half_chord:
            raise ValueError(
                f"crest_half_chord is {self.crest_half_chord!r}, but it must be above "
                f"base_half_chord ({self.base_half_chord!r})."
            )
        zeta = np.linspace(0, 1, 51)[:, None]
        thickness = self.thickness(zeta, np.linspace(0, 1, 21))
        invalid = ~((thickness > 0) & (thickness < self.radius(zeta))).all(axis=1)
        if invalid.any():
            raise ValueError(
                f"The thickness of the dam is not between 0 and its radius at "
                f"{self.height * zeta[invalid][0, 0]:g} m above its base: choose other thicknesses."
            )

    @classmethod
    def of_crest(cls, length: float, **others: float) -> ArchDam:
        """Return the dam with a given length of the crest along its upstream edge.

        Args:
            length: length of the crest [m].
            others: parameters except ``crest_half_chord``, by name.

        Raises:
            ValueError: if a value is not allowed, or a parameter does not exist.
        """
        names = {field.name for field in fields(cls)} - {"crest_half_chord"}
        if unknown := sorted(set(others) - names):
            raise ValueError(f"{unknown[0]!r} is not one of {', '.join(sorted(names))}.")
        degrees = others.get("crest_half_angle", cls.crest_half_angle)
        return cls(crest_half_chord=0.5 * length * float(np.sinc(degrees / 180)), **others)

    @property
    def crest_length(self) -> float:
        """Length of the crest along its upstream edge [m]."""
        return float(2 * self.half_angle(1.0) * self.radius(1.0))

    def half_angle(self, zeta: ArrayLike) -> FloatArray:
        """Return phi [radians]."""
        z = np.asarray(zeta)
        return np.radians(self.base_half_angle + (self.crest_half_angle - self.base_half_angle) * z)

    def radius(self, zeta: ArrayLike) -> FloatArray:
        """Return R, the radius of the upstream face [m]."""
        growth = self.crest_half_chord - self.base_half_chord
        chord = self.base_half_chord + growth * np.asarray(zeta) ** self.chord_exponent
        return chord / np.sin(self.half_angle(zeta))

    def thickness(self, zeta: ArrayLike, s: ArrayLike) -> FloatArray:
        """Return t [m]."""
        z = np.asarray(zeta)
        crown = self.base_thickness + (self.crest_thickness - self.base_thickness) * z
        return crown * (1 + self.thickening * (1 - self.thickening_decay * z) * np.square(s))

    def centre(self, zeta: ArrayLike) -> FloatArray:
        """Return R - o, the x coordinate of the centre of the arch [m] (its y is 0)."""
        z = np.asarray(zeta)
        return self.radius(z) - self.overhang * self.height * z * (1 - self.overhang_return * z)


@dataclass(frozen=True)
class Sector:
    """Arch dam in coordinates about the vertical axis through the centre of its top arch.

    The angle theta about that axis, positive towards +y, replaces s: theta = constant is a vertical
    plane, radial at the top. The centre of an arch has the distance d(zeta) from the axis. With
    r = R - ta t, the angle alpha = s phi of the arch satisfies r sin(alpha - theta) = d sin(theta).

    Args:
        dam: the shape.
        top: relative height of the top of the body, 1 for the whole dam.
    """

    dam: CircularArches
    top: float = 1.0

    @property
    def axis(self) -> float:
        """Coordinate x of the axis [m] (y is 0)."""
        return float(self.dam.centre(self.top))

    @property
    def radius(self) -> float:
        """Radius of the upstream edge of the top [m]."""
        return float(self.dam.radius(self.top))

    @property
    def half_angle(self) -> float:
        """Angle theta at which the top meets the abutment [radians]."""
        return float(self.dam.half_angle(self.top))

    @cached_property
    def upright(self) -> bool:
        """True if the abutments are vertical, with the same angle theta at all heights."""
        zeta = np.linspace(0, self.top, 101)
        angles = self.abutment_angle(np.array([[0.0], [0.5], [1.0]]), zeta)
        return bool(np.ptp(angles) < 1e-9)

    def abutment_angle(self, ta: ArrayLike, zeta: ArrayLike) -> FloatArray:
        """Return the angle theta of the abutment s = 1 [radians]."""
        xyz = self.dam.point(1.0, ta, zeta)
        return np.arctan2(xyz[..., 1], self.axis - xyz[..., 0])

    def foundation(self, theta: ArrayLike, ta: ArrayLike) -> FloatArray:
        """Return the relative height of the lower end of the body in the plane theta.

        It is 0 if the plane meets the base, or if the abutments are upright. Otherwise it is the
        height of the abutment, from a bisection. As seen from the axis, the valley must therefore
        widen monotonically.

        Args:
            theta: angle about the axis, at most ``half_angle`` in absolute value [radians].
            ta: relative position between the faces; broadcast against theta.
        """
        angle, ta = np.broadcast_arrays(np.abs(theta), np.asarray(ta, dtype=float))
        if self.upright:
            return np.zeros(angle.shape)
        low, high = np.zeros(angle.shape), np.full(angle.shape, self.top)
        for _ in range(60):
            middle = 0.5 * (low + high)
            outside = self.abutment_angle(ta, middle) < angle
            low, high = np.where(outside, middle, low), np.where(outside, high, middle)
        level = np.where(angle <= self.abutment_angle(ta, 0.0), 0.0, 0.5 * (low + high))
        return np.where(angle >= self.half_angle, self.top, level)

    def across(self, theta: ArrayLike, ta: ArrayLike, zeta: ArrayLike) -> FloatArray:
        """Return the coordinate s of points given by their angle theta about the axis.

        This is a fixed-point iteration of alpha = theta + asin(d sin(theta)/r(alpha)). The
        thickness varies slowly with s, so each iteration gains one to two digits.
        """
        distance = self.axis - self.dam.centre(zeta)
        phi = self.dam.half_angle(zeta)
        s = np.zeros(np.broadcast_shapes(np.shape(theta), np.shape(ta), np.shape(zeta)))
        for _ in range(40):
            r = self.dam.radius(zeta) - np.asarray(ta) * self.dam.thickness(zeta, s)
            s = (theta + np.arcsin(np.clip(distance * np.sin(theta) / r, -1, 1))) / phi
        return s


def mid_crest(parameters: ArchDam | None = None) -> tuple[float, float, float]:
    """Return the upstream edge of the crest at the crown, (x, y, z) [m].

    Args:
        parameters: shape of the dam; None for the default.
    """
    x, y, z = (parameters or ArchDam()).point(0.0, 0.0, 1.0)
    return float(x), float(y), float(z)
