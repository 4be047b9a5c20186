# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables of a results file, with units in the headers, and their CSV files.

There is one row per record or joint. Numbers in CSV files have all digits, so that reading restores
the same values.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.common.files import replacing
from dolfinx_joints.common.parameters import cell
from dolfinx_joints.export.paraview import check_free
from dolfinx_joints.postprocessing.criteria.sliding import recorded_blocks
from dolfinx_joints.postprocessing.envelopes import ENVELOPE_NAMES
from dolfinx_joints.postprocessing.frames import static_displacement, zero_name
from dolfinx_joints.postprocessing.joints.resultants import (
    block_resultants,
    joint_resultants,
    resultant_measures,
)
from dolfinx_joints.postprocessing.measures import common_band, joint_extremes, joint_measures
from dolfinx_joints.postprocessing.peaks import (
    Peak,
    acceleration_peak,
    displacement_peak,
    joint_peaks,
)
from dolfinx_joints.postprocessing.static_stages import StageEnergy, static_stages
from dolfinx_joints.results.arguments import COMPONENTS, check_results
from dolfinx_joints.results.joint_points import since
from dolfinx_joints.results.quantities import TABLE, Quantity, row_of, rows_below
from dolfinx_joints.results.reader import Results

Floats = NDArray[Any]


@dataclass(frozen=True)
class Table:
    """Column names with units, and rows of values."""

    header: list[str]
    rows: list[list[Any]]


def tables_of(results: Results, *only: str) -> dict[str, Table]:
    """Return the tables of `write_csv` by name, except tables without data in the file.

    With names of tables, only these are made.
    """
    check_results(results)
    streams = {name for name in results.streams if results.rows(name)}
    streams |= {"sliding"} if "sliding" in results.metadata else set()
    streams |= {"modes"} if "modes/frequency" in results.statics else set()
    return {
        name: make(results)
        for name, (stream, of_joints, make) in TABLES.items()
        if stream in streams and (results.joints or not of_joints) and name in (only or TABLES)
    }


def _columns(columns: Iterable[tuple[str, str, Any]]) -> Table:
    """Return a table of columns given as (name, unit, values)."""
    header, values = [], []
    for name, unit, column in columns:
        header.append(f"{name} [{unit}]")
        values.append(np.asarray(column).tolist())
    return Table(header, [list(row) for row in zip(*values, strict=True)])


def _vector(name: str, unit: str, values: Floats) -> list[tuple[str, str, Floats]]:
    """Return columns x, y, z of vectors, shape (rows, 2 or 3)."""
    axes = COMPONENTS[: values.shape[1]]
    return [(f"{name} {axis}", unit, values[:, i]) for i, axis in enumerate(axes)]


def _all_series(results: Results, stream: str, without: Sequence[str] = ()) -> Table:
    """Return a table of all scalar and vector series of a stream, except ``without``."""
    rows = results.rows(stream)  # fixed here, as a run in progress adds rows
    columns: list[tuple[str, str, Any]] = [("time", "s", results.time(stream)[:rows])]
    for name in results.streams[stream]:
        if name not in without:
            values = results.series(stream, name, slice(rows))
            unit = results.unit(stream, name)
            columns += [(name, unit, values)] if values.ndim == 1 else _vector(name, unit, values)
    return _columns(columns)


def _stages(results: Results) -> Table:
    """Return the table of displacements, reactions, stresses and energies by static stage."""
    stages = static_stages(results)
    columns: list[tuple[str, str, Any]] = [("load time", "s", [s.load_time for s in stages])]
    for point in results.point_names:
        values = np.array([s.displacement[point] for s in stages])
        columns += _vector(f"displacement of {point} from the unloaded body", "m", values)
    for group in stages[0].reaction:
        values = np.array([s.reaction[group] for s in stages])
        columns += _vector(f"reaction of {group}", "N", values)
    for name in ENVELOPE_NAMES:
        values = np.array([s.stresses[name] for s in stages])
        if not np.isnan(values).all():
            columns.append((name, "Pa", values))
    columns += _stage_energies([s.energy for s in stages if s.energy is not None])
    numbers = _columns(columns)
    rows = [[stage.name, *row] for stage, row in zip(stages, numbers.rows, strict=True)]
    return Table(["stage", *numbers.header], rows)


def _stage_energies(energies: Sequence[StageEnergy]) -> list[tuple[str, str, Any]]:
    """Return columns of energies and jumps by static stage, an empty list without energies."""
    names = energies[0].loads if energies else ()
    columns: list[tuple[str, str, Any]] = [
        (f"work of {name}", "J", [energy.loads[name] for energy in energies]) for name in names
    ]
    plain, jumps = rows_below("statics", "energy/"), rows_below("statics", "jump")
    for row in (*plain, *jumps) if energies else ():
        name = "jump_count" if row.name == "jumps" else row.key
        columns.append((row.label, row.unit, [getattr(energy, name) for energy in energies]))
    return columns


