# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Largest opening, slip and pressure of each joint and its safety against sliding, over time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

import annotated_types as at
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.declared import checked
from dolfinx_joints.results.joint_points import free_areas, gaps, tied_points
from dolfinx_joints.results.reader import Results

Floats = NDArray[np.floating[Any]]
FrictionAngle = Annotated[float, at.Interval(ge=0.0, lt=90.0), at.Unit("degrees")]

# Of the largest force on a joint over a run, that counts as none; of sums of magnitudes, in which
# what rounding makes at the points does not cancel.
NEGLIGIBLE, NEGLIGIBLE_SUM = 1e-12, 1e-9

# Share of the largest value that counts as the largest, so that of points which are alike but for
# rounding the same one is found on any number of ranks: the first.
ALIKE = 1.0 - 1e-9


@dataclass(frozen=True, kw_only=True)
class JointExtremes:
    """Extremes over the points of a joint, and its safety against sliding, over time.

    Attributes:
        time: Times, shape (records,), [s].
        opening: Largest opening, the positive part of the normal gap, shape (records,), [m].
        slip: Largest slip, the tangential displacement of the two sides against each other from
            the first record, the elastic part included, shape (records,), [m].
        safety: `safety_against_sliding`, shape (records,).
        pressure: Largest pressure, effective where there is water, shape (records,), [Pa].
        opening_at: Where the opening is the largest, shape (records, 3), [m]; NaN where all is
            closed.
        slip_at: Where the slip is the largest, likewise.
    """

    time: Floats
    opening: Floats
    slip: Floats
    safety: Floats
    pressure: Floats
    opening_at: Floats
    slip_at: Floats


@checked
def joint_extremes(
    results: Results, joint: str, *, friction_angle_deg: FrictionAngle | None = None
) -> JointExtremes:
    """Extremes of a joint at every step.

    Files that were not written by a `ResultsMonitor` may hold them at their stored states only.

    Args:
        results: The run.
        joint: Name of the joint.
        friction_angle_deg: For the safety; that of the joint's law unless given.

    Raises:
        ResultsError: There is no such joint.
    """
    results.check_joint(joint)
    friction, cohesion = strength_of(results, joint, friction_angle_deg)
    if recorded(results, joint):
        found = _series(results, joint)
    else:
        found = _from_states(results, joint, cohesion)
    forces = (found.pop(name) for name in ("compression", "shear_sum", "bond"))
    return JointExtremes(safety=safety_against_sliding(friction, *forces), **found)


def safety_against_sliding(
    friction: float, compression: Floats, shear_sum: Floats, bond: Floats
) -> Floats:
    """Shear strength of a joint over the shear on it, both added up point by point, shape (...).

    (mu C + c A) / S, with C and S the integrals of `compression_and_shear`. No mean normal enters,
    so that it holds for curved and closed joints. It is 1 where every point slides and never
    below: friction lets no point carry more. Where it is 2, the points carry half of what they
    could; single ones may slide. Where a plane joint is sheared in one direction it is the ratio of
    the resultants, (mu N + c A) / V; shear that balances itself within the joint lowers it.

    Infinite without shear; NaN where nothing is transmitted and where mu is not known.

    Args:
        friction: mu; NaN where the law has no limit to the shear or is not known.
        compression: C, [N].
        shear_sum: S, [N].
        bond: Cohesion times the area whose bond is intact, c A, [N].
    """
    none = NEGLIGIBLE_SUM * float(np.max(np.abs(compression) + shear_sum, initial=0.0))
    strength = friction * np.maximum(compression, 0.0) + bond
    return ratio(strength, shear_sum, none)


def ratio(strength: Floats, shear: Floats, none: float) -> Floats:
    """Strength over shear, both zero below ``none``, shape (...)."""
    strength = np.where(strength <= none, 0.0, strength)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(strength / np.where(shear > none, shear, 0.0))


def compression_and_shear(
    traction: Floats, bonded: NDArray[np.bool_] | bool
) -> tuple[Floats, Floats]:
    """What friction has to work with and what it has to bear at each point, (..., n), [Pa].

    Compression is -t_n; tension counts where a bond holds, whose strength it lowers, and is zero
    elsewhere. Shear is the magnitude of the tangential traction.

    Args:
        traction: Components (n, s1, s2), shape (..., n, 3), [Pa].
        bonded: Where a bond with cohesion is intact, shape (..., n).
    """
    normal = traction[..., 0]
    compression = np.where(bonded, -normal, np.maximum(-normal, 0.0))
    return compression, np.linalg.norm(traction[..., 1:], axis=-1)


