# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time histories of a joint: largest opening, slip and pressure of its points, sliding safety."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated

import annotated_types as at
import numpy as np

from dolfinx_joints.common.arrays import Flags, Floats
from dolfinx_joints.common.declared import checked
from dolfinx_joints.results.joint_points import free_areas, gaps, tied_points, zero_gap
from dolfinx_joints.results.quantities import (
    JOINT_SERIES,
    TABLE,
    JointPoints,
    Quantity,
    at_points,
    rows_below,
    rows_by,
)
from dolfinx_joints.results.reader import Results

FrictionAngle = Annotated[float, at.Interval(ge=0.0, lt=90.0), at.Unit("degrees")]

# Forces below NEGLIGIBLE times the largest force on a joint during a run count as zero. The limit
# of a sum of magnitudes is NEGLIGIBLE_SUM: rounding errors of the points do not cancel in the sum.
NEGLIGIBLE, NEGLIGIBLE_SUM = 1e-12, 1e-9

# A value above this fraction of the largest value counts as the largest value. The place of the
# largest value is the first point that has it, regardless of rounding errors and number of ranks.
ALIKE = 1.0 - 1e-9


@dataclass(frozen=True, kw_only=True)
class JointExtremes:
    """Time histories of the extremes of a joint's points, its mean pressure and its safety.

    Each series in ``values`` is also an attribute. ``opening`` and ``slip`` are the largest values
    of all points [m]; the slip is the change of the tangential gap since the state `slip_zero`.
    ``opening_at`` and ``slip_at`` are the points with these values, shape (records, 3), [m], NaN if
    all values are zero. ``pressure`` is the largest and ``mean_pressure`` the mean contact pressure
    [Pa], without the pressure of water in the joint. ``safety`` is `safety_against_sliding`,
    ``mobilised`` is 1 / safety. Series other than places have the shape (records,).

    Attributes:
        time: Times, shape (records,), [s].
        values: Series by name; files of older versions may have fewer.
    """

    time: Floats
    values: Mapping[str, Floats]

    def __getattr__(self, name: str) -> Floats:
        if name == "values" or name not in self.values:
            raise AttributeError(f"JointExtremes has no attribute {name!r}.")
        return self.values[name]


@checked
def joint_extremes(
    results: Results, joint: str, *, friction_angle_deg: FrictionAngle | None = None
) -> JointExtremes:
    """Return the extremes of a joint at every step.

    Files not written by a `ResultsMonitor` may contain the extremes at the stored states only.

    Args:
        results: The run.
        joint: Name of the joint.
        friction_angle_deg: Friction angle for the safety; by default from the joint law.

    Raises:
        ResultsError: The file has no joint of this name.
    """
    results.check_joint(joint)
    friction, cohesion = strength_of(results, joint, friction_angle_deg)
    if recorded(results, joint):
        rows = slice(results.rows("joints"))  # fixed here, as a run in progress adds rows
        time, series = results.time("joints")[rows], _series(results, joint, rows)
    else:
        rows = slice(results.rows("states"))
        time = results.time("states")[rows]
        series = _derive(results, state_points(results, "states", joint, cohesion, rows), joint)
    forces = (series[name] for name in ("compression", "shear_sum", "bond"))
    series["safety"] = safety_against_sliding(friction, *forces)
    with np.errstate(divide="ignore"):
        series["mobilised"] = np.divide(1.0, series["safety"])
    return JointExtremes(time=time, values=series)


def safety_against_sliding(
    friction: float, compression: Floats, shear_sum: Floats, bond: Floats
) -> Floats:
    """Return the shear strength of a joint divided by its shear, both summed over its points.

    The safety is (mu C + c A) / S, where C and S are the integrals of compression and shear of
    `JointPoints`. It does not depend on a mean normal, so the joint may be curved, or closed like a
    cylinder.

    The safety is 1 if all points slide, and never less with the friction of the law, which limits
    the shear of every point. Dashpots (`ViscousJoint`) add shear: it may be below 1. While the bond
    of a `CohesiveJoint` softens, the whole friction counts, and the safety is above 1. It may be
    below 1 under tension, or in a step that breaks most of the bond (tractions are means of steps).
    At a safety of 2, half of the total strength is used, but single points may slide. In a plane
    joint with shear in one direction, the safety is the ratio of the resultants, (mu N + c A) / V.
    Opposite shear tractions cancel in V but not in S: they reduce the safety.

    The safety is infinite without shear, and NaN if no force is transmitted or mu is NaN. It has
    the shape of the forces, which is arbitrary.

    Args:
        friction: mu; NaN if the law is unknown, or has neither friction nor cohesion.
        compression: C, [N].
        shear_sum: S, [N].
        bond: c A, integral of the cohesion that the points still have, [N].
    """
    negligible = NEGLIGIBLE_SUM * float(np.max(np.abs(compression) + shear_sum, initial=0.0))
    strength = friction * np.maximum(compression, 0.0) + bond
    return ratio(strength, shear_sum, negligible)