def _stage_joints(results: Results) -> Table:
    columns = TABLE["stage_joints"]
    header = ["stage", "joint", *(f"{row.name} [{row.unit}]" for row in columns)]
    rows, stages = [], static_stages(results)
    for stage in stages:
        for name, joint in stage.joints.items():
            energies = {} if stage.energy is None else stage.energy.joints[name]
            values = (getattr(joint, row.name) for row in columns)
            rows.append([stage.name, name, *values, *energies.values()])
    if stages[0].energy is not None:
        header += [f"{row.key} [J]" for row in rows_below("statics", "energy/joints/*/")]
    return Table(header, rows)


def _histories(results: Results) -> Table:
    """Return the table of the steps: motions point by point, then the other series."""
    streams = results.streams["histories"]
    of_points = [n for n in streams if results.series("histories", n, slice(0)).ndim == 3]
    other_series = _all_series(results, "histories", of_points)
    columns: list[tuple[str, str, Any]] = []
    for name in of_points:
        values = results.series("histories", name, slice(len(other_series.rows)))
        unit = results.unit("histories", name)
        motion = name if results.relative else f"absolute {name}"
        motion = f"raw {motion}" if name == "acceleration" else motion
        zero = ""
        if name == "displacement":
            values = values - static_displacement(results, "point_displacement")
            zero = f" {zero_name(results)}"
        for i, point in enumerate(results.point_names):
            columns += _vector(f"{motion} of {point}{zero}", unit, values[:, i])
    motions = _columns(columns)
    header = [other_series.header[0], *motions.header, *other_series.header[1:]]
    row_pairs = zip(other_series.rows, motions.rows, strict=True)
    return Table(header, [[row[0], *motion_row, *row[1:]] for row, motion_row in row_pairs])


def _peaks(results: Results) -> Table:
    """Return the table of largest values, one per row, with times and places."""
    peaks: list[tuple[str, str, Peak]] = []
    quantity = "displacement" if results.relative else "absolute displacement"
    for point in results.point_names:
        label = f"{quantity} of {point} {zero_name(results)}"
        peaks.append((label, "m", displacement_peak(results, [point])))
        if "acceleration" in results.streams["histories"]:
            label = f"absolute acceleration of {point} up to {common_band(results):.3g} Hz"
            peaks.append((label, "m/s^2", acceleration_peak(results, [point])))
    for joint in results.joints if "states" in results.streams else ():
        for name, peak in joint_peaks(results, joint).items():
            label = f"{name} of {joint}{since(results, name)}"
            peaks.append((label, row_of("joints", f"{joint}/{name}")[0].unit, peak))
    header = ["peak", "value", "unit", "time [s]", "component", "x [m]", "y [m]", "z [m]"]
    rows = [
        [label, peak.value, unit, peak.time, peak.name[-1:], *map(float, peak.place)]
        for label, unit, peak in peaks
    ]
    return Table(header, rows)


def _joints(results: Results) -> Table:
    columns = (*TABLE["measures"], *TABLE["resultant_measures"])
    header = ["joint", *(f"{row.name} [{row.unit}]" for row in columns)]
    rows, forces = [], resultant_measures(results)
    for joint, measures in joint_measures(results).items():
        values = measures | forces[joint]
        rows.append([joint, *(values[row.name] for row in columns)])
    return Table(header, rows)


def _time_table(rows: Iterable[Quantity], values: Mapping[str, Any], time: Floats) -> Table:
    """Return a table with one row per time of the quantities that have a label."""
    columns: list[tuple[str, str, Any]] = [("time", "s", time)]
    for row in rows:
        if row.label and row.key in values:
            column = row.label, row.unit, values[row.key]
            columns += _vector(*column) if column[2].ndim > 1 else [column]
    return _columns(columns)


def _resultants(results: Results) -> Table:
    parts, rows = {}, rows_below("resultants", "joints/*/")
    for joint in results.joints:
        resultants = joint_resultants(results, joint)
        assert resultants.time is not None
        values = {row.key: getattr(resultants, row.key) for row in rows if row.key != "flatness"}
        values["flatness"] = np.full(len(resultants.time), resultants.geometry.flatness)
        parts[joint] = _time_table(rows, values, resultants.time)
    return _stack("joint", parts)


def _joint_extremes(results: Results) -> Table:
    extremes = {joint: joint_extremes(results, joint) for joint in results.joints}
    series = rows_below("joints", "*/")
    rows = [replace(row, label=row.label + since(results, row.key)) for row in series]
    return _stack("joint", {n: _time_table(rows, e.values, e.time) for n, e in extremes.items()})


def _blocks(results: Results) -> Table:
    blocks, parts, rows = block_resultants(results), {}, rows_below("resultants", "blocks/")
    for i in range(len(blocks.mass)):
        values = {row.key: getattr(blocks, row.key) for row in rows if row.label}
        for name in ("mass", "centre"):
            values[name] = np.repeat(values[name][None], len(blocks.time), axis=0)
        parts[i] = _time_table(rows, {k: value[:, i] for k, value in values.items()}, blocks.time)
    return _stack("block", parts)