def open_points(gap: Floats, traction: Floats) -> NDArray[np.bool_]:
    """Which joint points are open: a positive gap and no traction, shape (..., points).

    Args:
        gap: Components (n, s1, s2), shape (..., points, 3), [m].
        traction: Likewise, in any unit.
    """
    # A rigid joint leaves gaps of rounding size where it carries load: they do not count as open.
    negligible = 1e-12 * np.abs(traction).max(axis=(-2, -1), initial=0.0, keepdims=True)[..., 0]
    is_open: NDArray[np.bool_] = (gap[..., 0] > 0.0) & (np.abs(traction[..., 0]) <= negligible)
    return is_open


def strength_of(results: Results, joint: str, angle: float | None) -> tuple[float, float]:
    """Friction coefficient, NaN where the law has none, and cohesion [Pa]."""
    law = results.law(joint)
    angle = law.get("friction_angle_deg") if angle is None else angle
    cohesion = float(law.get("cohesion", 0.0))
    if angle is None:
        return np.nan, cohesion
    return math.tan(math.radians(angle)), cohesion


def recorded(results: Results, joint: str) -> bool:
    """Whether a file holds the extremes of a joint at every step."""
    return f"{joint}/opening" in results.streams.get("joints", [])


def sliding_series(results: Results, joint: str, rows: slice) -> dict[str, Floats]:
    """``compression``, ``shear_sum`` and ``bond`` of a joint at every step, (records,), [N]."""
    known = results.streams["joints"]
    names = (name for name in ("compression", "shear_sum", "bond") if f"{joint}/{name}" in known)
    found = {name: results.series("joints", f"{joint}/{name}", rows) for name in names}
    return {"bond": np.zeros_like(found["compression"]), **found}


def sliding_of_states(
    results: Results, stream: str, joint: str, cohesion: float, rows: slice
) -> dict[str, Floats]:
    """The same from the tractions that a stream holds."""
    where = f"joints/{joint}"
    areas = free_areas(results, joint)
    traction = results.series(stream, f"{where}/traction", rows)
    intact = np.zeros(traction.shape[:-1], dtype=bool)
    if f"{where}/broken" in results.streams[stream]:
        intact = results.series(stream, f"{where}/broken", rows) == 0
    compression, shear = compression_and_shear(traction, intact)
    forces = {"compression": compression, "shear_sum": shear, "bond": cohesion * intact}
    return {name: each @ areas for name, each in forces.items()}


def _series(results: Results, joint: str) -> dict[str, Floats]:
    """Series of the stream ``joints``."""
    rows = slice(results.rows("joints"))  # a run that is still writing adds more
    names = ("opening", "slip", "pressure", "opening_at", "slip_at")
    found = {name: results.series("joints", f"{joint}/{name}", rows) for name in names}
    return found | {"time": results.time("joints")[rows]} | sliding_series(results, joint, rows)


def _from_states(results: Results, joint: str, cohesion: float) -> dict[str, Floats]:
    """The same at the stored states."""
    rows, where = slice(results.rows("states")), f"joints/{joint}"
    points = results.static(f"{where}/points")
    gap = gaps(results, "states", joint, rows)
    pressure = -results.series("states", f"{where}/traction", rows)[..., 0]
    pressure[:, tied_points(results, joint)] = 0.0
    opening = np.maximum(gap[..., 0], 0.0)
    slip = np.linalg.norm(gap[..., 1:] - gap[:1, :, 1:], axis=-1)
    found = {
        "time": results.time("states")[rows],
        "pressure": np.maximum(pressure, 0.0).max(axis=1),
    }
    for name, values in (("opening", opening), ("slip", slip)):
        largest = values.max(axis=1)
        first = np.argmax(values >= ALIKE * largest[:, None], axis=1)
        found[name] = largest
        found[f"{name}_at"] = np.where(largest[:, None] > 0.0, points[first], np.nan)
    return found | sliding_of_states(results, "states", joint, cohesion, rows)
