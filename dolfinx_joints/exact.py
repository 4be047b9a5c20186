# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Exact solutions of small contact and friction problems, for verification."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import annotated_types as at
import numpy as np
from numpy.typing import ArrayLike

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.declared import checked

Positive = Annotated[float, at.Gt(0)]
NotNegative = Annotated[float, at.Ge(0)]
Dip = Annotated[float, at.Interval(ge=0, le=90), at.Unit("degrees")]
Azimuth = Annotated[float, at.Unit("degrees")]


@dataclass(frozen=True, kw_only=True)
@checked
class ImpactOscillator:
    """Mass on a spring that repeatedly strikes an elastic stop.

    m u'' + k u + k_stop <u - gap> = 0,  u(0) = 0,  u'(0) = v0 > 0,  <x> = max(x, 0)

    The motion is periodic. It has two harmonic phases, which meet at u = gap with equal velocity,
    v1 = sqrt(v0^2 - omega^2 gap^2):

    - In flight, u = (v0/omega) sin(omega t) with omega = sqrt(k/m). A flight lasts
      (pi + 2 asin(omega gap/v0)) / omega.
    - In contact, at a time s after its start, u = u_e + (gap - u_e) cos(w s) + (v1/w) sin(w s) with
      u_e = k_stop gap / (k + k_stop) and w = sqrt((k + k_stop)/m). A contact lasts
      (2/w) atan2(v1/w, gap - u_e).

    Attributes:
        mass: m [kg].
        stiffness: k of the spring [N/m].
        stop_stiffness: k_stop [N/m].
        initial_velocity: v0 [m/s].
        gap: Distance of the stop from the mass at u = 0; less than the amplitude [m].
    """

    mass: Positive
    stiffness: Positive
    stop_stiffness: Positive
    initial_velocity: Positive
    gap: Annotated[float, at.Ge(0)] = 0.0

    def __post_init__(self) -> None:
        if self.frequency * self.gap >= self.initial_velocity:
            raise ValueError(f"gap is {self.gap} m; it must be below {self.amplitude} m, v0/omega.")

    @property
    def frequency(self) -> float:
        """Circular frequency omega of the mass on its spring [rad/s]."""
        return math.sqrt(self.stiffness / self.mass)

    @property
    def contact_frequency(self) -> float:
        """Circular frequency w of the mass on spring and stop [rad/s]."""
        return math.sqrt((self.stiffness + self.stop_stiffness) / self.mass)

    @property
    def free_period(self) -> float:
        """Period of the mass on its spring without the stop [s]."""
        return 2.0 * math.pi / self.frequency

    @property
    def amplitude(self) -> float:
        """Largest displacement on the side without the stop, v0/omega [m]."""
        return self.initial_velocity / self.frequency

    @property
    def energy(self) -> float:
        """Total energy, m v0^2 / 2 [J]."""
        return 0.5 * self.mass * self.initial_velocity**2

    @property
    def impact_velocity(self) -> float:
        """Velocity v1 at impact [m/s]."""
        return math.sqrt(self.initial_velocity**2 - (self.frequency * self.gap) ** 2)

    @property
    def impact_time(self) -> float:
        """Time of the first impact [s]."""
        return math.asin(self.gap / self.amplitude) / self.frequency

    @property
    def contact_duration(self) -> float:
        """Duration of a contact [s]."""
        w = self.contact_frequency
        return 2.0 / w * math.atan2(self.impact_velocity / w, self._offset)

    @property
    def period(self) -> float:
        """Period of the motion with impacts [s]."""
        flight = math.pi / self.frequency + 2.0 * self.impact_time
        return flight + self.contact_duration

    @property
    def max_force(self) -> float:
        """Largest force of the stop [N]."""
        swing = math.hypot(self._offset, self.impact_velocity / self.contact_frequency)
        return self.stop_stiffness * (swing - self._offset)

    @property
    def impulse(self) -> float:
        """Time integral of the stop's force over one contact [N s]."""
        w, angle = self.contact_frequency, self.contact_frequency * self.contact_duration
        turned = self._offset / w * (math.sin(angle) - angle)
        pushed = self.impact_velocity / w**2 * (1.0 - math.cos(angle))
        return self.stop_stiffness * (turned + pushed)

    @property
    def _offset(self) -> float:
        """Distance gap - u_e of the first contact from the equilibrium in contact [m]."""
        return self.gap * self.stiffness / (self.stiffness + self.stop_stiffness)

    def displacement(self, time: ArrayLike) -> Floats:
        """Return u at times [s], [m]."""
        return self._motion(time)[0]

    def velocity(self, time: ArrayLike) -> Floats:
        """Return u' at times [s], [m/s]."""
        return self._motion(time)[1]

    def force(self, time: ArrayLike) -> Floats:
        """Return the force of the stop at times [s], positive in compression, [N]."""
        return self.stop_stiffness * np.maximum(self.displacement(time) - self.gap, 0.0)

    def _motion(self, time: ArrayLike) -> tuple[Floats, Floats]:
        """Return displacement [m] and velocity [m/s] at times [s]."""
        since = np.mod(np.asarray(time, dtype=np.float64) - self.impact_time, self.period)
        omega, w = self.frequency, self.contact_frequency
        v1, offset = self.impact_velocity, self._offset
        u_c = self.gap - offset + offset * np.cos(w * since) + v1 / w * np.sin(w * since)
        v_c = v1 * np.cos(w * since) - w * offset * np.sin(w * since)
        # A flight starts with -v1, which is the velocity of a free oscillation at pi - omega t_hit.
        phase = math.pi - omega * self.impact_time + omega * (since - self.contact_duration)
        touching = since < self.contact_duration
        u = np.where(touching, u_c, self.amplitude * np.sin(phase))
        v = np.where(touching, v_c, self.initial_velocity * np.cos(phase))
        return u, v


