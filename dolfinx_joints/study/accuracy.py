# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Error bars: a run is repeated with coarser steps and cells, and its errors are estimated."""

from __future__ import annotations

import os
import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from inspect import signature
from pathlib import Path
from typing import Annotated

import annotated_types as at
import numpy as np

from dolfinx_joints.common.constants import ACCELERATION_BAND
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import StudyError
from dolfinx_joints.postprocessing.peaks import main_values
from dolfinx_joints.results.reader import Results
from dolfinx_joints.study.extrapolation import Cost, cheapest, estimated_error
from dolfinx_joints.study.runner import MPIRUN, Study
from dolfinx_joints.study.table import TABLE, Row, Table, read_rows, write_csv

Run = Callable[..., str | Path | Mapping[str, float]]
Length = Annotated[float, at.Gt(0.0), at.Unit("m")]
Time = Annotated[float, at.Gt(0.0), at.Unit("s")]

GIVEN = "given"
_STEP_ORDER = 2.0  # of the time schemes
_WORKERS = 2  # the other four of long runs together take 1.5 times as long as the given one
_LONG = 4.0  # accelerations are compared in a band that steps of this factor resolve
_PLANE, _QUADRATIC = (5, 9, 69, 70), 68  # VTK's numbers of plane cells; least one of Lagrange cells
# Columns that precede the values in the rows of the runs.
_SECONDS, _CELLS, _DIMENSION, _DEGREE = "processor_s", "cells", "dimension", "degree"
_OWN = (_SECONDS, _CELLS, _DIMENSION, _DEGREE)


@dataclass(frozen=True, repr=False)
class _Measured:
    """Function of a study that makes a run and returns its values and its processor time."""

    run: Run

    def __repr__(self) -> str:
        return repr(self.run)

    def __call__(
        self, folder: Path, *, size: float, dt: float, band: float, function: str
    ) -> dict[str, float]:
        began = clock.process_time()
        made = self.run(folder, size=size, dt=dt)
        values = {_SECONDS: clock.process_time() - began}
        if isinstance(made, Mapping):
            return values | dict(made)
        with Results(made) as results:
            if not results.complete:
                raise StudyError(f"The run in {results.path} is {results.status}, not complete.")
            if "mesh/cells" in results.statics:
                kind = int(results.static("mesh/cell_kind")[0])
                values[_CELLS] = len(results.static("mesh/cells"))
                values[_DIMENSION] = 2 if kind in _PLANE else 3
                values[_DEGREE] = 2 if kind >= _QUADRATIC else 1
            return values | main_values(results, band=band)


@dataclass(frozen=True, kw_only=True, repr=False)
class Accuracy:
    """Estimated errors of a run; `print` shows them as a table.

    Attributes:
        path: Folder of the study; the errors are in ``accuracy.csv``, the runs in ``table.json``.
        size: Cell size of the given run [m].
        dt: Time step of the given run [s].
        target: Allowed relative error, for which the cheapest run is predicted.
        table: Column arrays with a row per value: ``value`` (its name), ``given`` (its number),
            ``error``, and for both directions ``step_error``, ``step_kind``, ``step_order``,
            ``cell_error``, ``cell_kind``, ``cell_order`` (see `Estimate`). ``dt [s]``, ``size [m]``
            and ``seconds [s]`` are those of the predicted run, NaN if a value has no limit.
        runs: Table of the runs, see `read_table`.
        lacking: Names of values of the given run that another run does not have.
    """

    path: Path
    size: float
    dt: float
    target: float
    table: Table
    runs: Table
    lacking: list[str]

    @property
    def bars(self) -> dict[str, tuple[float, float]]:
        """Value and error by name, for `report.write`."""
        columns = (self.table[name].tolist() for name in ("value", "given", "error"))
        return {name: (value, error) for name, value, error in zip(*columns, strict=True)}

    def __repr__(self) -> str:
        head = ["", "value", "error", "of step", "of cells", f"for {100 * self.target:g} %: run"]
        lines = [self._line(i) for i in range(len(self.table["value"]))]
        summed = any(" of all joints " in name for name, *_ in lines)
        rows = [head, *(line for line in lines if not (summed and ": " in line[0]))]
        widths = [max(len(row[column]) for row in rows) for column in range(len(head))]
        cells = [[f"{c:<{w}}" for c, w in zip(row, widths, strict=True)] for row in rows]
        title = f"Estimated errors with cells of {self.size:g} m and steps of {self.dt:g} s"
        return "\n".join([title, *("  ".join(row).rstrip() for row in cells), *self._notes()])

    def _line(self, i: int) -> list[str]:
        row = {name: column[i] for name, column in self.table.items()}
        value, error = abs(row["given"]), row["error"]
        bounded = "no order" in (row["step_kind"], row["cell_kind"])
        texts = [row["value"], f"{row['given']:.4g}", _share(error, value, bounded)]
        for name in ("step", "cell"):
            kind, order = row[f"{name}_kind"], row[f"{name}_order"]
            share = _share(row[f"{name}_error"], value, kind == "no order")
            words = f"{share}, order {order:.1f}" if kind == "order" else f"{share}, {kind}"
            texts.append(kind if kind in ("growth", "constant", "not varied") else words)
        predicted = [row[name] for name in ("dt [s]", "size [m]", "seconds [s]")]
        texts.append("{:.2g} s, {:.2g} m: {:.2g} s".format(*predicted))
        if np.isnan(predicted).any():
            texts[-1] = "out of reach"
        return texts

    def _notes(self) -> list[str]:
        kinds = {*self.table["step_kind"], *self.table["cell_kind"]}
        cases, seconds = self.runs["case"], self.runs[_SECONDS]
        each_run = [f"{name} {s:.2g} s" for name, s in zip(cases, seconds, strict=True)]
        total = f"together {seconds.sum() / seconds[0]:.1f} times the given run"
        notes = [f"Processor time: {', '.join(each_run)}; {total}."]
        if "no order" in kinds:
            notes.append(
                "no order: the runs do not converge steadily; < is a cautious bound, which finer "
                "runs narrow, such as steps=(2, 0.5). Peaks of joint forces last few steps."
            )
        if "not varied" in kinds:
            notes.append("not varied: the error is without that of this direction.")
        if self.lacking:
            notes.append(f"Not in all runs, so without an error: {', '.join(self.lacking)}.")
        if "growth" in kinds:
            growing = self.table["value"][self.table["cell_kind"] == "growth"]
            notes.append(
                f"growth: {', '.join(growing)}. These peaks grow as cells shrink and have no "
                "limit, as at a corner or where a dam meets rock; evaluate stresses elsewhere."
            )
        return notes


