# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Largest opening, slip and pressure of each joint and its safety against sliding, over time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated

import annotated_types as at
import numpy as np

from dolfinx_joints.common.arrays import Flags, Floats
from dolfinx_joints.common.declared import checked
from dolfinx_joints.results.joint_points import free_areas, gaps, tied_points
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

# Of the largest force on a joint over a run, that counts as none; of sums of magnitudes, in which
# what rounding makes at the points does not cancel.
NEGLIGIBLE, NEGLIGIBLE_SUM = 1e-12, 1e-9

# Share of the largest value that counts as the largest, so that of points which are alike but for
# rounding the same one is found on any number of ranks: the first.
ALIKE = 1.0 - 1e-9


@dataclass(frozen=True, kw_only=True)
class JointExtremes:
    """Extremes over the points of a joint, its mean pressure and its safety, over time.

    Every one of ``values`` is an attribute as well: ``opening`` and ``slip``, the largest opening
    and tangential displacement of the two sides since the first record [m]; ``pressure``, the
    largest, and ``mean_pressure``, its mean over the area, effective where there is water [Pa];
    ``safety``, `safety_against_sliding`, all of shape (records,); and ``opening_at`` and
    ``slip_at``, where these are the largest, shape (records, 3), [m], NaN where all are zero.

    Attributes:
        time: Times, shape (records,), [s].
        values: By the names of the stream ``joints``; an older file may hold fewer.
    """

    time: Floats
    values: Mapping[str, Floats]

    def __getattr__(self, name: str) -> Floats:
        if name == "values" or name not in self.values:
            raise AttributeError(f"Extremes of a joint have no {name!r}.")
        return self.values[name]


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
        rows = slice(results.rows("joints"))  # a run that is still writing adds more
        time, found = results.time("joints")[rows], _series(results, joint, rows)
    else:
        rows = slice(results.rows("states"))
        time = results.time("states")[rows]
        found = _of_points(results, state_points(results, "states", joint, cohesion, rows), joint)
    forces = (found[name] for name in ("compression", "shear_sum", "bond"))
    found["safety"] = safety_against_sliding(friction, *forces)
    return JointExtremes(time=time, values=found)


def safety_against_sliding(
    friction: float, compression: Floats, shear_sum: Floats, bond: Floats
) -> Floats:
    """Shear strength of a joint over the shear on it, both added up point by point, shape (...).

    (mu C + c A) / S, with C and S the integrals of compression and shear of `JointPoints`. No mean
    normal enters, so that it holds for curved and closed joints. It is 1 where every point slides
    and never below: friction lets no point carry more. Where it is 2, the points carry half of what
    they could; single ones may slide. Where a plane joint is sheared in one direction it is the
    ratio of the resultants, (mu N + c A) / V; shear that balances itself within the joint lowers
    it.

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


def open_points(gap: Floats, traction: Floats) -> Flags:
    """Which joint points are open: a positive gap and no traction, shape (..., points)."""
    # A rigid joint leaves gaps of rounding size where it carries load: they do not count as open.
    negligible = 1e-12 * np.abs(traction).max(axis=(-2, -1), initial=0.0, keepdims=True)[..., 0]
    return (gap[..., 0] > 0.0) & (np.abs(traction[..., 0]) <= negligible)


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


def state_points(
    results: Results, stream: str, joint: str, cohesion: float, rows: slice
) -> JointPoints:
    """State of the points of a joint at records of a stream, shape (records, points, ...)."""
    where = f"joints/{joint}"
    gap, traction = (
        gaps(results, stream, joint, rows),
        results.series(stream, f"{where}/traction", rows),
    )
    intact = np.zeros(traction.shape[:-1], dtype=bool)
    if f"{where}/broken" in results.streams[stream]:
        intact = results.series(stream, f"{where}/broken", rows) == 0
    return JointPoints(gap, gap[..., 1:] - gap[:1, :, 1:], traction, cohesion * intact)


def drawn_series(joints: Iterable[JointExtremes]) -> list[Quantity]:
    """Rows that are drawn over time and that all these joints have, the safety last."""
    every, rows = list(joints), (*JOINT_SERIES, *rows_below("joints", "*/safety"))
    return [row for row in rows if all(row.key in one.values for one in every)]


def _series(results: Results, joint: str, rows: slice) -> dict[str, Floats]:
    """Series of the stream ``joints`` by name, without those that an older file does not hold."""
    known = results.streams["joints"]
    keys = [row.key for row in TABLE["joints"] if f"{joint}/{row.key}" in known]
    found = {key: results.series("joints", f"{joint}/{key}", rows) for key in keys}
    return {"bond": np.zeros_like(found["compression"]), **found}


def _of_points(results: Results, points: JointPoints, joint: str) -> dict[str, Floats]:
    """Return the same from the states of the points."""
    areas, tied = free_areas(results, joint), tied_points(results, joint)
    places, found = results.static(f"joints/{joint}/points"), {}
    for row in rows_by("largest", "integral", "mean"):
        values = at_points([row], points)[..., 0]
        if row.by == "largest":
            here = np.where(tied, 0.0, np.maximum(values, 0.0))
            largest = found[row.key] = here.max(axis=1)
            first = np.argmax(here >= ALIKE * largest[:, None], axis=1)
            found[f"{row.key}_at"] = np.where(largest[:, None] > 0.0, places[first], np.nan)
        else:
            found[row.key] = values @ areas / (areas.sum() if row.by == "mean" else 1.0)
    return found
