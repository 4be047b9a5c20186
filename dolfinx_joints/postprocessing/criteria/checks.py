# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Table of the checks of a dam: criterion, place, value, limit, and whether the limit is met.

Default limits are those of the linear criteria of USACE EM 1110-2-6053 (2007) and of Y. Ghanaat and
A. Chudgar; check them against the edition that applies. Tension may be at most twice the tensile
strength, which is the static one unless `Strength` has a dynamic factor. The overstressed area may
be 15 % of the section of a gravity dam, or 20 % of the surface of an arch dam. The time of
overstress is limited by a line from 0.3 s (gravity dam) or 0.4 s (arch dam) at a ratio of 1 to zero
at 2.
"""

from __future__ import annotations

import csv
from collections.abc import Collection, Iterator
from os import PathLike
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import PlausibilityWarning, warn
from dolfinx_joints.common.parameters import check_choice, check_kind_of, real
from dolfinx_joints.postprocessing.body import Body, face_areas, jointed_groups
from dolfinx_joints.postprocessing.envelopes import DYNAMIC_TENSILE, FACETS, LEVELS, STAGE_STRESSES
from dolfinx_joints.postprocessing.frames import usual_reference, zero_name
from dolfinx_joints.postprocessing.joints.extremes import joint_extremes
from dolfinx_joints.postprocessing.measures import displacement_history, slip_in_tail
from dolfinx_joints.results.arguments import COMPONENTS, check_results
from dolfinx_joints.results.joint_points import free_areas, since
from dolfinx_joints.results.reader import Results

Found = tuple[str, str, float, float | None]  # name, place, value, limit if the place sets it
_WITHIN_ROUNDING = 1e-9, 0.0  # tolerances of values that count as the largest one; first is named


class StressRatios:
    """Stresses divided by strengths at the vertices of cell groups that have a strength."""

    def __init__(self, results: Results, groups: Collection[str] | None) -> None:
        self._results, self._body = results, Body(results, groups)
        nodes, strength = (results.static(n) for n in ("envelopes/nodes", DYNAMIC_TENSILE))
        self._rows = np.flatnonzero(np.isfinite(strength) & np.isin(nodes, self._body.seen))
        self._nodes = nodes[self._rows]
        if not len(self._rows):
            raise ValueError(f"{results.path} has no stresses at vertices with a strength.")

    def demands(self, time_limit: float | None) -> Iterator[Found]:
        """Yield the recorded values; ``time_limit`` is that of the time of overstress [s]."""
        streams, rows = self._results.streams, self._results.rows
        if STAGE_STRESSES["principal_max"] in streams.get("statics", ()):
            yield self._worst("static_tension", "statics", "principal_max", "tensile")
            yield self._worst("static_compression", "statics", "principal_min", "compressive")
        if "envelopes" in streams and rows("envelopes"):
            yield self._worst("tension", "envelopes", "principal_max", "dynamic_tensile")
            yield self._worst("compression", "envelopes", "principal_min", "compressive")
            yield self._area()
            yield self._time(time_limit)

    def _ratios(self, stream: str, series: str, strength: str) -> Floats:
        """Return stress / strength of all records of an envelope, shape (records, n)."""
        series = STAGE_STRESSES[series] if stream == "statics" else series
        stress = self._results.series(stream, series)[:, self._rows] / self._capacity(strength)
        return -stress if strength == "compressive" else stress

    def _capacity(self, strength: str) -> Floats:
        """Return a strength of the vertices, shape (n,), [Pa]."""
        return np.asarray(self._results.static(f"envelopes/strength/{strength}")[self._rows])

    def _worst(self, name: str, stream: str, series: str, strength: str) -> Found:
        """Return the largest ratio of a series."""
        ratios = self._ratios(stream, series, strength)
        if np.isnan(ratios).any():
            return name, "a stress is not a number", np.nan, None
        record, row = np.argwhere(np.isclose(ratios, ratios.max(), *_WITHIN_ROUNDING))[0].tolist()
        stage = f"after {self._results.stage_names[record]}, " if stream == "statics" else ""
        capacity = 1e-6 * self._capacity(strength)[row]
        values = f"{ratios[record, row] * capacity:.4g} MPa of {capacity:.4g} MPa"
        return name, f"{values}, {stage}{self._place(row)}", ratios.max(), None

    def _area(self) -> Found:
        """Return the overstressed share of the recorded facets, in 2-D of the cells.

        If no facets are named in ``envelopes``, these are the boundary facets without joints. The
        area of each facet or cell is divided equally among its vertices.
        """
        faces, nodes = self._body.free, self._body.nodes
        if FACETS in self._results.statics:
            faces = self._results.static(FACETS)
        if faces.shape[1] == 2:
            return "overstressed_area", "stresses are recorded along lines only", np.nan, None
        faces = faces[np.isin(faces, self._nodes).all(axis=1)]
        share = face_areas(nodes, faces) / faces.shape[1]
        area = np.bincount(faces.ravel(), np.repeat(share, faces.shape[1]), len(nodes))
        ratios = self._ratios("envelopes", "principal_max", "dynamic_tensile")[-1]
        if not area.any() or np.isnan(ratios).any():
            return "overstressed_area", "no faces with stresses at all vertices", np.nan, None
        over = area[self._nodes[ratios > 1.0]].sum() / area.sum()
        return "overstressed_area", f"of {area.sum():.4g} m²", over, None

    def _time(self, limit: float | None) -> Found:
        """Return the time of overstress where it is largest relative to its limit.

        The limit falls linearly from ``limit`` at level 1 to zero at level 2. Without a limit the
        longest time at level 1 is returned.
        """
        levels = LEVELS[:1] if limit is None else LEVELS
        time = self._results.series("envelopes", "overstress_time", -1)[self._rows, : len(levels)]
        if np.isnan(time).any():
            return "overstress_time", "a time is not a number", np.nan, None
        limits = (1.0 if limit is None else limit) * (2.0 - levels)
        with np.errstate(divide="ignore"):
            ratio = np.divide(time, limits, out=np.zeros_like(time), where=time > 0.0)
        row, level = np.argwhere(np.isclose(ratio, ratio.max(), *_WITHIN_ROUNDING))[0].tolist()
        where = f"above {levels[level]:.1f} x dynamic tensile strength, {self._place(row)}"
        allowed = None if limit is None else float(limits[level])
        return "overstress_time", where, time[row, level], allowed

    def _place(self, row: int) -> str:
        """Return the cell groups and the coordinates of a vertex."""
        node, results = self._nodes[row], self._results
        cells = results.static("mesh/cells")
        groups = [name for name in results.statics if name.startswith("mesh/groups/")]
        own = [name.split("/", 2)[2] for name in groups if node in cells[results.static(name)]]
        axes = 2 if self._body.plane else 3
        place = ", ".join(f"{round(x, 6) + 0.0:.4g}" for x in self._body.nodes[node][:axes])
        return f"{' and '.join(own)} ({place}) m".strip()


# By the name of the limit: criterion, unit, and limits of a gravity and an arch dam.
CRITERIA: dict[str, tuple[str, str, float | None, float | None]] = {
    "static_tension": ("static tension / tensile strength", "-", 1.0, 1.0),
    "static_compression": ("static compression / compressive strength", "-", 1.0, 1.0),
    "tension": ("tension / dynamic tensile strength", "-", 2.0, 2.0),
    "compression": ("compression / compressive strength", "-", 1.0, 1.0),
    "overstressed_area": ("overstressed share of the area", "-", 0.15, 0.2),
    "overstress_time": ("time of overstress", "s", 0.3, 0.4),
    "sliding_safety": ("least sliding safety (1: slides at some instant)", "-", None, None),
    "mean_slip": ("mean of the largest slip of each point", "m", None, None),
    "slid_area": ("share of the area that slid", "-", None, None),
    "residual_slip": ("residual slip, mean of the last second", "m", None, None),
    "drift": ("crest displacement / height", "-", None, None),
}

# The slip at the end is not residual if it varies by more than this share in the last second.
AT_REST = 0.1


class Check(NamedTuple):
    """Row of the table.

    ``met`` is yes, no, "no limit", "not recorded" without a value, or the status of an unfinished
    run that has met the limit so far, such as "so far (failed)".
    """

    criterion: str
    where: str
    value: float
    limit: float | None
    unit: str
    met: str


class Checks(tuple[Check, ...]):
    """Rows of the table, which prints as text."""

    __slots__ = ()

    def __str__(self) -> str:
        rows = ([f"{c:.4g}" if isinstance(c, float) else c or "" for c in row] for row in self)
        table = [list(Check._fields), *rows]
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in table)

    def write_csv(self, path: str | PathLike[str]) -> None:
        """Write the table to a CSV file."""
        with Path(path).open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([Check._fields, *self])


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

    A row without a recorded value or without a limit is not judged. Stresses need
    ``ResultsMonitor(envelopes=..., strength=...)``. In 3-D record the faces of the dam, such as
    ``envelopes=["upstream", "downstream"]``: the overstressed area is a share of these faces. The
    least sliding safety of a joint is 1 if the joint slides at any instant, even if the slip is
    negligible; limits of ``mean_slip`` and ``residual_slip`` judge the slip.

    Args:
        results: The run.
        kind: Kind of the dam, for the default limits of `CRITERIA`.
        groups: Cell groups whose stresses are compared, by default those with joints, as in
            reports; all if no group has joints.
        crest: Monitor point whose largest horizontal displacement from the static state is compared
            with its height above the lowest node of the groups.
        limits: Limits in SI units, None for no limit: ``static_tension``, ``static_compression``,
            ``tension``, ``compression``, ``overstressed_area``, ``overstress_time`` (at a ratio of
            1), ``sliding_safety`` (a lower limit), ``mean_slip``, ``slid_area``, ``residual_slip``,
            ``drift``.
    """
    check_results(results)
    if groups is None and "mesh/cells" in results.statics:
        groups = jointed_groups(results)
    check_arguments((), **limits)
    allowed = {name: row[2 if kind == "gravity" else 3] for name, row in CRITERIA.items()} | limits
    values: list[Found] = [_drift(results, groups, crest)]
    for joint in results.joints if "states" in results.streams else ():
        values += _sliding(results, joint)
    moving = [where for name, where, *_ in values if name == "residual_slip" and "varies" in where]
    if moving and allowed["residual_slip"] is not None:
        text = f"{results.path}: the motion has not ended, so slip is not residual ({moving[0]})"
        warn(f"{text}; run longer, or use to_rest.", PlausibilityWarning)
    if DYNAMIC_TENSILE in results.statics:
        values += StressRatios(results, groups).demands(allowed["overstress_time"])
    rows, yes = [], "yes" if results.complete else f"so far ({results.status})"
    for name, (criterion, unit, *_) in CRITERIA.items():
        missing: Found = (name, "", np.nan, None)
        for _, where, value, limit in [row for row in values if row[0] == name] or [missing]:
            limit = allowed[name] if limit is None else limit
            met = "no limit" if limit is None else yes
            if limit is not None and (value < limit if name == "sliding_safety" else value > limit):
                met = "no"
            if np.isnan(value) or (np.isinf(value) and name != "sliding_safety"):
                met = "not recorded"
            bound = None if limit is None else float(limit)
            rows.append(Check(criterion, where, float(value), bound, unit, met))
    return Checks(rows)


