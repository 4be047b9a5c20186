# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Uniform motion of the ground, as forces on a body whose displacements are relative to it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, cast

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.constants import LARGE_LOSS
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import doubt
from dolfinx_joints.common.parameters import finite, numbers_of, shown
from dolfinx_joints.loads.load import TimeFactor
from dolfinx_joints.loads.loaded_body import LoadedBody
from dolfinx_joints.motions.differing import DifferingMotion
from dolfinx_joints.motions.motion import Motion

# Components of a motion that move a model of so many axes, along its axes in their order.
MOVING = {2: [0, 2], 3: [0, 1, 2]}

# Points of an interval over which a ground acceleration is integrated; part of it that a time may
# miss its end by.
GAUSS_POINTS, ROUNDING = 4, 1e-9


@dataclass(frozen=True, kw_only=True)
@checked
class BaseMotion:
    """Uniform acceleration of the ground; displacements are then relative to the ground.

    F = -M iota a_g(t) for each axis; waves in water are pushed by the velocity of its bounds (12v).

    Attributes:
        acceleration: Ground acceleration at a time [s], shape (3,), [m/s^2]; a `Motion` is one.
            In 2-D x and z of it move the model along x and y; two numbers are taken as they are.
        velocity: Ground velocity alike [m/s], which only a model with `ReservoirWaves` needs.
    """

    acceleration: Callable[[float], Any]
    velocity: Callable[[float], Any] | None = None

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """One inertia pattern per axis."""
        factors = _by_axis(self.acceleration, model.gdim, "acceleration")
        return [(model.inertia_pattern(-np.eye(model.gdim)[i]), f) for i, f in enumerate(factors)]

    def velocities(self, gdim: int) -> list[TimeFactor]:
        """Ground velocity along each axis [m/s] at a time [s]."""
        if self.velocity is None:
            raise ValueError(
                "A BaseMotion moves a model with ReservoirWaves, whose water needs the velocity of "
                "the ground; give velocity= besides acceleration=, or pass motion= to dynamics()."
            )
        return _by_axis(self.velocity, gdim, "velocity")


def moved_by(acceleration: Callable[[float], Floats] | None, spacing: float) -> list[BaseMotion]:
    """The load that a ground motion is, none for none, its velocity as `velocity_of` finds it."""
    if acceleration is None:
        return []
    velocity = velocity_of(acceleration, spacing)
    return [BaseMotion(acceleration=acceleration, velocity=velocity)]


def velocity_of(acceleration: Callable[[float], Any], spacing: float) -> Callable[[float], Floats]:
    """Return the ground velocity [m/s] from rest at time zero, by Gauss points.

    Each interval of length ``spacing`` [s] has GAUSS_POINTS points.
    """
    points, weights = np.polynomial.legendre.leggauss(GAUSS_POINTS)

    def gained(start: float, end: float) -> Floats:
        half = 0.5 * (end - start)
        times = start + half * (1.0 + points)
        return np.asarray(half * weights @ np.array([acceleration(float(t)) for t in times]))

    sums = [np.zeros_like(acceleration(0.0))]

    def velocity(time: float) -> Floats:
        whole = int(np.floor(time / spacing + ROUNDING))
        while len(sums) <= whole:
            start = (len(sums) - 1) * spacing
            sums.append(sums[-1] + gained(start, start + spacing))
        return sums[whole] + gained(whole * spacing, max(time, whole * spacing))

    return velocity


@dataclass(frozen=True)
class IncidentWave:
    """Velocity of the rising wave of a motion recorded on an outcrop, see `incident_wave`."""

    outcrop: Motion

    def __call__(self, time: float) -> Floats:
        """Return the velocity at a time [s], shape (3,), [m/s]."""
        return np.asarray(0.5 * self._velocity(min(max(time, 0.0), self.outcrop.duration)))

    @cached_property
    def _velocity(self) -> Callable[[float], Floats]:
        """Integral of the acceleration, which is linear between samples."""
        from scipy.interpolate import make_interp_spline

        spline = make_interp_spline(self.outcrop.time, self.outcrop.acceleration, k=1)
        return cast("Callable[[float], Floats]", spline.antiderivative())


def for_steps(given: Sequence[Any], dt: float, comm: Any) -> tuple[list[Any], list[str]]:
    """Return motions and loads with `Motion.for_steps` of each `Motion`; warn of large losses."""
    texts = []

    def resolved(each: Any) -> Any:
        if isinstance(each, BaseMotion):
            return replace(each, acceleration=resolved(each.acceleration))
        if isinstance(each, DifferingMotion):
            changed = {name: resolved(motion) for name, motion in each.named.items()}
            one = changed[each.motions.name] if isinstance(each.motions, Motion) else changed
            return each if changed == each.named else replace(each, motions=one)
        if isinstance(wave := getattr(each, "incident", None), IncidentWave):
            return replace(each, incident=IncidentWave(resolved(wave.outcrop)))
        if not isinstance(each, Motion):
            return each
        found = each.for_steps(dt)
        total = np.sum(each.acceleration**2)
        kept = np.sum(found.acceleration**2) / total if total else 1.0
        if found is not each and kept < 1.0 - LARGE_LOSS:
            texts.append(
                f"Steps of {dt:g} s resolve frequencies below {0.5 / dt:g} Hz; the rest of "
                f"{shown(each.name)} is removed, {100.0 * (1.0 - kept):.3g} % of the integral of "
                "its squared acceleration. Take shorter steps to keep it."
            )
        return found

    found = [resolved(each) for each in given]
    doubt(comm, *texts)
    return found, texts


def _by_axis(motion: Callable[[float], Any], gdim: int, name: str) -> list[TimeFactor]:
    """Components of a motion as functions of time, the last time kept."""
    latest = lru_cache(maxsize=1)(in_axes(motion, gdim, name))

    def factor(axis: int) -> TimeFactor:
        return lambda time: float(latest(time)[axis])

    return [factor(axis) for axis in range(gdim)]


def in_axes(
    motion: Callable[[float], Any], gdim: int, name: str = "motion"
) -> Callable[[float], Floats]:
    """Return the components of a motion that move a model: in the plane x and z, or both of two."""

    def moved(time: float) -> Floats:
        given = motion(time)
        values = numbers_of(given)
        if values is None or values.ndim != 1 or len(values) < gdim or not finite(values):
            raise ValueError(
                f"{name}({time:g}) is {shown(given)}; it must be at least {gdim} finite numbers."
            )
        return values[MOVING[gdim]] if len(values) > 2 else values[:gdim]

    return moved