def _share(error: float, value: float, bounded: bool) -> str:
    """Return an error as a share of the value, in words."""
    if not np.isfinite(error):
        return "no limit"
    if error and not value:
        return f"{error:.2g} of 0"
    percent = 100.0 * error / value if value else 0.0
    share = f"{percent:.0f} %" if percent >= 99.5 else f"{percent:.2g} %"
    return f"< {share}" if bounded else share


@checked
def accuracy(
    path: str | Path,
    run: Run,
    *,
    size: Length,
    dt: Time,
    steps: tuple[float, ...] = (2.0, 4.0),
    cells: tuple[float, ...] = (1.26, 1.6),
    target: Annotated[float, at.Gt(0.0)] = 0.01,
    workers: Annotated[int, at.Ge(1)] | None = None,
    progress: bool = True,
) -> Accuracy:
    """Estimate the errors of a run by runs with coarser steps and coarser cells.

    The runs are the cases of a `Study`. Each run starts a new interpreter. A second
    call with the same folder makes only the runs that it lacks. Changes of the function are not
    detected.

    The error of the step and the error of the cells are estimated separately and added
    (`estimated_error`). Both exclude what the runs have in common, such as the model and its data.
    A peak of stress that grows with refinement may need finer cells to be recognised.

    Args:
        path: Folder of the study.
        run: Function at the top level of a module, called as ``run(folder, size=..., dt=...)``. It
            makes a run with this cell size and time step, writes its files to the folder, and
            returns the results file, or other values by name.
        size: Cell size of the given run.
        dt: Time step of the given run.
        steps: Factors of the time step in the other runs; below 1 for finer ones, or none.
        cells: Factors of the cell size in the other runs.
        target: Allowed relative error, for which the cheapest run is predicted.
        workers: Simultaneous runs, by default 2 if there are as many cores.
        progress: Show a progress bar.

    Raises:
        ValueError: A direction has a single factor, or a factor is not positive or is 1.
        StudyError: A run failed, the folder contains another study, or several ranks call.
    """
    if MPIRUN & os.environ.keys():
        raise StudyError("accuracy starts its runs as separate processes: call it without mpirun.")
    cases = _with_earlier(Path(path), _cases(run, size, dt, steps, cells))
    study = Study(path, _Measured(run), cases)
    workers = workers or min(_WORKERS, len(os.sched_getaffinity(0)))
    tally = study.run(workers=workers, retry_failed=True, progress=progress)
    if tally.failed:
        raise StudyError(f"An estimate needs all runs of {study.path}: {tally}")
    rows = read_rows(study.path / TABLE)
    names = [name for name in rows[0]["values"] if name not in _OWN]  # of the given run
    columns = {n: [row["values"].get(n, np.nan) for row in rows] for n in names}
    shared = [n for n, c in columns.items() if np.array(c).dtype == float and np.isfinite(c).all()]
    table = _errors(rows, shared, target)
    write_csv(table, study.path / "accuracy.csv")
    return Accuracy(
        path=study.path,
        size=size,
        dt=dt,
        target=target,
        table=table,
        runs=study.table(),
        lacking=[name for name in names if name not in shared],
    )