@dataclass(frozen=True, kw_only=True)
@checked
class SlidingBlock:
    """Newmark's rigid block on a base with a rectangular acceleration pulse.

    While the base accelerates with A > a_y, the block slides with s'' = A - a_y. After the pulse,
    only friction acts, s'' = -a_y, until the block stops at the time A t_p / a_y. On a level base
    a_y = mu g. The final slip is

    s_end = (A - a_y) A t_p^2 / (2 a_y)

    Attributes:
        pulse: A [m/s^2].
        yield_acceleration: a_y [m/s^2].
        duration: t_p of the pulse [s].
    """

    pulse: Positive
    yield_acceleration: Positive
    duration: Positive

    @property
    def stop_time(self) -> float:
        """Time at which the block stops sliding, 0 if it never slides [s]."""
        if self.pulse <= self.yield_acceleration:
            return 0.0
        return self.duration * self.pulse / self.yield_acceleration

    @property
    def final_slip(self) -> float:
        """Slip after the motion [m]."""
        return float(self.slip(self.stop_time))

    def slip(self, time: ArrayLike) -> Floats:
        """Return the slip s of the block on its base at times [s], [m]."""
        pushed, braked = self._phases(time)
        excess = max(self.pulse - self.yield_acceleration, 0.0)
        at_end_of_pulse = excess * self.duration
        return (
            0.5 * excess * pushed**2
            + at_end_of_pulse * braked
            - 0.5 * self.yield_acceleration * braked**2
        )

    def velocity(self, time: ArrayLike) -> Floats:
        """Return the sliding velocity s' at times [s], [m/s]."""
        pushed, braked = self._phases(time)
        excess = max(self.pulse - self.yield_acceleration, 0.0)
        return excess * pushed - self.yield_acceleration * braked

    def _phases(self, time: ArrayLike) -> tuple[Floats, Floats]:
        """Return the time spent in the pulse, and the time of sliding after it [s]."""
        t = np.asarray(time, dtype=np.float64)
        braking = max(self.stop_time - self.duration, 0.0)
        return np.clip(t, 0.0, self.duration), np.clip(t - self.duration, 0.0, braking)


@dataclass(frozen=True, kw_only=True)
@checked
class CoulombOscillator:
    """Mass on a spring with dry friction, released at rest.

    m x'' + k x + F sign(x') = 0,  x(0) = x0,  x'(0) = 0

    In each half period pi/omega the motion is a cosine about +-F/k, and the amplitude decreases by
    2 F/k. The mass stops at the first turning point with |x| <= F/k.

    Attributes:
        mass: m [kg].
        stiffness: k [N/m].
        friction: F = mu N [N].
        start: x0 [m].
    """

    mass: Positive
    stiffness: Positive
    friction: Positive
    start: float

    @property
    def half_period(self) -> float:
        """Time between two turning points [s]."""
        return math.pi * math.sqrt(self.mass / self.stiffness)

    @property
    def turning_points(self) -> Floats:
        """Displacements at 0, pi/omega, 2 pi/omega, ... until rest, shape (n + 1,), [m]."""
        band = self.friction / self.stiffness
        count = max(0, math.ceil((abs(self.start) / band - 1.0) / 2.0))
        turns = np.arange(count + 1)
        signs = math.copysign(1.0, self.start) * (-1.0) ** turns
        return signs * (abs(self.start) - 2.0 * band * turns)

    @property
    def rest_time(self) -> float:
        """Time at which the mass comes to rest [s]."""
        return self.half_period * (len(self.turning_points) - 1)

    def displacement(self, time: ArrayLike) -> Floats:
        """Return x at times [s], [m]."""
        turns, last = self.turning_points, len(self.turning_points) - 1
        t = np.asarray(time, dtype=np.float64) / self.half_period
        half = np.clip(np.floor(t), 0, last).astype(np.int64)
        centre = np.sign(turns[half]) * self.friction / self.stiffness
        swing = centre + (turns[half] - centre) * np.cos(math.pi * (t - half))
        return np.where(half == last, turns[last], swing)


