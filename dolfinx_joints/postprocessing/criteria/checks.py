# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Table of the checks of a dam: criterion, place, value, limit, and whether the limit is met."""

from __future__ import annotations

import csv
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal

import annotated_types as at
import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.postprocessing.body import Body
from dolfinx_joints.postprocessing.criteria.demand import Demand, StressDemand, has_strengths
from dolfinx_joints.postprocessing.frames import usual_reference
from dolfinx_joints.postprocessing.joints.extremes import joint_extremes
from dolfinx_joints.postprocessing.measures import displacement_history, joint_measures
from dolfinx_joints.results.arguments import check_results
from dolfinx_joints.results.joint_points import free_areas
from dolfinx_joints.results.reader import Results

Verdict = Literal["yes", "no", "no limit", "not recorded"]
Kind = Literal["gravity", "arch"]
Ratio = Annotated[float, at.Gt(0)]
Share = Annotated[float, at.Interval(ge=0.0, le=1.0)]
Metres = Annotated[float, at.Ge(0), at.Unit("m")]
Seconds = Annotated[float, at.Gt(0), at.Unit("s")]


@dataclass(frozen=True, kw_only=True)
@checked
class Limits:
    """Limits of `checks`, by default of a gravity dam; None is no limit.

    The linear criteria of USACE EM 1110-2-6053 (2007) and of Y. Ghanaat and A. Chudgar limit the
    ratio of tension to dynamic tensile strength to 2, the overstressed area to 15 % of the section
    of a gravity dam or 20 % of the surface of an arch dam, and the time of overstress to a line
    from 0.3 s (gravity) or 0.4 s (arch) at a ratio of 1 to zero at a ratio of 2. Check all limits
    against the edition of the standard that applies.

    Attributes:
        static_tension: Largest static tension / static tensile strength.
        static_compression: Largest static compression / compressive strength.
        tension: Largest tension of the run / dynamic tensile strength.
        compression: Largest compression of the run / compressive strength.
        overstressed_area: Share of the area with tension above the dynamic tensile strength.
        overstress_time: Time above the dynamic tensile strength.
        sliding_safety: Least sliding safety of a joint.
        mean_slip: Mean over the area of a joint of the largest slip of each point.
        slid_area: Share of the area of a joint that slid.
        residual_slip: Largest residual slip of a joint.
        drift: Horizontal displacement of the crest / its height.
    """

    static_tension: Ratio | None = 1.0
    static_compression: Ratio | None = 1.0
    tension: Ratio | None = 2.0
    compression: Ratio | None = 1.0
    overstressed_area: Share | None = 0.15
    overstress_time: Seconds | None = 0.3
    sliding_safety: Ratio | None = None
    mean_slip: Metres | None = None
    slid_area: Share | None = None
    residual_slip: Metres | None = None
    drift: Ratio | None = None


LIMITS: dict[str, Limits] = {
    "gravity": Limits(),
    "arch": Limits(overstressed_area=0.2, overstress_time=0.4),
}


@dataclass(frozen=True)
class Check:
    """Row of the table.

    Attributes:
        criterion: What is compared.
        where: Place or joint, with the time or static stage if there is one.
        value: Value in the unit, NaN if not recorded.
        limit: Limit in the unit, None without a limit.
        unit: SI unit.
        at_least: True if the limit is a lower limit.
    """

    criterion: str
    where: str
    value: float
    limit: float | None
    unit: str
    at_least: bool = False

    @property
    def met(self) -> Verdict:
        """``yes`` or ``no`` only if there are a value and a limit."""
        if np.isnan(self.value):
            return "not recorded"
        if self.limit is None:
            return "no limit"
        return (
            "yes"
            if (self.value >= self.limit) == self.at_least or self.value == self.limit
            else "no"
        )


HEAD = ("criterion", "where", "value", "limit", "unit", "met")


@dataclass(frozen=True)
class Checks:
    """Table of checks, which prints as text.

    Attributes:
        rows: The checks.
    """

    rows: tuple[Check, ...]

    def cells(self) -> list[list[str]]:
        """Return the rows as texts in the columns of ``HEAD``."""
        return [
            [
                row.criterion,
                row.where,
                "" if np.isnan(row.value) else f"{row.value:.4g}",
                "" if row.limit is None else f"{'>=' if row.at_least else '<='} {row.limit:.4g}",
                row.unit,
                row.met,
            ]
            for row in self.rows
        ]

    def __str__(self) -> str:
        table = [list(HEAD), *self.cells()]
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        lines = ("  ".join(map(str.ljust, row, widths)).rstrip() for row in table)
        return "\n".join(lines)

    def write_csv(self, path: str | PathLike[str]) -> Path:
        """Write the table to a CSV file, numbers with all digits; return its path."""
        with Path(path).open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow([*HEAD, "at_least"])
            for row in self.rows:
                limit = "" if row.limit is None else row.limit
                numbers = row.value, limit, row.unit, row.met, row.at_least
                writer.writerow([row.criterion, row.where, *numbers])
        return Path(path)