def _sliding(results: Results) -> Table:
    parts, rows = {}, TABLE["sliding"]
    for name, block in recorded_blocks(results).items():
        parts[name] = _time_table(rows, {r.key: getattr(block, r.key) for r in rows}, block.time)
    return _stack("block", parts)


def _stack(kind: str, parts: Mapping[Any, Table]) -> Table:
    """Return tables with equal columns as one; the new first column names the joint or block."""
    header = [kind, *next(iter(parts.values())).header]
    return Table(header, [[name, *row] for name, part in parts.items() for row in part.rows])


def _envelopes(results: Results) -> Table:
    numbers = results.static("envelopes/nodes")
    columns: list[tuple[str, str, Any]] = [("node", "-", numbers)]
    columns += _vector("position", "m", results.static("mesh/nodes")[numbers])
    for name in ENVELOPE_NAMES:
        columns.append((name, "Pa", results.series("envelopes", name, -1)))
    return _columns(columns)


def _modes(results: Results) -> Table:
    frequency = results.static("modes/frequency")
    columns: list[tuple[str, str, Any]] = [
        ("mode", "-", np.arange(1, len(frequency) + 1)),
        ("frequency", "Hz", frequency),
    ]
    for name in ("participation", "effective_mass", "effective_share"):
        where = f"modes/{name}"
        columns += _vector(name.replace("_", " "), results.unit(where), results.static(where))
    return _columns(columns)


# For each table: the required stream, True if joints are required, and the making function.
TABLES: dict[str, tuple[str, bool, Callable[[Results], Table]]] = {
    "stages": ("statics", False, _stages),
    "stage_joints": ("statics", True, _stage_joints),
    "histories": ("histories", False, _histories),
    "peaks": ("histories", False, _peaks),
    "energy": ("energy", False, partial(_all_series, stream="energy")),
    "joints": ("states", True, _joints),
    "joint_extremes": ("states", True, _joint_extremes),
    "resultants": ("states", True, _resultants),
    "blocks": ("resultants", False, _blocks),
    "sliding": ("sliding", True, _sliding),
    "envelopes": ("envelopes", False, _envelopes),
    "modes": ("modes", False, _modes),
}


@checked
def write_csv(results: Results, folder: str | Path, *, overwrite: bool = False) -> list[Path]:
    """Write the tables of a results file as CSV files.

    - ``stages.csv``: one row per static stage: displacements of the points relative to the
      unloaded body, reactions, recorded extreme stresses, energies and jumps;
    - ``stage_joints.csv``: one row per static stage and joint: `measures.StageJoint`, and energies
      of `measures.StageEnergy`;
    - ``histories.csv``: one row per step: displacements and raw accelerations of the points
      (relative to the ground unless called "absolute"), ground motion, joint shares, reactions;
    - ``peaks.csv``: largest displacement and acceleration of each point, largest opening and slip
      and smallest safety of each joint, with times and places;
    - ``energy.csv``: one row per step: the terms of the energy ledger;
    - ``joints.csv``: one row per joint: `measures.joint_measures` and
      `resultants.resultant_measures`;
    - ``joint_extremes.csv``: one row per joint and step: `measures.joint_extremes`;
    - ``resultants.csv``: one row per joint and record: `resultants.joint_resultants`;
    - ``blocks.csv``: one row per block and record, if recorded;
    - ``sliding.csv``: one row per sliding block and record: `sliding.BlockSliding`;
    - ``envelopes.csv``: one row per vertex, if recorded;
    - ``modes.csv``: one row per mode, for a file of modes.

    The normal force of a joint is positive in compression. Other forces are global components on
    the + side of the joint. If the flatness is below 0.95, normal and shear force are not
    meaningful, because the joint has no distinct normal.

    Args:
        results: The run.
        folder: Folder of the files; created if it is missing.
        overwrite: True to replace existing files.

    Returns:
        Paths of the files.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.RigidJoint(friction_angle_deg=45.0)
        >>> base = [dj.Fixed(group="base")]
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=base, loads=[dj.Gravity()])
        >>> monitor = dj.ResultsMonitor("blocks.h5", points={"top": (0.5, 0.5, 2.0)})
        >>> state = dj.Simulation(model, monitors=[monitor]).statics(name="weight")
        >>> [path.name for path in dj.write_csv(dj.Results("blocks.h5"), "tables")]
        ['stages.csv', 'stage_joints.csv']
    """
    folder, tables = Path(folder), tables_of(results)
    if not tables:
        raise ResultsError(f"{results.path} has no records, so there are no tables to write.")
    paths = {name: folder / f"{name}.csv" for name in tables}
    check_free(paths.values(), overwrite=overwrite)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, path in paths.items():
            _write(tables[name], path)
    except OSError as error:
        raise ResultsError(f"The tables cannot be written to {folder}: {error.strerror}.") from None
    return list(paths.values())


def _write(table: Table, path: Path) -> None:
    """Write a table; if this fails, no incomplete file remains."""
    with replacing(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows(map(cell, row) for row in (table.header, *table.rows))
