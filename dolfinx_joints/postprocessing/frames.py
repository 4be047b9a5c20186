# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reference of the displacements of a run, and the motion of its ground.

With a ground motion, displacements are relative to the ground. With incoming waves (`FreeField`) or
moving supports they are absolute. The ground motion of incoming waves is the motion of the level
free surface without the body, for example at an outcrop far from the dam.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.postprocessing.joints.surface import is_plane
from dolfinx_joints.results.joint_points import zero_of
from dolfinx_joints.results.reader import ABSOLUTE, RELATIVE, Results

GROUND = "ground"  # value of relative_to that is not the name of a monitor point
BASE = "mean of the base"

_SURFACE = "free_surface_velocity"


def has_free_surface(results: Results) -> bool:
    """Return True if the file has the motion of a free surface under incoming waves."""
    return _SURFACE in results.streams.get("histories", ())


def ground_name(results: Results) -> str:
    """Return the name of the ground that `ground_motion` describes."""
    return "free surface" if has_free_surface(results) else GROUND


def usual_reference(results: Results) -> str | None:
    """Return the reference for comparing runs: "ground" with a free surface, otherwise None."""
    return GROUND if has_free_surface(results) else None


def frame_name(results: Results, relative_to: str | None = None) -> str:
    """Return the reference of displacements, in words."""
    if relative_to is None:
        return RELATIVE if results.relative else ABSOLUTE
    if _is_ground(results, relative_to):
        return f"relative to the {ground_name(results)}"
    return f"relative to {relative_to}"


def zero_name(results: Results, relative_to: str | None = None, *, from_static: bool = True) -> str:
    """Return the state from which displacements count, such as "from the static state"."""
    if not from_static:
        return "from the unloaded body"
    since_first = _starts_moving(results, relative_to)
    return f"from the {'first record' if since_first else zero_of(results)}"


def common_frame(frames: Mapping[str, str]) -> str:
    """Return the reference of the displacements of several runs, by run if they differ."""
    if len(set(frames.values())) == 1:
        return next(iter(frames.values()))
    return ", ".join(f"{frame} in {label}" for label, frame in frames.items())


def ground_motion(results: Results) -> tuple[Floats, Floats]:
    """Return the acceleration of the given ground motion or of the free surface under waves.

    Returns:
        Times [s], shape (n,), and accelerations [m/s^2], shape (n, 3). For a free surface these are
        means over each step, at its midpoint, as in `measures.acceleration_history`.
    """
    time = results.time("histories")
    if has_free_surface(results):
        velocity = results.series("histories", _SURFACE)
        means = np.diff(velocity, axis=0) / np.diff(time)[:, None]
        return 0.5 * (time[1:] + time[:-1]), means
    return time, results.series("histories", "ground_acceleration")


def has_ground_motion(results: Results) -> bool:
    """Return True if the file contains a ground motion that is not zero throughout."""
    series = {_SURFACE, "ground_acceleration"} & set(results.streams.get("histories", ()))
    time, acceleration = ground_motion(results) if series else (np.zeros(0), np.zeros(0))
    return len(time) > 1 and bool(acceleration.any())


def ground_in_steps(results: Results) -> Floats:
    """Return the mean ground acceleration of each step, shape (records - 1, 3), [m/s^2]."""
    _check_ground(results)
    _, ground = ground_motion(results)
    return ground if has_free_surface(results) else 0.5 * (ground[1:] + ground[:-1])


