# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motions from recorded velocities or displacements, and the displacement of a motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import RecordError
from dolfinx_joints.common.parameters import numbers_of, shown
from dolfinx_joints.motions.motion import Motion, Seconds

# Largest allowed initial velocity of a velocity record, relative to its largest velocity.
AT_REST = 0.01


@checked
def motion_from_displacement(
    displacement: ArrayLike, *, dt: Seconds, name: str = "motion"
) -> Motion:
    """Make the motion whose displacement is the cubic spline through samples.

    The second derivative of the spline is linear between samples, like the acceleration of a
    `Motion`, so its double integral reproduces the samples. The ground starts at rest, with zero
    displacement at the first sample; the acceleration ends at zero.

    Args:
        displacement: Along x (stream), y (cross-valley), z (up), shape (n, 3), n >= 4, [m].
        dt: Time between samples [s].
        name: Name of the motion.
    """
    from scipy.interpolate import CubicSpline

    samples = _samples("displacement", displacement)
    ends = ((1, np.zeros(3)), (2, np.zeros(3)))
    spline = CubicSpline(dt * np.arange(len(samples)), samples - samples[0], bc_type=ends)
    return Motion(acceleration=spline(spline.x, 2), dt=dt, name=name)


@checked
def motion_from_velocity(velocity: ArrayLike, *, dt: Seconds, name: str = "motion") -> Motion:
    """Make a motion from samples of its velocity.

    The integral of the cubic spline through the samples is passed to `motion_from_displacement`.
    The motion has these displacements exactly, and the velocity to fourth order in ``dt``.

    Args:
        velocity: Shape (n, 3), n >= 4, starting from rest, [m/s].
        dt: Time between samples [s].
        name: Name of the motion.
    """
    from scipy.interpolate import CubicSpline

    samples = _samples("velocity", velocity)
    if np.abs(samples[0]).max() > AT_REST * np.abs(samples).max():
        raise RecordError(
            f"velocity begins with {samples[0]} m/s, but the ground must start at rest; taper the "
            "record."
        )
    spline = CubicSpline(dt * np.arange(len(samples)), samples)
    return motion_from_displacement(spline.antiderivative()(spline.x), dt=dt, name=name)


def displacement_of(motion: Motion, *, rate: bool = False) -> Callable[[Floats], Floats]:
    """Return the displacement [m], or its ``rate`` [m/s], of a motion as a function of times [s].

    The function maps times (n,) to shape (n, 3). It integrates the piecewise linear acceleration
    exactly. The ground is at rest before the first sample and keeps its velocity after the last.
    """
    velocity, displacement = motion.integrated()
    acceleration, dt = motion.acceleration, motion.dt
    jerk = np.diff(acceleration, axis=0) / dt

    def at_times(times: Floats) -> Floats:
        inside = np.clip(times, 0.0, motion.duration)
        i = np.minimum((inside / dt).astype(int), len(jerk) - 1)
        after = (inside - i * dt)[:, None]
        if rate:
            return np.asarray(velocity[i] + after * (acceleration[i] + 0.5 * after * jerk[i]))
        curvature = 0.5 * acceleration[i] + after * jerk[i] / 6.0
        beyond_end = np.maximum(times - motion.duration, 0.0)[:, None]
        result: Floats = displacement[i] + after * (velocity[i] + after * curvature)
        return result + beyond_end * velocity[-1]

    return at_times


def _samples(name: str, samples: Any) -> Floats:
    """Return the samples as finite numbers of shape (n >= 4, 3)."""
    values = numbers_of(samples)
    if values is None or values.ndim != 2 or values.shape[1] != 3 or len(values) < 4:
        got = shown(samples) if values is None else values.shape
        raise RecordError(f"{name} must be real numbers of shape (n >= 4, 3), got {got}.")
    if not np.isfinite(values).all():
        raise RecordError(f"{name} must be finite.")
    return values
