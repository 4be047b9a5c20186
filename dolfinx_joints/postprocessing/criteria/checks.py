# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Table of the checks of a dam: criterion, place, value, limit, and whether the limit is met."""

from __future__ import annotations

import csv
from collections.abc import Collection, Iterator, Mapping
from dataclasses import astuple, dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal

import annotated_types as at
import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.postprocessing.body import Body
from dolfinx_joints.postprocessing.criteria.demand import Demand, stress_demands
from dolfinx_joints.postprocessing.frames import usual_reference
from dolfinx_joints.postprocessing.joints.extremes import joint_extremes
from dolfinx_joints.postprocessing.measures import displacement_history, joint_measures
from dolfinx_joints.results.arguments import COMPONENTS, check_results
from dolfinx_joints.results.joint_points import free_areas
from dolfinx_joints.results.reader import Results

Positive = Annotated[float, at.Gt(0)]
Share = Annotated[float, at.Interval(ge=0.0, le=1.0)]
Metres = Annotated[float, at.Ge(0), at.Unit("m")]
Seconds = Annotated[float, at.Gt(0), at.Unit("s")]

HEAD = ("criterion", "where", "value", "limit", "unit", "met")
# Criteria of stresses and their units, by attribute of `Limits`.
_STRESSES = {
    "static_tension": ("static tension / strength", "-"),
    "static_compression": ("static compression / strength", "-"),
    "tension": ("tension / dynamic strength", "-"),
    "overstressed_area": ("overstressed area", "-"),
    "overstress_time": ("time of overstress", "s"),
    "compression": ("compression / strength", "-"),
}


@dataclass(frozen=True, kw_only=True)
@checked
class Limits:
    """Limits of `checks`, by default of a gravity dam; None is no limit.

    USACE EM 1110-2-6053 (2007) and Y. Ghanaat and A. Chudgar limit the ratio of tension to dynamic
    tensile strength to 2, the overstressed area to 15 % of the section of a gravity dam or 20 % of
    the surface of an arch dam, and the time of overstress to a line from 0.3 s (gravity) or 0.4 s
    (arch) at a ratio of 1 to zero at 2. Check all limits against the edition that applies.

    Attributes:
        static_tension: Largest static tension / static tensile strength.
        static_compression: Largest static compression / compressive strength.
        tension: Largest tension / dynamic tensile strength.
        compression: Largest compression / compressive strength.
        overstressed_area: Share of the area with tension above the dynamic tensile strength.
        overstress_time: Time above the dynamic tensile strength.
        sliding_safety: Least sliding safety of a joint.
        mean_slip: Mean over the area of a joint of the largest slip of each point.
        slid_area: Share of the area of a joint that slid.
        residual_slip: Largest residual slip of a joint.
        drift: Horizontal displacement of the crest / its height.
    """

    static_tension: Positive | None = 1.0
    static_compression: Positive | None = 1.0
    tension: Positive | None = 2.0
    compression: Positive | None = 1.0
    overstressed_area: Share | None = 0.15
    overstress_time: Seconds | None = 0.3
    sliding_safety: Positive | None = None
    mean_slip: Metres | None = None
    slid_area: Share | None = None
    residual_slip: Metres | None = None
    drift: Positive | None = None


LIMITS = {"gravity": Limits(), "arch": Limits(overstressed_area=0.2, overstress_time=0.4)}


@dataclass(frozen=True)
class Check:
    """Row of the table; the value is NaN if not recorded, the limit None if there is none."""

    criterion: str
    where: str
    value: float
    limit: float | None
    unit: str
    at_least: bool = False

    @property
    def met(self) -> Literal["yes", "no", "no limit", "not recorded"]:
        """``yes`` or ``no`` only if there are a value and a limit."""
        if np.isnan(self.value):
            return "not recorded"
        if self.limit is None:
            return "no limit"
        is_met = self.value >= self.limit if self.at_least else self.value <= self.limit
        return "yes" if is_met else "no"


