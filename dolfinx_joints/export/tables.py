# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results files as tables: one row per record or joint, units in the headers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.postprocessing.envelopes import ENVELOPE_NAMES
from dolfinx_joints.postprocessing.joints.resultants import (
    RESULTANT_MEASURES,
    block_resultants,
    joint_resultants,
    resultant_measures,
)
from dolfinx_joints.postprocessing.measures import (
    JOINT_MEASURES,
    common_band,
    joint_extremes,
    joint_measures,
)
from dolfinx_joints.postprocessing.peaks import (
    Peak,
    acceleration_peak,
    displacement_peak,
    joint_peaks,
)
from dolfinx_joints.postprocessing.static_stages import StageEnergy, static_stages
from dolfinx_joints.results.arguments import COMPONENTS, check_results
from dolfinx_joints.results.layout import STAGE_JOINT_ENERGIES
from dolfinx_joints.results.reader import Results, listing

Floats = NDArray[Any]


@dataclass(frozen=True)
class Table:
    """Names of columns with their units, and rows of as many values."""

    header: list[str]
    rows: list[list[Any]]


def tables_of(results: Results, only: str | None = None) -> dict[str, Table]:
    """The tables of `csv_files.write_csv` by name, those for which the file holds something.

    Args:
        results: The run.
        only: The one to make; all unless given.

    Raises:
        ResultsError: The file holds nothing for that table.
    """
    check_results(results)
    makers = _makers(results)
    if only is not None and only not in makers:
        raise ResultsError(f"{results.path} has no table {only!r}; it has {listing(makers)}.")
    return {name: make(results) for name, make in makers.items() if only in (None, name)}


def _makers(results: Results) -> dict[str, Callable[[Results], Table]]:
    """What makes each table for which the file holds something."""
    streams = {name for name in results.streams if results.rows(name)}
    found: dict[str, Callable[[Results], Table]] = {}
    if "statics" in streams:
        found["stages"] = _stages
        if results.joints:
            found["stage_joints"] = _stage_joints
    if "histories" in streams:
        found["histories"] = _histories
        found["peaks"] = _peaks
    if "energy" in streams:
        found["energy"] = partial(_plain, stream="energy")
    if "states" in streams and results.joints:
        found["joints"] = _joints
        found["joint_extremes"] = _joint_extremes
        found["resultants"] = _resultants
    if "resultants" in streams:
        found["blocks"] = _blocks
    if "envelopes" in streams:
        found["envelopes"] = _envelopes
    if "modes/frequency" in results.statics:
        found["modes"] = _modes
    return found


def _columns(columns: Iterable[tuple[str, str, Any]]) -> Table:
    """A table of (name, unit, values)."""
    header, values = [], []
    for name, unit, column in columns:
        header.append(f"{name} [{unit}]")
        values.append(np.asarray(column).tolist())
    return Table(header, [list(row) for row in zip(*values, strict=True)])


def _parts(name: str, unit: str, values: Floats) -> list[tuple[str, str, Floats]]:
    """Columns x, y, z of vectors, shape (rows, 2 or 3)."""
    axes = COMPONENTS[: values.shape[1]]
    return [(f"{name} {axis}", unit, values[:, i]) for i, axis in enumerate(axes)]


def _plain(results: Results, stream: str, without: Sequence[str] = ()) -> Table:
    """All series of a stream: numbers, or vectors by component."""
    rows = results.rows(stream)  # a run that is still writing adds more
    columns: list[tuple[str, str, Any]] = [("time", "s", results.time(stream)[:rows])]
    for name in results.streams[stream]:
        if name not in without:
            values = results.series(stream, name, slice(rows))
            unit = results.unit(stream, name)
            columns += [(name, unit, values)] if values.ndim == 1 else _parts(name, unit, values)
    return _columns(columns)


def _stages(results: Results) -> Table:
    """Displacements, reactions and stresses by static stage."""
    stages = static_stages(results)
    columns: list[tuple[str, str, Any]] = [("load time", "s", [s.load_time for s in stages])]
    for point in results.point_names:
        values = np.array([s.displacement[point] for s in stages])
        columns += _parts(f"displacement of {point}", "m", values)
    for group in stages[0].reaction:
        values = np.array([s.reaction[group] for s in stages])
        columns += _parts(f"reaction of {group}", "N", values)
    for name in ENVELOPE_NAMES:
        values = np.array([s.stresses[name] for s in stages])
        if not np.isnan(values).all():
            columns.append((name, "Pa", values))
    columns += _stage_energies([s.energy for s in stages if s.energy is not None])
    rest = _columns(columns)
    rows = [[stage.name, *row] for stage, row in zip(stages, rest.rows, strict=True)]
    return Table(["stage", *rest.header], rows)


