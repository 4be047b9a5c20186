# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Uniform ground motion, as inertia forces; displacements are relative to the ground."""

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
from dolfinx_joints.loads.load import LoadedBody, TimeFactor
from dolfinx_joints.motions.differing import DifferingMotion
from dolfinx_joints.motions.motion import Motion

# Components of a motion along the axes of a model, for models in two and three dimensions.
MOVING = {2: [0, 2], 3: [0, 1, 2]}

# Gauss points per interval of the velocity integral; tolerance for a time at the end of an
# interval, relative to the length of the interval.
GAUSS_POINTS, ROUNDING = 4, 1e-9


@dataclass(frozen=True, kw_only=True)
@checked
class BaseMotion:
    """Uniform acceleration of the ground; displacements are then relative to the ground.

    The force is F = -M iota a_g(t) per axis. The ground velocity excites water with waves (12v).

    Attributes:
        acceleration: Ground acceleration at a time [s], such as a `Motion`, shape (3,), [m/s^2]. In
            2-D, its x and z components act along x and y; shape (2,) is used unchanged.
        velocity: Ground velocity, same shape [m/s]; needed only for water with waves.
    """

    acceleration: Callable[[float], Any]
    velocity: Callable[[float], Any] | None = None

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Return one inertia pattern per axis."""
        factors = _by_axis(self.acceleration, model.gdim, "acceleration")
        return [(model.inertia_pattern(-np.eye(model.gdim)[i]), f) for i, f in enumerate(factors)]

    def velocities(self, gdim: int) -> list[TimeFactor]:
        """Return the ground velocity along each axis [m/s] as functions of time [s]."""
        if self.velocity is None:
            raise ValueError(
                "BaseMotion: velocity is missing, but ReservoirWaves need the velocity of the "
                "ground; give velocity=, or pass motion= to dynamics()."
            )
        return _by_axis(self.velocity, gdim, "velocity")


def moved_by(acceleration: Callable[[float], Floats] | None, spacing: float) -> list[BaseMotion]:
    """Return the load of a ground motion with its velocity; an empty list without a motion."""
    if acceleration is None:
        return []
    velocity = velocity_of(acceleration, spacing)
    return [BaseMotion(acceleration=acceleration, velocity=velocity)]


def velocity_of(acceleration: Callable[[float], Any], spacing: float) -> Callable[[float], Floats]:
    """Return the ground velocity [m/s] from rest at time zero, by Gauss quadrature.

    Each interval of length ``spacing`` [s] has GAUSS_POINTS points.
    """
    points, weights = np.polynomial.legendre.leggauss(GAUSS_POINTS)

    def increment(start: float, end: float) -> Floats:
        half = 0.5 * (end - start)
        times = start + half * (1.0 + points)
        return np.asarray(half * weights @ np.array([acceleration(float(t)) for t in times]))

    sums = [np.zeros_like(acceleration(0.0))]

    def velocity(time: float) -> Floats:
        intervals = int(np.floor(time / spacing + ROUNDING))
        while len(sums) <= intervals:
            start = (len(sums) - 1) * spacing
            sums.append(sums[-1] + increment(start, start + spacing))
        return sums[intervals] + increment(intervals * spacing, max(time, intervals * spacing))

    return velocity


@dataclass(frozen=True)
class IncidentWave:
    """Velocity of the rising wave of an outcrop record, see `incident_wave`."""

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


def for_steps(originals: Sequence[Any], dt: float, comm: Any) -> tuple[list[Any], list[str]]:
    """Filter motions and loads by `Motion.for_steps`; return them and warnings of large losses."""
    texts = []

    def filter_item(item: Any) -> Any:
        if isinstance(item, BaseMotion):
            return replace(item, acceleration=filter_item(item.acceleration))
        if isinstance(item, DifferingMotion):
            changed = {name: filter_item(motion) for name, motion in item.named.items()}
            motions = changed[item.motions.name] if isinstance(item.motions, Motion) else changed
            return item if changed == item.named else replace(item, motions=motions)
        if isinstance(wave := getattr(item, "incident", None), IncidentWave):
            return replace(item, incident=IncidentWave(filter_item(wave.outcrop)))
        if not isinstance(item, Motion):
            return item
        filtered = item.for_steps(dt)
        total = np.sum(item.acceleration**2)
        share = np.sum(filtered.acceleration**2) / total if total else 1.0
        if filtered is not item and share < 1.0 - LARGE_LOSS:
            texts.append(
                f"Steps of {dt:g} s resolve frequencies below {0.5 / dt:g} Hz. Higher frequencies "
                f"of {shown(item.name)} are removed: {100.0 * (1.0 - share):.3g} % of the integral "
                "of its squared acceleration. Take shorter steps to keep them."
            )
        return filtered

    items = [filter_item(item) for item in originals]
    doubt(comm, *texts)
    return items, texts


def _by_axis(motion: Callable[[float], Any], gdim: int, name: str) -> list[TimeFactor]:
    """Return each component of a motion as a function of time; one evaluation serves all."""
    latest = lru_cache(maxsize=1)(in_axes(motion, gdim, name))

    def factor(axis: int) -> TimeFactor:
        return lambda time: float(latest(time)[axis])

    return [factor(axis) for axis in range(gdim)]


def in_axes(
    motion: Callable[[float], Any], gdim: int, name: str = "motion"
) -> Callable[[float], Floats]:
    """Return the motion along the model's axes; in 2-D, x and z of three components, or two."""

    def in_model_axes(time: float) -> Floats:
        sample = motion(time)
        values = numbers_of(sample)
        if values is None or values.ndim != 1 or len(values) < gdim or not finite(values):
            raise ValueError(
                f"{name}({time:g}) is {shown(sample)}; it must be at least {gdim} finite numbers."
            )
        return values[MOVING[gdim]] if len(values) > 2 else values[:gdim]

    return in_model_axes