def _cases(
    run: Run, size: float, dt: float, steps: tuple[float, ...], cells: tuple[float, ...]
) -> dict[str, Row]:
    """Return the parameters of the runs; raise a ValueError if arguments are not allowed."""
    try:
        signature(run).bind(Path(), size=size, dt=dt)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"accuracy: run must accept (folder, size=..., dt=...): {error}."
        ) from None
    for name, factors in (("steps", steps), ("cells", cells)):
        if len({*factors}) == 1 or not all(0.0 < factor != 1.0 for factor in factors):
            raise ValueError(
                f"accuracy: {name} is {factors}; it must be two or more positive factors other "
                "than 1, or empty."
            )
    if not steps and not cells:
        raise ValueError("accuracy: steps and cells are both empty; vary at least one of them.")
    band = min(ACCELERATION_BAND, 0.5 / (_LONG * dt))
    function = getattr(run, "__qualname__", type(run).__name__)
    given = {"size": size, "dt": dt, "band": band, "function": function}
    cases = {GIVEN: given}
    cases |= {f"step_x{factor:g}": given | {"dt": factor * dt} for factor in steps}
    cases |= {f"cell_x{factor:g}": given | {"size": factor * size} for factor in cells}
    return cases


def _with_earlier(path: Path, cases: Mapping[str, Row]) -> dict[str, Row]:
    """Add the complete runs that the folder has; raise a StudyError if they are not of this run."""
    place, given = path / TABLE, cases[GIVEN]
    rows = read_rows(place) if place.is_file() else []
    for row in rows:
        made = row["parameters"]
        same = made == cases.get(row["case"], made) and made.keys() == given.keys()
        if not same or any(made[name] != given[name] for name in ("band", "function")):
            raise StudyError(
                f"{path} contains another study: its case {row['case']!r} has the parameters "
                f"{made}, and the given run {given}. Use another folder."
            )
    complete = {row["case"]: row["parameters"] for row in rows if row["status"] == "complete"}
    return {**cases, **complete}


def _errors(rows: list[Row], names: list[str], target: float) -> Table:
    """Return the table of the errors of the first run."""
    given, first = rows[0]["parameters"], rows[0]["values"]
    made = [(row["parameters"], row["values"]) for row in rows]
    steps = {p["dt"] / given["dt"]: values for p, values in made if p["size"] == given["size"]}
    cells = _by_cell(rows, given, first)
    cost = Cost.fitted(*({x: run[_SECONDS] for x, run in runs.items()} for runs in (steps, cells)))
    orders = {"step": (steps, _STEP_ORDER), "cell": (cells, 2.0 * first.get(_DEGREE, 1.0))}
    for direction, (runs, _) in orders.items():
        others = [*runs.values()]
        if names and len(others) > 1 and all(o[n] == others[0][n] for o in others for n in names):
            raise StudyError(
                f"No value changes with the {direction}: the function does not use it, or nothing "
                "depends on it; then leave this direction out."
            )
    lines: list[Row] = []
    for name in names:
        value = abs(first[name])
        estimates = {
            direction: estimated_error(
                [*runs],
                [run[name] for run in runs.values()],
                formal_order=order,
                may_grow=direction == "cell" and name.endswith("[Pa]"),
            )
            for direction, (runs, order) in orders.items()
        }
        both = [*estimates.values()]
        x, y, seconds = cheapest(target * value, both, (max(steps), max(cells)), cost)
        line = {"value": name, "given": first[name], "error": sum(e.error for e in both)}
        for direction, e in estimates.items():
            parts = {"error": e.error, "kind": e.kind, "order": e.order}
            line |= {f"{direction}_{part}": quantity for part, quantity in parts.items()}
        ahead = {"dt [s]": x * given["dt"], "size [m]": y * given["size"], "seconds [s]": seconds}
        lines.append(line | ahead)
    if not lines:
        raise StudyError("The runs have no value in common: record monitor points or joints.")
    return {name: np.array([line[name] for line in lines]) for name in lines[0]}


def _by_cell(rows: list[Row], given: Row, first: Row) -> dict[float, Row]:
    """Return the values of the runs by cell size, relative to the given run.

    A mesh does not have exactly the given size, so the mean size follows from the number of cells.
    """
    runs: dict[float, Row] = {}
    for row in (row for row in rows if row["parameters"]["dt"] == given["dt"]):
        values, size = row["values"], row["parameters"]["size"] / given["size"]
        if _CELLS in values:
            size = float((first[_CELLS] / values[_CELLS]) ** (1.0 / values[_DIMENSION]))
        if size in runs:
            raise StudyError(
                f"The case {row['case']!r} has as many cells as another one: the function does "
                "not use the size, or the factors in cells are too close."
            )
        runs[size] = values
    return runs