def _stage_energies(energies: Sequence[StageEnergy]) -> list[tuple[str, str, Any]]:
    """Columns of energies and jumps by static stage; without energies no columns."""
    names = energies[0].loads if energies else ()
    columns: list[tuple[str, str, Any]] = [
        (f"work of {name}", "J", [energy.loads[name] for energy in energies]) for name in names
    ]
    words = {
        "supports": "work of supports",
        "strain": "strain energy",
        "plastic": "plastic work",
        "water_released": "energy released with water",
        "error": "error of the energies",
        "scale": "largest energy",
        "jump_count": "jumps",
        "jump_energy": "energy released by jumps",
    }
    for name, text in words.items() if energies else ():
        unit = "-" if name == "jump_count" else "J"
        columns.append((text, unit, [getattr(energy, name) for energy in energies]))
    return columns


def _stage_joints(results: Results) -> Table:
    """Joints by static stage."""
    units = {"normal_force": "N", "shear_force": "N", "sliding_safety": "-", "contact": "-"}
    units |= {"opening_max": "m", "slip_max": "m", "pressure_max": "Pa", "water_force": "N"}
    header = ["stage", "joint", *(f"{what} [{unit}]" for what, unit in units.items())]
    rows, stages = [], static_stages(results)
    for stage in stages:
        for name, joint in stage.joints.items():
            energies = {} if stage.energy is None else stage.energy.joints[name]
            values = (getattr(joint, what) for what in units)
            rows.append([stage.name, name, *values, *energies.values()])
    if stages[0].energy is not None:
        header += [f"{term} [J]" for term in STAGE_JOINT_ENERGIES]
    return Table(header, rows)


def _histories(results: Results) -> Table:
    """Motions point by point, then what is one per step."""
    streams = results.streams["histories"]
    of_points = [n for n in streams if results.series("histories", n, slice(0)).ndim == 3]
    rest = _plain(results, "histories", of_points)
    columns: list[tuple[str, str, Any]] = []
    for name in of_points:
        values = results.series("histories", name, slice(len(rest.rows)))
        unit = results.unit("histories", name)
        motion = name if results.relative else f"absolute {name}"
        motion = f"raw {motion}" if name == "acceleration" else motion
        for i, point in enumerate(results.point_names):
            columns += _parts(f"{motion} of {point}", unit, values[:, i])
    motions = _columns(columns)
    header = [rest.header[0], *motions.header, *rest.header[1:]]
    both = zip(rest.rows, motions.rows, strict=True)
    return Table(header, [[row[0], *more, *row[1:]] for row, more in both])


def _peaks(results: Results) -> Table:
    """Largest values with their times and places, a row each."""
    found: list[tuple[str, str, Peak]] = []
    moved = "displacement" if results.relative else "absolute displacement"
    for point in results.point_names:
        what = f"{moved} of {point} from the static state"
        found.append((what, "m", displacement_peak(results, [point])))
        if "acceleration" in results.streams["histories"]:
            what = f"absolute acceleration of {point} up to {common_band(results):.3g} Hz"
            found.append((what, "m/s^2", acceleration_peak(results, [point])))
    for joint in results.joints if "states" in results.streams else ():
        units = {"opening": "m", "slip": "m", "safety": "-"}
        peaks = joint_peaks(results, joint)
        found += [(f"{name} of {joint}", units[name], peak) for name, peak in peaks.items()]
    header = ["peak", "value", "unit", "time [s]", "component", "x [m]", "y [m]", "z [m]"]
    rows = [
        [what, peak.value, unit, peak.time, peak.name[-1:], *map(float, peak.place)]
        for what, unit, peak in found
    ]
    return Table(header, rows)