class Checks(tuple[Check, ...]):
    """Rows of the table, which prints as text."""

    __slots__ = ()

    def __str__(self) -> str:
        table = [HEAD]
        for row in self:
            value = "" if np.isnan(row.value) else f"{row.value:.4g}"
            sign = ">=" if row.at_least else "<="
            limit = "" if row.limit is None else f"{sign} {row.limit:.4g}"
            table.append((row.criterion, row.where, value, limit, row.unit, row.met))
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in table)

    def write_csv(self, path: str | PathLike[str]) -> None:
        """Write the table to a CSV file."""
        with Path(path).open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow([*HEAD[:-1], "at least", "met"])
            writer.writerows([*astuple(row), row.met] for row in self)


@checked
def checks(
    results: Results,
    kind: Literal["gravity", "arch"],
    *,
    groups: Collection[str] | None = None,
    crest: str | None = None,
    **limits: Any,
) -> Checks:
    """Compare stresses, joints and crest of a run with limits.

    A row without recorded values or without a limit is not judged. Stresses need
    ``ResultsMonitor(envelopes=..., strength=...)``. In 3-D record the faces of the dam, such as
    ``envelopes=["upstream", "downstream"]``: the overstressed area is a share of them.

    Args:
        results: The run.
        kind: Kind of the dam, for the default limits.
        groups: Cell groups whose stresses are compared; all by default.
        crest: Monitor point whose drift from the static state is compared. Its height is counted
            from the lowest node of the groups.
        limits: Attributes of `Limits` that replace the default limits.
    """
    check_results(results)
    allowed = replace(LIMITS[kind], **limits)
    rows = list(_stresses(results, groups, allowed))
    measures = joint_measures(results) if "states" in results.streams else {}
    for joint in results.joints:
        rows += _joint(results, joint, measures.get(joint), allowed)
    return Checks([*rows, _drift(results, groups, crest, allowed.drift)])


def _stresses(results: Results, groups: Collection[str] | None, limits: Limits) -> Iterator[Check]:
    """Yield the checks of stresses."""
    demands = stress_demands(results, groups, limits.overstress_time)
    missing = Demand(np.nan, "" if demands else "no strength in the file")
    for name, (criterion, unit) in _STRESSES.items():
        value, where, limit = demands.get(name, missing)
        yield Check(
            criterion, where, value, getattr(limits, name) if limit is None else limit, unit
        )


def _joint(
    results: Results, joint: str, measures: Mapping[str, float] | None, limits: Limits
) -> Iterator[Check]:
    """Yield the checks of a joint; ``measures`` are None without recorded states."""
    safety, where, slip, share, residual = np.nan, joint, np.nan, np.nan, np.nan
    if measures is not None:
        extremes, residual = joint_extremes(results, joint), measures["slip_residual"]
        if not np.isnan(extremes.safety).all():
            row = np.nanargmin(extremes.safety)
            safety, where = extremes.safety[row], f"{joint} at t = {extremes.time[row]:.3f} s"
    if "joint_maxima" in results.streams and results.rows("joint_maxima"):
        areas = free_areas(results, joint)
        names = (f"{joint}/slip", f"{joint}/slid")
        maxima = [results.series("joint_maxima", name, -1) for name in names]
        slip, share = np.array(maxima) @ areas / areas.sum()
    yield Check("sliding safety", where, float(safety), limits.sliding_safety, "-", at_least=True)
    yield Check("mean of the largest slip", joint, float(slip), limits.mean_slip, "m")
    yield Check("share of the area that slid", joint, float(share), limits.slid_area, "-")
    yield Check("residual slip", joint, residual, limits.residual_slip, "m")


def _drift(
    results: Results, groups: Collection[str] | None, crest: str | None, limit: float | None
) -> Check:
    """Return the check of the crest's largest horizontal displacement from the static state."""
    reference = usual_reference(results)
    where, value = "no crest point given" if crest is None else crest, np.nan
    # Supports that move differently give absolute displacements, without a reference.
    if crest is not None and "histories" in results.streams and (reference or results.relative):
        body, point = Body(results, groups), results.point_index(crest)
        up = 1 if body.plane else 2
        bottom = body.nodes[body.seen, up].min()
        height = float(results.static("histories/points")[point, up] - bottom)
        moved = [displacement_history(results, crest, x, reference)[1] for x in COMPONENTS[:up]]
        value = float(np.linalg.norm(moved, axis=0).max()) / height
        where = f"{crest}, height {height:.4g} m"
    return Check("crest displacement / height", where, value, limit, "-")
