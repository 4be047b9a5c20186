# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Readings of instruments, and the values that a recorded run computes for them."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from datetime import datetime
from os import PathLike
from typing import Any

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.errors import RecordError
from dolfinx_joints.common.parameters import (
    check_each,
    check_kind_of,
    finite,
    numbers_of,
    shown,
    whole_number,
)
from dolfinx_joints.gradient.quantity import History, not_observed

# Factors to SI; temperatures stay in degrees C.
TIMES = {"s": 1.0, "h": 3600.0, "d": 86400.0}
UNITS = TIMES | {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "Hz": 1.0, "Pa": 1.0, "kPa": 1e3, "MPa": 1e6}
UNITS |= {"C": 1.0, "°C": 1.0, "-": 1.0}

# Readings outside of the run by this part of its duration are read at its first or last step.
OUTSIDE = 1e-9


def read_series(
    path: str | PathLike[str], *, start: str | None = None
) -> dict[str, tuple[Floats, Floats]]:
    """Read measured time series from a CSV file.

    The first line names the columns with their units, such as ``time [d], crest [mm], level [m]``.
    The first column is the time, or ``date`` with dates such as 2024-05-31 or 2024-05-31T12:00;
    times then count from ``start``. Empty cells are missing values. Cells are separated by commas,
    or by semicolons; then numbers may have decimal commas.

    Args:
        path: The file.
        start: Date of time 0, the first date of the file by default. Give the same date for all
            files of a calibration.

    Returns:
        Times [s] and values in SI units by column name, without missing values. Temperatures stay
        in degrees C.

    Raises:
        RecordError: The file cannot be read, a unit is not known, two columns have one name, a cell
            is no number, or times do not increase.
    """
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            semicolons = ";" in file.readline()
            file.seek(0)
            reader = csv.reader(file, delimiter=";" if semicolons else ",", skipinitialspace=True)
            lines = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
            rows = [(line, row) for line, row in lines if any(row)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RecordError(f"{path} cannot be read: {error}.") from None
    if len(rows) < 2:
        raise RecordError(f"{path} needs a line of column names and at least one line of values.")
    names: list[str] = []
    factors: list[float] = []
    for title in rows[0][1]:
        match = re.fullmatch(r"([^\[\]]+?)\s*\[([^\[\]]+)\]", title)
        dated, units = not names and title.lower() == "date", UNITS if names else TIMES
        if not dated and (match is None or match[2] not in units):
            first = "" if names else "The first column may also be date."
            raise RecordError(
                f"{path}: the column {title!r} needs a name and a unit in brackets, one of "
                f"{', '.join(units)}. {first}".rstrip()
            )
        names.append("date" if match is None else match[1])
        if names[-1] in names[:-1]:
            raise RecordError(f"{path}: two columns have the name {names[-1]!r}.")
        factors.append(1.0 if match is None else UNITS[match[2]])
    if semicolons:
        rows = [(line, [cell.replace(",", ".") for cell in row]) for line, row in rows]
    table = np.array([_numbers(path, line, row, names) for line, row in rows[1:]]) * factors
    if start is not None and names[0] != "date":
        raise ValueError(f"start is {shown(start)}, but {path} has times instead of dates.")
    first_date = _seconds(start) if start is not None else table[0, 0]
    times = table[:, 0] - (first_date if names[0] == "date" else 0.0)
    if not (np.diff(times) > 0.0).all():
        line = rows[2 + int(np.argmin(np.diff(times) > 0.0))][0]
        raise RecordError(f"{path}, line {line}: the time is not later than the one before.")
    given = ~np.isnan(table)
    return {n: (times[given[:, j]], table[given[:, j], j]) for j, n in enumerate(names) if j}


def _numbers(path: Any, line: int, row: list[str], names: list[str]) -> list[float]:
    """Return the numbers of a row, NaN for empty cells."""
    if len(row) != len(names):
        raise RecordError(f"{path}, line {line}: {len(row)} cells for {len(names)} columns.")
    numbers = []
    for name, cell in zip(names, row, strict=True):
        try:
            if name == "date":
                numbers.append(_seconds(cell))
                continue
            numbers.append(float(cell) if cell else np.nan)
            valid = not cell or np.isfinite(numbers[-1])
        except ValueError as error:
            if name == "date":
                raise RecordError(f"{path}, line {line}: {error}") from None
            valid = False
        if not valid or (name == names[0] and not cell):
            raise RecordError(f"{path}, line {line}: {name} is {cell!r}; it must be a number.")
    return numbers


def _seconds(date: Any) -> float:
    """Return the seconds from 1970 to a date."""
    try:
        return (datetime.fromisoformat(date) - datetime(1970, 1, 1)).total_seconds()
    except (ValueError, TypeError):
        wanted = "a date without time zone, such as 2024-05-31 or 2024-05-31T12:00"
        raise ValueError(f"date is {shown(date)}; it must be {wanted}.") from None


@dataclass(frozen=True, kw_only=True)
class Readings:
    """Readings of one instrument, to compare with an observed value of a `Tape`.

    Attributes:
        of: Name of the observed point or gap.
        component: Component of the observed value: 0, 1 or 2.
        series: Times [s] and values [m], such as a column of `read_series`.
        deviation: Standard deviation of the values [m], one for all or one per value.
        relative: True if the zero of the instrument is not known, such as that of most pendulums
            and joint meters. A constant is then subtracted from the values, and another one from
            the computed values: their means, weighted by 1 / deviation^2. A difference from the
            first reading would add the error of that reading to all others.
    """

    of: str
    component: int
    series: tuple[Floats, Floats]
    deviation: float | Floats
    relative: bool = False

    def __post_init__(self) -> None:
        """Check the arguments, and convert them to arrays."""
        where = f"Readings of {shown(self.of)}"
        check_kind_of("Readings: of", self.of, isinstance(self.of, str), "the name of a value")
        component = whole_number(self.component)
        check_kind_of(f"{where}: component", self.component, component in (0, 1, 2), "0, 1 or 2")
        pair = isinstance(self.series, tuple | list) and len(self.series) == 2
        arrays: list[Any] = [numbers_of(part) for part in self.series] if pair else [None]
        good = all(a is not None and a.ndim == 1 and finite(a) for a in arrays)
        good = good and len(arrays[0]) == len(arrays[1]) > 0
        good = good and bool((np.diff(arrays[0]) > 0.0).all())
        wanted = "increasing times and as many values, finite numbers"
        check_kind_of(f"{where}: series", self.series, good, wanted)
        deviation = check_each(f"{where}: deviation", self.deviation, len(arrays[0]))
        positive = bool((deviation > 0.0).all())
        check_kind_of(f"{where}: deviation", self.deviation, positive, "positive")
        enough = not self.relative or len(deviation) > 1
        check_kind_of(f"{where}: series", self.series, enough, "two or more values if relative")
        object.__setattr__(self, "series", tuple(np.array(a, dtype=float) for a in arrays))
        object.__setattr__(self, "deviation", deviation)

    def weights(self, history: History) -> Floats:
        """Return the weights of the steps in each computed value, shape (values, steps).

        Values between steps are interpolated linearly; of steps at one time, the last counts.
        """
        if self.of not in history.values:
            raise ValueError(not_observed(self.of, history.values))
        times, read = history.times, self.series[0]
        first, last = times[0], times[-1]
        if (np.diff(times) < 0.0).any():
            raise ValueError("The times of the run decrease; readings need a run in their order.")
        margin = OUTSIDE * (last - first)
        outside = (read < first - margin) | (read > last + margin)
        if outside.any():
            raise ValueError(
                f"Readings of {self.of!r}: the time {read[outside][0]:.6g} s is outside of the "
                f"run, {first:.6g} to {last:.6g} s."
            )
        read = np.clip(read, first, last)
        before = np.searchsorted(times, read, side="right") - 1
        after = np.minimum(before + 1, len(times) - 1)
        length = np.maximum(times[after] - times[before], np.finfo(float).tiny)
        share = np.clip((read - times[before]) / length, 0.0, 1.0)
        weights = np.zeros((len(read), len(times)))
        np.add.at(weights, (np.arange(len(read)), before), 1.0 - share)
        np.add.at(weights, (np.arange(len(read)), after), share)
        return self._without_constant(weights)

    @property
    def measured(self) -> Floats:
        """Values to compare with `computed`, [m]."""
        return self._without_constant(self.series[1])

    def _without_constant(self, values: Floats) -> Floats:
        """Subtract the weighted mean from values, if the readings are relative."""
        if not self.relative:
            return values
        deviation: Floats = np.asarray(self.deviation, dtype=np.float64)
        weights = (deviation.min() / deviation) ** 2
        return np.asarray(values - weights @ values / weights.sum())

    def computed(self, history: History) -> Floats:
        """Return the computed values, shape (values,), [m]."""
        return self.weights(history) @ history.values[self.of][:, self.component]
