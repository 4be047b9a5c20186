# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two runs side by side: the largest difference of each measure and series of their files."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import annotated_types as at
import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.declared import checked
from dolfinx_joints.export.tables import Table, tables_of
from dolfinx_joints.postprocessing.measures import stress_extremes
from dolfinx_joints.results.quantities import row_of
from dolfinx_joints.results.reader import Results, listing

_ROUNDING = 1e-9  # of coordinates and times, and of values next to others of the same unit
# Tables of measures: their name in rows, and the number of columns with names.
_MEASURES = {"joints": ("measures", 1), "stage_joints": ("stages", 2), "modes": ("modes", 1)}
_PER_STEP = ("histories", "energy", "joints")  # streams that may be interpolated in time
_FIELDS = r"(states|envelopes|statics/(displacement|static_displacement|joints|stress)).*"


class Difference(NamedTuple):
    """Largest difference of a measure or a series of two runs, and its place.

    Attributes:
        quantity: Table or stream, and name; ``*`` is the name of a joint, support or load.
        unit: SI unit.
        where: Joint, support, load or monitor point; indices in the record, [point, component] or
            [component]; time or static stage.
        a: Value in the first run.
        b: Value in the second run.
        difference: |b - a|; zero if both are NaN, infinite if only one is.
        scale: Largest absolute value of the quantity in both runs, of all joints, points and
            components at the compared times; of all energies for an energy. It is at least 1e-9 of
            the largest value with the same unit in the table or stream.
        within: True if the relative difference is at most the tolerance. None if it is not judged.
    """

    quantity: str
    unit: str
    where: str
    a: float
    b: float
    difference: float
    scale: float
    within: bool | None

    @property
    def relative(self) -> float:
        """Difference divided by the scale, zero if all values are."""
        return self.difference / (self.scale or 1.0)


class Comparison(NamedTuple):
    """Two runs side by side; its text is a table of the quantities that differ.

    Attributes:
        rows: Largest difference of each measure and each series that both runs have.
        notes: Unfinished runs, and what was interpolated or not compared.
        only: For each run, joints, points, static stages and series that the other does not have.
    """

    rows: list[Difference]
    notes: list[str]
    only: list[list[str]]

    @property
    def within(self) -> bool:
        """True if all judged rows are within the tolerance and both runs have the same names."""
        judged = [row.within for row in self.rows if row.within is not None]
        return bool(judged) and all(judged) and not any(self.only)

    def __str__(self) -> str:
        """Return a line for each quantity that differs, where it differs most."""
        lines = [*self.notes]
        lines += [f"Only in {n}: {listing(o)}." for n, o in zip("ab", self.only, strict=True) if o]
        worst: dict[str, Difference] = {}
        for row in sorted(self.rows, key=lambda row: row.relative, reverse=True):
            worst.setdefault(row.quantity, row)
        rows = [row for row in worst.values() if row.difference]
        lines.append(f"{len(worst) - len(rows)} of {len(worst)} quantities are equal.")
        width = max((len(row.quantity + row.unit) for row in rows), default=0) + 3
        head = f"{'a':>13} {'b':>13} {'difference':>11} {'relative':>9} within  where"
        lines += [f"{'quantity':<{width}} {head}"] if rows else []
        for row in rows:
            numbers = f"{row.a:13.6g} {row.b:13.6g} {row.difference:11.3g} {row.relative:9.2g}"
            judged = {True: "yes", False: "NO", None: "-"}[row.within]
            name = f"{row.quantity} [{row.unit}]"
            lines.append(f"{name:<{width}} {numbers} {judged:>6}  {row.where}".rstrip())
        return "\n".join(lines)