@checked
def plane_normal(dip: Dip, dip_direction: Azimuth) -> Floats:
    """Return the upward unit normal of a plane, shape (3,).

    Args:
        dip: Angle of the plane to the horizontal [degrees].
        dip_direction: Azimuth of the line of steepest descent, clockwise from +y as seen from
            above: x is east, y north, z up [degrees].
    """
    psi, alpha = np.radians([dip, dip_direction])
    return np.array([np.sin(psi) * np.sin(alpha), np.sin(psi) * np.cos(alpha), np.cos(psi)])


def projected_force(normals: Floats, force: Floats) -> tuple[Floats, Floats]:
    """Return N, shape (planes,), and s, shape (3,), of a `SlidingWedge` under a force R [N].

    The unit normals point to the wedge, shape (planes, 3). If s is rounding error, it is zero.
    """
    from scipy.optimize import nnls

    forces, _ = nnls(normals.T, -force)
    along = force + forces @ normals
    at_rest = np.linalg.norm(along) <= 1e-12 * np.linalg.norm(force)
    return forces, np.zeros(3) if at_rest else along


@dataclass(frozen=True, kw_only=True)
@checked
class WedgePlane:
    """Plane that bounds a rigid wedge.

    Attributes:
        dip: Angle to the horizontal [degrees].
        dip_direction: Azimuth as in `plane_normal` [degrees].
        friction_angle_deg: phi [degrees].
        cohesion: c [Pa].
        area: A, used with cohesion and water pressure [m^2].
        pressure: Mean water pressure p [Pa].
        above: True if the wedge is above the plane; False below it, as under a roof.
    """

    dip: Dip
    dip_direction: Azimuth
    friction_angle_deg: Annotated[float, at.Interval(ge=0, lt=90), at.Unit("degrees")]
    cohesion: NotNegative = 0.0
    area: NotNegative = 0.0
    pressure: NotNegative = 0.0
    above: bool = True

    @property
    def normal(self) -> Floats:
        """Unit normal n towards the wedge, shape (3,)."""
        return plane_normal(self.dip, self.dip_direction) * (1.0 if self.above else -1.0)


@dataclass(frozen=True, kw_only=True)
@checked
class SlidingWedge:
    """Rigid wedge on planes, by limit equilibrium (Hoek and Bray; Wyllie and Mah).

    With R = force + sum p_i A_i n_i and the effective normal forces N_i,

    s = R + sum N_i n_i,  N_i >= 0,  n_i . s >= 0,  N_i (n_i . s) = 0,
    F = sum over N_i > 0 of (c_i A_i + N_i tan phi_i) / |s|

    The wedge moves along s, the projection of R onto the directions that no plane blocks: the line
    of intersection of two planes, the steepest line of one plane, or R if all planes open.

    Attributes:
        planes: Planes that bound the wedge, with linearly independent normals. Free surfaces are no
            planes. A tension crack is a plane that opens.
        force: Weight, thrust of a dam, inertia, without the water in the planes, shape (3,), [N].
    """

    planes: Annotated[Sequence[WedgePlane], at.MinLen(1)]
    force: Annotated[Sequence[float], at.Len(3, 3)]

    @cached_property
    def _solution(self) -> tuple[Floats, Floats]:
        """Normal forces N, and the projection s of the active force [N]."""
        normals = np.array([plane.normal for plane in self.planes])
        water = np.array([plane.pressure * plane.area for plane in self.planes])
        return projected_force(normals, np.asarray(self.force, dtype=np.float64) + water @ normals)

    @property
    def normal_forces(self) -> Floats:
        """Effective normal force N_i of each plane, zero if the plane opens, [N]."""
        return self._solution[0]

    @property
    def direction(self) -> Floats:
        """Unit vector of the motion, shape (3,); NaN if the planes block every motion."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self._solution[1] / np.linalg.norm(self._solution[1]))

    @property
    def factor_of_safety(self) -> float:
        """F: 1 at the limit, 0 if all planes open, infinite if the planes block every motion."""
        driving, resistance = float(np.linalg.norm(self._solution[1])), 0.0
        for plane, normal in zip(self.planes, self.normal_forces, strict=True):
            if normal > 0.0:
                friction = math.tan(math.radians(plane.friction_angle_deg))
                resistance += plane.cohesion * plane.area + normal * friction
        return resistance / driving if driving else math.inf