def check_arguments(points: Collection[str], **given: Any) -> None:
    """Check arguments of `checks` for a run with these monitor points."""
    check_choice("checks: kind", given.pop("kind", "gravity"), ("gravity", "arch"))
    if (crest := given.pop("crest", None)) is not None:
        check_choice("checks: crest", crest, points)
    given.pop("groups", None)
    for name, limit in given.items():
        fits = name in CRITERIA and (limit is None or real(limit) >= 0.0)
        check_kind_of(name, limit, fits, f"a limit of zero or more of {', '.join(CRITERIA)}")


def _sliding(results: Results, joint: str) -> Iterator[Found]:
    """Yield the values of a joint."""
    extremes, areas = joint_extremes(results, joint), free_areas(results, joint)
    row = np.where(np.isnan(extremes.safety), np.inf, extremes.safety).argmin()
    where = f"{joint} at t = {extremes.time[row]:.3f} s"
    yield "sliding_safety", where, extremes.safety[row], None
    is_recorded = "joint_maxima" in results.streams and results.rows("joint_maxima")
    for name, series in (("mean_slip", "slip"), ("slid_area", "slid")):
        mean = np.nan
        if is_recorded:
            values = results.series("joint_maxima", f"{joint}/{series}", -1)
            mean = float(values @ areas / areas.sum())
        yield name, joint + since(results, name), mean, None
    where, (slip, variation) = joint + since(results, "slip"), slip_in_tail(results, joint)
    if variation > AT_REST * slip:
        where += f", varies by {1e3 * variation:.3g} mm in the last second"
    yield "residual_slip", where, slip, None


def _drift(results: Results, groups: Collection[str] | None, crest: str | None) -> Found:
    """Return the drift of the crest, relative to the ground."""
    reference = usual_reference(results)
    is_recorded = "histories" in results.streams and (reference or results.relative)
    if crest is None or not is_recorded:
        where = "no displacement relative to the ground" if crest else "no crest point given"
        return "drift", where, np.nan, None
    body, point = Body(results, groups), results.point_index(crest)
    up = 1 if body.plane else 2
    lowest = body.nodes[body.seen, up].min()
    height = results.static("histories/points")[point, up] - lowest
    if height <= 1e-6 * np.ptp(body.nodes[:, up]):  # rounding
        return "drift", f"{crest} is not above the lowest node of the groups", np.nan, None
    moved = [displacement_history(results, crest, x, reference)[1] for x in COMPONENTS[:up]]
    largest = np.linalg.norm(moved, axis=0).max()
    where = f"{crest}, height {height:.4g} m, {zero_name(results, reference)}"
    return "drift", where, largest / height, None