@checked
def compare(
    a: str | Path, b: str | Path, *, tolerance: Annotated[float, at.Ge(0.0)] = 1e-3
) -> Comparison:
    """Compare measures, histories, energies, joints, static stages and fields of two runs.

    Series are compared at common times. If neither run has all times of the other, series of every
    step are interpolated linearly. Stages and monitor points are compared by name, fields only on
    equal meshes. Values that jump are not judged: counts, codes, times and places of largest
    values; nor are raw accelerations of other steps or meshes, and measures of unfinished runs.

    Args:
        a: Results file of the first run.
        b: Results file of the second run.
        tolerance: Largest difference, relative to the largest absolute value of the quantity.

    Raises:
        ResultsError: A file is not a results file.
    """
    with Results(a) as first, Results(b) as second:
        runs, files = (first, second), zip("ab", (first, second), strict=True)
        notes = [f"{name} is {run.status}: {run.path}" for name, run in files if not run.complete]
        if first.relative != second.relative:
            notes.append("Motions are relative to the ground in one run, absolute in the other.")
        if (layouts := sorted({first.layout, second.layout}))[1:]:
            changed = "slips of continued runs and reactions have other meanings"
            notes.append(
                f"Layouts {layouts[0]} and {layouts[1]}: {changed} (docs/results_file.md)."
            )
        one, other = _names(*runs), _names(*runs[::-1])
        failed = [run.status in ("failed", "stopped") for run in runs]
        rows = [*_measures(runs), *_series(runs, notes)]
    only = [[n for n in one if n not in other], [n for n in other if n not in one]]
    if failed[0] != failed[1]:
        only[1 if failed[0] else 0].append("the end of the run")
    largest: dict[Any, float] = {}
    for row in sorted(rows, key=lambda row: row.scale):  # the largest one remains
        largest |= {row.quantity: row.scale, _group(row): row.scale}
    for i, row in enumerate(rows):
        least = largest[_group(row)] * (1.0 if row.unit == "J" else _ROUNDING)
        row = row._replace(scale=max(largest[row.quantity], least))
        rows[i] = row._replace(within=row.within and row.relative <= tolerance)
    return Comparison(rows, notes, only)


def _group(row: Difference) -> tuple[str, str, bool]:
    """Return the key of the values with the same unit in the same table, judged or not."""
    unit = row.quantity if row.unit == "-" else row.unit
    return row.quantity.partition("/")[0], unit, row.within is None


def _names(run: Results, other: Results) -> list[str]:
    """Return the names of joints, points, static stages, streams and series."""
    kinds = {"joint": run.joints, "point": run.point_names, "static stage": run.stage_names}
    kinds["stream"] = [stream for stream in run.streams if stream not in other.streams]
    kinds |= {f"{s}:": names for s, names in run.streams.items() if s not in kinds["stream"]}
    return [f"{kind} {name}" for kind, names in kinds.items() for name in names]


def _numbers(a: Floats, b: Floats) -> tuple[tuple[float, float, float, float], list[int]]:
    """Return a, b, difference and scale of two arrays where they differ most, and the indices."""
    with np.errstate(invalid="ignore"):
        distance = np.abs(b - a)
    equal = (a == b) | (np.isnan(a) & np.isnan(b))
    distance = np.where(equal, 0.0, np.where(np.isnan(distance), np.inf, distance))
    at = np.unravel_index(np.argmax(distance), distance.shape)
    scale = max(float(np.max(np.abs(v), where=np.isfinite(v), initial=0.0)) for v in (a, b))
    return (float(a[at]), float(b[at]), float(distance[at]), scale), [int(i) for i in at]


def _measures(runs: Sequence[Results]) -> Iterator[Difference]:
    """Yield the differences of the measures that both runs have."""
    one, other = map(_measures_of, runs)
    for quantity, unit, where in (key for key in one if key in other):
        pair = (np.array(values[quantity, unit, where]) for values in (one, other))
        judged = unit != "s" and quantity[:8] != "summary/" and all(run.complete for run in runs)
        yield Difference(quantity, unit, where, *_numbers(*pair)[0], judged or None)


def _measures_of(run: Results) -> dict[tuple[str, str, str], float]:
    """Return the measures of a run by quantity, unit, and joint and stage."""
    numbers = {name: v for name, v in run.summary.items() if isinstance(v, int | float)}
    values = {(f"summary/{name}", "-", ""): float(v) for name, v in numbers.items()}
    stresses = stress_extremes(run) if "envelopes" in run.streams else {}
    values |= {(f"measures/{name}", "Pa", ""): value for name, value in stresses.items()}
    tables = tables_of(run, "peaks", *_MEASURES)
    peaks = tables.pop("peaks", Table([], [])).rows
    values |= {(f"peaks/{row[0]}", row[2], ""): abs(row[1]) for row in peaks if row[4]}  # of points
    for name, table in tables.items():
        kind, keys = _MEASURES[name]
        for row in table.rows:
            for heading, value in zip(table.header[keys:], row[keys:], strict=True):
                measure, _, unit = heading.rstrip("]").partition(" [")
                values[f"{kind}/{measure}", unit, ", ".join(map(str, row[:keys]))] = value
    return values


