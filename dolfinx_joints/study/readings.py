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
from dolfinx_joints.common.parameters import check_each, check_kind_of, finite, numbers_of, shown
from dolfinx_joints.gradient.quantity import History, not_observed

# Factors to SI; temperatures stay in degrees C.
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "s": 1.0, "h": 3600.0, "d": 86400.0, "Hz": 1.0}
UNITS |= {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "C": 1.0, "-": 1.0}

# Readings later than the last step by this part of the duration are read at the last step.
LATE = 1e-9


def read_series(path: str | PathLike[str]) -> dict[str, tuple[Floats, Floats]]:
    """Read measured time series from a CSV file.

    The first line names the columns with their units, such as ``time [d], crest [mm], level [m]``.
    The first column is the time, or ``date`` with dates such as 2024-05-31 or 2024-05-31T12:00;
    times then count from the first date. Empty cells are missing values.

    Returns:
        Times [s] and values in SI units by column name, without missing values. Temperatures stay
        in degrees C.

    Raises:
        RecordError: The file cannot be read, a unit is not known, a cell is no number, or times do
            not increase.
    """
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file, skipinitialspace=True) if any(row)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RecordError(f"{path} cannot be read: {error}.") from None
    if len(rows) < 2:
        raise RecordError(f"{path} needs a line of column names and at least one line of values.")
    names: list[str] = []
    factors: list[float] = []
    for title in rows[0]:
        match = re.fullmatch(r"\s*([^\[\]]+?)\s*\[([^\[\]]+)\]\s*", title)
        dated = not names and title.strip() == "date"
        if not dated and (match is None or match[2] not in UNITS):
            known = ", ".join(UNITS)
            raise RecordError(
                f"{path}: the column {title!r} needs a name and a unit in brackets, one of {known}."
            )
        names.append("date" if match is None else match[1])
        factors.append(1.0 if match is None else UNITS[match[2]])
    table = np.array([_numbers(path, line, row, names) for line, row in enumerate(rows[1:], 2)])
    table = table * factors
    times = table[:, 0] - (table[0, 0] if names[0] == "date" else 0.0)
    if not (np.diff(times) > 0.0).all():
        line = 3 + int(np.argmin(np.diff(times) > 0.0))
        raise RecordError(f"{path}, line {line}: the time is not later than that of the last line.")
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
                numbers.append(
                    (datetime.fromisoformat(cell) - datetime(1970, 1, 1)).total_seconds()
                )
                continue
            numbers.append(float(cell) if cell.strip() else np.nan)
            valid = not cell.strip() or np.isfinite(numbers[-1])
        except (ValueError, TypeError):
            valid = False
        if not valid or (name == names[0] and not cell.strip()):
            raise RecordError(f"{path}, line {line}: {name} is {cell!r}; it must be a number.")
    return numbers


@dataclass(frozen=True, kw_only=True)
class Readings:
    """Readings of one instrument, to compare with an observed value of a `Tape`.

    Attributes:
        of: Name of the observed point or gap.
        component: Component of the observed value: 0, 1 or 2.
        series: Times [s] and values [m], such as a column of `read_series`.
        deviation: Standard deviation of the values [m], one for all or one per value.
        relative: True if the values are changes since the first reading, such as those of pendulums
            and joint meters. The computed values then are changes since the first reading, too.
    """

    of: str
    component: int
    series: tuple[Floats, Floats]
    deviation: float | Floats
    relative: bool = False

    def __post_init__(self) -> None:
        """Check the arguments, and convert them to arrays."""
        where = f"Readings of {shown(self.of)}"
        check_kind_of(f"{where}: component", self.component, self.component in (0, 1, 2), "0, 1, 2")
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
        object.__setattr__(self, "series", tuple(np.array(a, dtype=float) for a in arrays))
        object.__setattr__(self, "deviation", deviation)

    def weights(self, history: History) -> Floats:
        """Return the weights of the steps in each computed value, shape (values, steps).

        Values between steps are interpolated linearly; of steps at one time, the last counts.
        """
        if self.of not in history.values:
            raise ValueError(not_observed(self.of, history))
        times, read = history.times, self.series[0]
        first, last = times[0], times[-1]
        if (np.diff(times) < 0.0).any():
            raise ValueError("The times of the run decrease; readings need a run in their order.")
        outside = (read < first) | (read > last + LATE * (last - first))
        if outside.any():
            raise ValueError(
                f"Readings of {self.of!r}: the time {read[outside][0]:.6g} s is outside of the "
                f"run, {first:.6g} to {last:.6g} s."
            )
        before = np.searchsorted(times, read, side="right") - 1
        after = np.minimum(before + 1, len(times) - 1)
        length = np.maximum(times[after] - times[before], np.finfo(float).tiny)
        share = np.clip((read - times[before]) / length, 0.0, 1.0)
        weights = np.zeros((len(read), len(times)))
        np.add.at(weights, (np.arange(len(read)), before), 1.0 - share)
        np.add.at(weights, (np.arange(len(read)), after), share)
        return weights - weights[0] if self.relative else weights

    def computed(self, history: History) -> Floats:
        """Return the computed values, shape (values,), [m]."""
        return self.weights(history) @ history.values[self.of][:, self.component]