def reference_displacement(
    results: Results, relative_to: str | None, *, from_static: bool
) -> Floats:
    """Return the displacement of a reference, shape (records, 3), [m].

    Args:
        results: The run.
        relative_to: Name of a monitor point, or ``ground``. For ``ground`` the result is zero if
            the displacements of the file are relative to the ground, otherwise the displacement of
            the free surface since the first record. For None the result is zero.
        from_static: False for the displacement from the unloaded body, otherwise from `zero_name`.
    """
    time = results.time("histories")
    if relative_to is None or (_is_ground(results, relative_to) and results.relative):
        return np.zeros((len(time), 3))
    if not _is_ground(results, relative_to):
        u = results.series("histories", "displacement")
        u = u - static_displacement(results, "point_displacement") if from_static else u
        return np.asarray(u[:, results.point_index(relative_to)])
    _check_ground(results)
    if not from_static and _starts_moving(results, relative_to):
        raise ResultsError(
            f"{results.path} starts at t = {time[0]:g} s and has no displacement of the ground "
            "before; show displacements with from_static=True or relative to a monitor point."
        )
    from scipy.integrate import cumulative_trapezoid

    velocity = results.series("histories", _SURFACE)
    return np.asarray(cumulative_trapezoid(velocity, time, axis=0, initial=0.0))


def nodal_displacement(
    results: Results,
    index: int | slice,
    relative_to: str | None = None,
    *,
    from_static: bool = False,
) -> tuple[Floats, str]:
    """Return the displacement of all nodes at records of ``states``, and its zero and reference.

    Args:
        results: The run.
        index: Number of one record, from 0, or a slice of records.
        relative_to: Name of a monitor point, or ``ground`` as in `reference_displacement`. Unless
            given, the mean of the lowest nodes is subtracted from absolute displacements, so that
            the deformation is visible. Relative displacements are not changed.
        from_static: True to subtract the displacement of the state in `zero_name`.

    Returns:
        Displacement, shape (nodes, 3) or (records, nodes, 3), [m]; zero and reference in words.
    """
    u = results.series("states", "displacement", index)
    zero = zero_name(results, relative_to, from_static=from_static)
    if from_static:
        u = u - static_displacement(results, "displacement", relative_to)
    if relative_to is None and not results.relative:
        height = results.static("mesh/nodes")[:, 1 if is_plane(results) else 2]
        lowest = height <= height.min() + 1e-6 * np.ptp(height)
        return u - u[..., lowest, :].mean(axis=-2, keepdims=True), f"{zero}, relative to the {BASE}"
    if relative_to is not None:
        times = np.atleast_1d(results.time("states")[index])
        rows = [results.nearest("histories", float(time)) for time in times]
        reference = reference_displacement(results, relative_to, from_static=from_static)[rows]
        u = u - reference.reshape(*u.shape[:-2], 1, 3)
    return u, f"{zero}, {frame_name(results, relative_to)}"


def static_displacement(results: Results, series: str, relative_to: str | None = None) -> Floats:
    """Return the displacement of the state in `zero_name`, shape (nodes or points, 3), [m].

    Args:
        results: The run.
        series: ``displacement`` of all nodes, or ``point_displacement`` of the monitor points.
        relative_to: Reference from which displacements are measured.
    """
    if results.stage_names and not _starts_moving(results, relative_to):
        return results.series("statics", series, -1)
    stream = "states" if series == "displacement" else "histories"
    first = results.series(stream, "displacement", slice(1))
    return first[0] if len(first) else np.zeros(first.shape[1:])


def _check_ground(results: Results) -> None:
    """Raise a ResultsError if motions are absolute and the file has no motion of the ground."""
    if not results.relative and not has_free_surface(results):
        raise ResultsError(
            f"{results.path} has absolute motions and no motion of the ground; give the name of a "
            "monitor point as reference."
        )


def _starts_moving(results: Results, relative_to: str | None) -> bool:
    """Return True if displacements are relative to a free surface whose start is not recorded."""
    is_free_surface = relative_to and _is_ground(results, relative_to) and not results.relative
    return bool(is_free_surface and results.time("histories")[:1].any())


def _is_ground(results: Results, relative_to: str) -> bool:
    """Return True if ``relative_to`` means the ground, not a monitor point named "ground"."""
    return relative_to == GROUND and GROUND not in results.point_names