def _series(runs: Sequence[Results], notes: list[str]) -> Iterator[Difference]:
    """Yield the differences of the series that both runs have."""
    points = [name for name in runs[0].point_names if name in runs[1].point_names]
    skipped, same_mesh = set(), _same_mesh(*runs)
    for stream in (stream for stream in runs[0].streams if stream in runs[1].streams):
        records, times, exact = _common_records(runs, stream, notes)
        for name in sorted({*runs[0].streams[stream]} & {*runs[1].streams[stream]} - {"name"}):
            row, where = row_of(stream, name)
            quantity, is_field = f"{stream}/{row.name}", re.match(_FIELDS, f"{stream}/{name}")
            first, second = (run.series(stream, name, slice(0)) for run in runs)
            of_points = first.ndim > 2 and not is_field and stream != "resultants"
            if not of_points and (first.shape != second.shape or (is_field and not same_mesh)):
                skipped.add(quantity)
            elif len(times) and (points or not of_points):
                a, b = (_values(r, stream, name, n) for r, n in zip(runs, records, strict=True))
                if of_points:
                    chosen = ([run.point_index(point) for point in points] for run in runs)
                    a, b = (v[:, numbers] for v, numbers in zip((a, b), chosen, strict=True))
                numbers, (record, *entry) = _numbers(a, b)
                where = points[entry.pop(0)] if of_points else where
                time = times[record] if stream == "statics" else f"t = {times[record]:.6g} s"
                where = f"{where}{entry or ''}, {time}".removeprefix(", ")
                jumps = row.by == "place" or first.dtype.kind == "i"
                jumps |= name == "acceleration" and not (exact and same_mesh)
                yield Difference(quantity, row.unit, where, *numbers, not jumps or None)
    if skipped:
        notes.append(f"Not compared, as the meshes differ: {listing(sorted(skipped))}.")


def _same_mesh(a: Results, b: Results) -> bool:
    """Return True if nodes, cells and joint points of two runs are equal."""
    names = {name for name in {*a.statics} & {*b.statics} if name.startswith(("mesh/", "joints/"))}
    for one, other in ((a.static(name), b.static(name)) for name in names):
        limit = _ROUNDING * np.abs(one).max(initial=0.0)
        if one.shape != other.shape or not np.allclose(one, other, rtol=0.0, atol=limit):
            return False
    return True


def _common_records(
    runs: Sequence[Results], stream: str, notes: list[str]
) -> tuple[list[Floats], Sequence[Any], bool]:
    """Return the compared records of each run, times or stages; True if all times are equal."""
    empty = [name for name, run in zip("ab", runs, strict=True) if not run.rows(stream)]
    if len(empty) == 1:
        notes.append(f"{stream}: not compared, because {empty[0]} has no records.")
        return [], [], True
    if stream == "statics":
        names = [run.stage_names for run in runs]
        stages = [[(name, n[:i].count(name)) for i, name in enumerate(n)] for n in names]
        both = [stage for stage in stages[0] if stage in stages[1]]
        records = [np.array([float(s.index(stage)) for stage in both]) for s in stages]
        return records, [name for name, _ in both], True
    times = [run.time(stream) for run in runs]
    end = min(t.max(initial=0.0) for t in times) * (1.0 + _ROUNDING)
    start = max(t.min(initial=end) for t in times) - _ROUNDING * end
    fewer = min((t[(t >= start) & (t <= end)] for t in times), key=len)
    records = [np.interp(fewer, t, np.arange(len(t))) if fewer.size else fewer for t in times]
    records = [np.where(abs(r - r.round()) < 1e-6, r.round(), r) for r in records]
    common = np.all([r == r.round() for r in records], axis=0)
    counts = f"{len(times[0])} and {len(times[1])}"
    if stream in _PER_STEP and not common.all():
        notes.append(f"{stream}: interpolated in time at {len(fewer)} of {counts} times.")
        return records, fewer, False
    equal = len(times[0]) == len(times[1]) == common.sum()
    if not equal:
        notes.append(f"{stream}: compared at {common.sum()} common times of {counts}.")
    return [r[common] for r in records], fewer[common], equal


def _values(run: Results, stream: str, name: str, records: Floats) -> Floats:
    """Return the values at records, interpolated linearly between them."""
    values, low = run.series(stream, name).astype(float), records.astype(int)
    share = (records - low).reshape(-1, *(1,) * (values.ndim - 1))
    if not share.any():
        return values[low]
    return (1.0 - share) * values[low] + share * values[(low + 1).clip(max=len(values) - 1)]