def _joints(results: Results) -> Table:
    """Extremes by joint."""
    units = {"opening": "m", "slip": "m", "pressure": "Pa", "share": "-"}
    units |= {"safety": "-", "normal": "N", "shear": "N", "contact": "-", "flatness": "-"}
    names = (*JOINT_MEASURES, *RESULTANT_MEASURES)
    header = ["joint"]
    for name in names:
        unit = "s" if name.endswith("_time") else units[name.split("_")[0]]
        header.append(f"{name} [{unit}]")
    rows, forces = [], resultant_measures(results)
    for joint, measures in joint_measures(results).items():
        both = measures | forces[joint]
        rows.append([joint, *(both[name] for name in names)])
    return Table(header, rows)


def _resultants(results: Results) -> Table:
    """Resultants of each joint at each record."""
    parts = {}
    for joint in results.joints:
        one = joint_resultants(results, joint)
        assert one.time is not None
        columns: list[tuple[str, str, Any]] = [("time", "s", one.time)]
        columns += _parts("effective force", "N", one.force)
        columns += _parts("moment about the centroid", "N m", one.moment)
        columns += _parts("total force", "N", one.total_force)
        columns += _parts("total moment about the centroid", "N m", one.total_moment)
        columns.append(("normal force", "N", one.normal_force))
        columns += _parts("shear force", "N", one.shear)
        columns.append(("shear force", "N", one.shear_force))
        columns.append(("sliding safety", "-", one.sliding_safety))
        columns.append(("sliding safety of the resultants", "-", one.plane_safety))
        columns.append(("share of area under pressure", "-", one.contact))
        columns += _parts("normal force acts at", "m", one.line_of_action)
        columns.append(("flatness", "-", np.full(len(one.time), one.geometry.flatness)))
        parts[joint] = _columns(columns)
    return _by_joint(parts)


def _joint_extremes(results: Results) -> Table:
    """Largest opening, slip and pressure of each joint and its safety at each record."""
    parts = {}
    for joint in results.joints:
        one = joint_extremes(results, joint)
        columns: list[tuple[str, str, Any]] = [("time", "s", one.time)]
        columns.append(("largest opening", "m", one.opening))
        columns += _parts("largest opening at", "m", one.opening_at)
        columns.append(("largest slip", "m", one.slip))
        columns += _parts("largest slip at", "m", one.slip_at)
        columns.append(("largest pressure", "Pa", one.pressure))
        columns.append(("sliding safety", "-", one.safety))
        parts[joint] = _columns(columns)
    return _by_joint(parts)


def _by_joint(parts: dict[str, Table]) -> Table:
    """Tables of joints, alike, as one whose first column names the joint."""
    header = ["joint", *next(iter(parts.values())).header]
    return Table(header, [[joint, *row] for joint, part in parts.items() for row in part.rows])


def _blocks(results: Results) -> Table:
    """Forces of the joints on each block at each record."""
    found = block_resultants(results)
    parts = []
    for i in range(len(found.mass)):
        columns: list[tuple[str, str, Any]] = [("time", "s", found.time)]
        columns += _parts("effective force", "N", found.force[:, i])
        columns += _parts("total force", "N", found.total_force[:, i])
        columns += _parts("total moment about the centre", "N m", found.total_moment[:, i])
        count = len(found.time)
        columns.append(("mass", "kg", np.full(count, found.mass[i])))
        columns += _parts("centre", "m", np.tile(found.centre[i], (count, 1)))
        parts.append(_columns(columns))
    rows = [[i, *row] for i, part in enumerate(parts) for row in part.rows]
    return Table(["block", *parts[0].header], rows)


def _envelopes(results: Results) -> Table:
    """Envelopes by vertex."""
    numbers = results.static("envelopes/nodes")
    columns: list[tuple[str, str, Any]] = [("node", "-", numbers)]
    columns += _parts("position", "m", results.static("mesh/nodes")[numbers])
    for name in ENVELOPE_NAMES:
        columns.append((name, "Pa", results.series("envelopes", name, -1)))
    return _columns(columns)


def _modes(results: Results) -> Table:
    """Frequencies, participation factors and effective masses."""
    frequency = results.static("modes/frequency")
    columns: list[tuple[str, str, Any]] = [
        ("mode", "-", np.arange(1, len(frequency) + 1)),
        ("frequency", "Hz", frequency),
    ]
    for name in ("participation", "effective_mass", "effective_share"):
        where = f"modes/{name}"
        columns += _parts(name.replace("_", " "), results.unit(where), results.static(where))
    return _columns(columns)
