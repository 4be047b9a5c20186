# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the displacements of a run are relative to, and the motion of its ground.

With a ground motion they are relative to the ground. Under waves that rise (`FreeField`) and on
supports that move they are absolute. The ground of waves is the level free surface as they alone
would move it, such as an outcrop far from the dam.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.postprocessing.joints.surface import is_plane
from dolfinx_joints.results.reader import ABSOLUTE, RELATIVE, Results

GROUND = "ground"  # what a displacement may be relative to, besides monitor points
BASE = "mean of the base"

_SURFACE = "free_surface_velocity"


def has_free_surface(results: Results) -> bool:
    """Whether the ground is moved by waves, and the file holds what they alone do."""
    return _SURFACE in results.streams.get("histories", ())


def ground_name(results: Results) -> str:
    """What `ground_motion` is the motion of."""
    return "free surface" if has_free_surface(results) else GROUND


def usual_reference(results: Results) -> str | None:
    """What a run that is compared with others is shown relative to: the ground, where known."""
    return GROUND if has_free_surface(results) else None


def frame_name(results: Results, relative_to: str | None = None) -> str:
    """What displacements are relative to, in words."""
    if relative_to is None:
        return RELATIVE if results.relative else ABSOLUTE
    if _is_ground(results, relative_to):
        return f"relative to the {ground_name(results)}"
    return f"relative to {relative_to}"


def common_frame(frames: Mapping[str, str]) -> str:
    """What the displacements of several runs are relative to, named by run where they differ."""
    if len(set(frames.values())) == 1:
        return next(iter(frames.values()))
    return ", ".join(f"{frame} in {label}" for label, frame in frames.items())


def ground_motion(results: Results) -> tuple[Floats, Floats]:
    """Acceleration of the ground: the motion given, or that of the free surface under the waves.

    Returns:
        Times [s], shape (n,), and accelerations [m/s^2], shape (n, 3). Those of a free surface are
        the means of the steps, at their middles, as `measures.acceleration_history` has them.
    """
    time = results.time("histories")
    if has_free_surface(results):
        velocity = results.series("histories", _SURFACE)
        means = np.diff(velocity, axis=0) / np.diff(time)[:, None]
        return 0.5 * (time[1:] + time[:-1]), means
    return time, results.series("histories", "ground_acceleration")


def has_ground_motion(results: Results) -> bool:
    """Whether the file holds a motion of the ground in which it does not rest throughout."""
    known = {_SURFACE, "ground_acceleration"} & set(results.streams.get("histories", ()))
    time, acceleration = ground_motion(results) if known else (np.zeros(0), np.zeros(0))
    return len(time) > 1 and bool(acceleration.any())


def ground_in_steps(results: Results) -> Floats:
    """Mean acceleration of the ground in each step, shape (records - 1, 3), [m/s^2]."""
    _check_ground(results)
    _, ground = ground_motion(results)
    return ground if has_free_surface(results) else 0.5 * (ground[1:] + ground[:-1])


def reference_displacement(results: Results, relative_to: str | None) -> Floats:
    """Displacement of what others are relative to, shape (records, 3), [m].

    Args:
        results: The run.
        relative_to: Name of a monitor point, or ``ground``: zero where displacements are relative
            to it anyway, otherwise that of the free surface from the first record. None for zero.
    """
    time = results.time("histories")
    if relative_to is None or (_is_ground(results, relative_to) and results.relative):
        return np.zeros((len(time), 3))
    if not _is_ground(results, relative_to):
        u = results.series("histories", "displacement")
        return np.asarray(u[:, results.point_index(relative_to)])
    _check_ground(results)
    from scipy.integrate import cumulative_trapezoid

    velocity = results.series("histories", _SURFACE)
    return np.asarray(cumulative_trapezoid(velocity, time, axis=0, initial=0.0))


def nodal_displacement(
    results: Results, number: int, relative_to: str | None = None
) -> tuple[Floats, str]:
    """Displacement of all nodes at a record of the stream ``states``, and what it is relative to.

    Args:
        results: The run.
        number: Number of the record, from 0.
        relative_to: Name of a monitor point, ``ground`` as in `reference_displacement`. Unless
            given absolute displacements are relative to the mean of the lowest nodes, so that what
            deforms is seen, others as they are.

    Returns:
        Shape (nodes, 3), [m]; and in words what was taken off.
    """
    u = results.series("states", "displacement", number)
    if relative_to is None and not results.relative:
        height = results.static("mesh/nodes")[:, 1 if is_plane(results) else 2]
        lowest = height <= height.min() + 1e-6 * np.ptp(height)
        return u - u[lowest].mean(axis=0), f"relative to the {BASE}"
    if relative_to is not None:
        row = results.nearest("histories", float(results.time("states")[number]))
        u = u - reference_displacement(results, relative_to)[row]
    return u, frame_name(results, relative_to)


def _check_ground(results: Results) -> None:
    """Raise a ResultsError for absolute motions without one of the ground."""
    if not results.relative and not has_free_surface(results):
        raise ResultsError(
            f"{results.path} holds absolute motions, but none of the ground that they could be "
            "relative to; name a monitor point."
        )


def _is_ground(results: Results, relative_to: str) -> bool:
    """Whether the ground is meant, and no monitor point of that name."""
    return relative_to == GROUND and GROUND not in results.point_names