@checked
def checks(
    results: Results,
    kind: Kind,
    *,
    groups: Collection[str] | None = None,
    crest: str | None = None,
    **limits: Any,
) -> Checks:
    """Compare stresses, joints and crest of a run with limits.

    A row without recorded values or without a limit is not judged. Stresses need
    ``ResultsMonitor(envelopes=..., strength=...)``. Record the faces of the dam, such as
    ``envelopes=["upstream", "downstream"]``, so that the overstressed area is a share of them.

    Args:
        results: The run.
        kind: Kind of the dam, for the default limits.
        groups: Cell groups whose stresses are compared; all by default.
        crest: Monitor point whose drift is compared. Its height is counted from the lowest node of
            the groups.
        limits: Attributes of `Limits` that replace the default limits.
    """
    check_results(results)
    allowed = replace(LIMITS[kind], **limits)
    rows = [
        *_stresses(results, groups, allowed),
        *(row for joint in results.joints for row in _joint(results, joint, allowed)),
        _drift(results, groups, crest, allowed.drift),
    ]
    return Checks(tuple(rows))


def _stresses(results: Results, groups: Collection[str] | None, limits: Limits) -> Iterator[Check]:
    """Yield the checks of stresses; files without strengths have no values."""
    found: dict[str, Demand | None] = {}
    if has_strengths(results):
        demand = StressDemand(results, groups)
        found = {
            "static_tension": demand.of_stages("principal_max", "tensile"),
            "static_compression": demand.of_stages("principal_min", "compressive"),
            "tension": demand.of_run("principal_max", "dynamic_tensile"),
            "overstressed_area": demand.overstressed_area(),
            "overstress_time": demand.overstress_time(limits.overstress_time),
            "compression": demand.of_run("principal_min", "compressive"),
        }
    missing = "" if found else "no strength in the file"
    for name, criterion, unit in (
        ("static_tension", "static tension / strength", "-"),
        ("static_compression", "static compression / strength", "-"),
        ("tension", "tension / dynamic strength", "-"),
        ("overstressed_area", "overstressed area", "-"),
        ("overstress_time", "time of overstress", "s"),
        ("compression", "compression / strength", "-"),
    ):
        one = found.get(name) or Demand(np.nan, missing)
        limit = getattr(limits, name) if one.limit is None else one.limit
        yield Check(criterion, one.where, one.value, limit, unit)


def _joint(results: Results, joint: str, limits: Limits) -> Iterator[Check]:
    """Yield the checks of sliding of a joint."""
    least, where = np.nan, joint
    slip = share = residual = np.nan
    if "states" in results.streams:
        extremes = joint_extremes(results, joint)
        if not np.isnan(extremes.safety).all():
            row = int(np.nanargmin(extremes.safety))
            least, where = float(extremes.safety[row]), f"{joint} at t = {extremes.time[row]:.3f} s"
        residual = joint_measures(results)[joint]["slip_residual"]
    if "joint_maxima" in results.streams and results.rows("joint_maxima"):
        areas = free_areas(results, joint)
        slip, share = (
            float(results.series("joint_maxima", f"{joint}/{name}", -1) @ areas / areas.sum())
            for name in ("slip", "slid")
        )
    yield Check("least sliding safety", where, least, limits.sliding_safety, "-", at_least=True)
    yield Check("mean of the largest slip", joint, slip, limits.mean_slip, "m")
    yield Check("share of the area that slid", joint, share, limits.slid_area, "-")
    yield Check("residual slip", joint, residual, limits.residual_slip, "m")


def _drift(
    results: Results, groups: Collection[str] | None, crest: str | None, limit: float | None
) -> Check:
    """Return the check of the crest's largest horizontal displacement from the static state."""
    criterion = "crest displacement / height"
    if crest is None or "histories" not in results.streams:
        return Check(
            criterion, "no crest point named" if crest is None else crest, np.nan, limit, "-"
        )
    body = Body(results, groups)
    up = 1 if body.plane else 2
    place = results.static("histories/points")[results.point_index(crest)]
    height = float(place[up] - body.nodes[body.seen, up].min())
    if height <= 0.0:
        raise ResultsError(f"The point {crest!r} is not above the lowest node of the body.")
    reference = usual_reference(results)
    moved = [
        displacement_history(results, crest, component, reference)[1]
        for component in (("x",) if body.plane else ("x", "y"))
    ]
    largest = float(np.linalg.norm(moved, axis=0).max())
    return Check(criterion, f"{crest}, height {height:.4g} m", largest / height, limit, "-")