def ratio(strength: Floats, shear: Floats, negligible: float) -> Floats:
    """Return strength / shear of equal shapes; values up to ``negligible`` count as zero."""
    strength = np.where(strength <= negligible, 0.0, strength)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(strength / np.where(shear > negligible, shear, 0.0))


def mobilised_friction(friction: float, points: JointPoints) -> Floats:
    """Return the mobilised friction m = |t_s| / (mu p + c) of points, shape (..., points).

    p is ``compression`` and c the remaining cohesion, as in `safety_against_sliding`. The
    friction m is 1 at sliding points, more with dashpots, 0 without shear, and NaN at open points.
    """
    resistance = np.maximum(friction * points.compression + points.cohesion, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = np.where(points.shear > 0.0, points.shear / resistance, 0.0)
    return np.where(open_points(points.gap, points.traction), np.nan, values)


def open_points(gap: Floats, traction: Floats) -> Flags:
    """Return True for joint points with a positive gap and no traction, shape (..., points)."""
    # Loaded points of rigid joints may have positive gaps of rounding size: they are not open.
    negligible = 1e-12 * np.abs(traction).max(axis=(-2, -1), initial=0.0, keepdims=True)[..., 0]
    return (gap[..., 0] > 0.0) & (np.abs(traction[..., 0]) <= negligible)


def strength_of(results: Results, joint: str, angle: float | None) -> tuple[float, float]:
    """Return friction coefficient mu and cohesion [Pa]; mu is NaN if both are 0 or unknown."""
    law = results.law(joint)
    cohesion = float(law.get("cohesion", 0.0))
    if angle is None:
        angle = law.get("friction_angle_deg")
        if angle is None or not (angle or cohesion):
            return np.nan, cohesion
    return math.tan(math.radians(angle)), cohesion


def recorded(results: Results, joint: str) -> bool:
    """Return True if the file contains the extremes of a joint at every step."""
    return f"{joint}/opening" in results.streams.get("joints", [])


def state_points(
    results: Results, stream: str, joint: str, cohesion: float, rows: slice
) -> JointPoints:
    """Return the states of a joint's points, recorded in the given rows of a stream."""
    where = f"joints/{joint}"
    gap, traction = (
        gaps(results, stream, joint, rows),
        results.series(stream, f"{where}/traction", rows),
    )
    intact = np.full(traction.shape[:-1], float("adheres" in results.law(joint)))
    if f"{where}/broken" in results.streams[stream]:
        intact = 1.0 - results.series(stream, f"{where}/broken", rows)
    slip = (gap - zero_gap(results, joint))[..., 1:]
    return JointPoints(gap, slip, traction, cohesion * intact)


def drawn_series(joints: Iterable[JointExtremes]) -> list[Quantity]:
    """Return the series to draw, in the extremes of all joints; the mobilised friction is last."""
    given, rows = list(joints), (*JOINT_SERIES, *rows_below("joints", "*/mobilised"))
    return [row for row in rows if all(row.key in joint.values for joint in given)]


def _series(results: Results, joint: str, rows: slice) -> dict[str, Floats]:
    """Return the recorded series of a joint by name; files of older versions may have fewer."""
    names = results.streams["joints"]
    keys = [row.key for row in TABLE["joints"] if f"{joint}/{row.key}" in names]
    series = {key: results.series("joints", f"{joint}/{key}", rows) for key in keys}
    return {"bond": np.zeros_like(series["compression"]), **series}


def _derive(results: Results, points: JointPoints, joint: str) -> dict[str, Floats]:
    """Return the series of a joint by name, computed from the states of its points."""
    areas, tied = free_areas(results, joint), tied_points(results, joint)
    places, series = results.static(f"joints/{joint}/points"), {}
    for row in rows_by("largest", "integral", "mean"):
        values = at_points([row], points)[0]
        if row.by == "largest":
            positive = np.where(tied, 0.0, np.maximum(values, 0.0))
            largest = series[row.key] = positive.max(axis=1)
            first = np.argmax(positive >= ALIKE * largest[:, None], axis=1)
            series[f"{row.key}_at"] = np.where(largest[:, None] > 0.0, places[first], np.nan)
        else:
            series[row.key] = values @ areas / (areas.sum() if row.by == "mean" else 1.0)
    return series
