# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ground motions in plain columns of numbers, described by a header or by the user.

Lines with ``#`` above the numbers may give, as ``key: value``,

- ``unit``: unit of acceleration, for example ``cm/s^2``, also as ``# acceleration (cm/s^2)``;
- ``dt``: time between rows [s], if there is no time column [s];
- ``columns``: ``time``, the direction of a component, or ``skip``, for example ``time N E UP`` or
  ``35 305 UP``; or ``wrapped``: one component with equal numbers of values per line but the last.

A line of names may follow, such as ``time (s),acc (g)``. Velocities, displacements and several
units raise an error. Facts that the file does not state are arguments; facts in both must agree.
A single unnamed column is a component; two are time and a component. Decimal commas need blanks,
tabs or semicolons between columns, or a single column.
"""

import re
from collections.abc import Sequence
from decimal import Decimal
from itertools import pairwise
from typing import Any

import numpy as np

from dolfinx_joints.common.errors import RecordError
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.motions.record_text import (
    UNITS,
    Component,
    RecordText,
    Samples,
    component,
    direction_named,
    refuse_other_quantity,
    unit_named,
    units_in,
)

_KEY = re.compile(r"[#%]\s*(units?|dt|columns)\s*[:=]\s*(.*)", re.I)
_NAME = re.compile(r"\W*(.*?)\s*(?:[\[(]\s*([^\])]*?)\s*[\])])?\W*")  # name (unit)
_OF_ACCELERATION = re.compile(r"a(?:cc\w*?)?[_.-]?(?=[xyznewu]$|up$|ns$|ew$)", re.I)
_OTHER_NAME = re.compile(r"vel|disp|[vdu]_?[xyz\d]$", re.I)
_TIME = re.compile(r"t|time|times|zeit|tempo|temps|tiempo|period", re.I)
_NUMBER_FIRST = re.compile(r"\s*[+-]?\.?\d")
_DECIMAL = re.compile(r"([+-]?\d+),(\d+)(?:e[+-]?\d+)?", re.I)
Keys = dict[str, tuple[int, str]]  # number of the line and value
_STEP_TOLERANCE = 0.02  # allowed error of rounded times, relative to the step


def is_columns(text: RecordText) -> bool:
    """Return True if numbers follow the comments or a line with the same number of names."""
    first = _first_row(text)  # accept one bad line, so that it is reported when it is read
    return any(map(_NUMBER_FIRST.match, text.lines[first - 1 : first + 1]))


def states_unit(text: RecordText) -> bool:
    """Return True if a file of columns states its unit."""
    return "unit" in _keys(text)


def read_columns(
    text: RecordText,
    unit: str | None,
    dt: float | None,
    columns: Sequence[str | float] | str | None,
) -> list[Component]:
    """Read the components in plain columns; the header replaces arguments that were not given."""
    keys, first = _keys(text), _first_row(text)
    _use_decimal_points(text, first)
    unit, names = _unit(text, keys, unit), _names(text, keys, columns)
    record = text.path.stem
    if names == ["wrapped"]:
        _refuse_line_numbers(text, first)
        dt = _step(text, keys, dt, [], first)
        return [component(text, text.values(first), dt=dt, unit=unit, record=record)]
    rows = text.rows(first, len(names))
    if len(rows) < 2:
        text.fail(first, f"the file has {len(rows)} row of numbers; at least 2 are needed.")
    lines = range(first, first + len(rows)) if "time" in names else ()
    times = [text.words(number)[names.index("time")] for number in lines]
    dt = _step(text, keys, dt, times, first)
    return [
        component(
            text,
            Samples(rows[:, place], first),
            dt=dt,
            unit=unit,
            stated=direction_named(name),
            record=record,
            start=float(times[0]) if times else None,
        )
        for place, name in enumerate(names)
        if name not in ("time", "skip")
    ]


def _refuse_line_numbers(text: RecordText, first: int) -> None:
    """Raise an error if a column of a wrapped series has times or line numbers."""
    words = [text.words(number) for number in range(first, len(text.lines) + 1)]
    full_rows = [row for row in words if len(row) == len(words[0]) > 1]
    for column in zip(*full_rows, strict=True) if len(full_rows) > 3 else ():
        values = np.array([text.number(first + i, word) for i, word in enumerate(column)])
        ramp = np.linspace(values[0], values[-1], len(values))
        if (np.diff(values) > 0.0).all() and np.abs(values - ramp).max() <= _digit(column):
            counter = f"{column[0]} is a time or line number, which increases by equal steps"
            text.fail(first, f"{counter}; remove it, because columns='wrapped' reads samples only.")


def _digit(printed: Sequence[str]) -> float:
    """Return the value of the last printed digit of numbers."""
    return 10.0 ** min(int(Decimal(word).as_tuple().exponent) for word in printed)


def _first_row(text: RecordText) -> int:
    """Return the number of the first line of values, after comments and a line of names."""
    number = 1
    while number <= len(text.lines) and text.lines[number - 1].lstrip()[:1] in ("#", "%", ""):
        number += 1
    names, below, next_row = (*text.lines[number - 1 : number + 2], "", "", "")[:3]
    if _NUMBER_FIRST.match(names) or not any(map(_NUMBER_FIRST.match, (below, next_row))):
        return number
    columns = len(text.words(number + 1)), len(_headings(below))  # the latter for decimal commas
    return number + (len(_headings(names)) in columns)


def _headings(line: str) -> list[str]:
    """Split a line of names at semicolons, tabs, commas or blanks."""
    line = re.sub(r"\s+(?=[\[(])", "", line)  # a unit belongs to the name before it
    mark = next((mark for mark in ";\t," if mark in line), None)
    return [part.strip() for part in line.split(mark)]


def _use_decimal_points(text: RecordText, first: int) -> None:
    """Replace decimal commas by points, from the first line of values.

    Commas are decimal if there are no points, and either the columns have other separators or all
    lines are one number with equally many decimals. If the integers before the comma increase,
    however, they are times and the comma separates columns.
    """
    lines = [line.strip() for line in text.lines[first - 1 :]]
    if any("." in line for line in lines):
        return
    decimal = all(re.search(r"[\s;]", x) and not re.search(r",(?!\d)|(?<!\d),", x) for x in lines)
    single = [match for match in map(_DECIMAL.fullmatch, lines) if match]
    if len(single) == len(lines) and len({len(match[2]) for match in single}) == 1:
        decimal = not all(int(a[1]) < int(b[1]) for a, b in pairwise(single))
    if decimal:
        text.lines[first - 1 :] = [line.replace(",", ".") for line in lines]


def _keys(text: RecordText) -> Keys:
    """Return line number and value of each key above the numbers."""
    keys: Keys = {}
    for number in range(1, _first_row(text)):
        line = text.lines[number - 1].strip()
        refuse_other_quantity(text, number, line)
        match = _KEY.match(line)
        if match is not None and match[1].lower() in ("unit", "units"):
            _state_unit(text, keys, number, match[2])
        elif match is not None:
            keys[match[1].lower()] = (number, match[2].strip())
        if line[:1] in ("#", "%", ""):
            for unit in units_in(line) if match is None else ():
                _state_unit(text, keys, number, unit)
            continue
        columns = []
        for heading in filter(None, map(_NAME.fullmatch, _headings(line))):
            name, unit = _OF_ACCELERATION.sub("", heading[1]), heading[2]
            time = bool(_TIME.fullmatch(name)) or (unit or "") in ("s", "sec")
            if _OTHER_NAME.match(name) or (time and (unit or "s")[0] not in "sS"):
                text.fail(number, f"must name time [s] and accelerations, got {shown(heading[0])}.")
            columns.append("time" if time else "?" if direction_named(name) is None else name)
            if unit and not time:
                _state_unit(text, keys, number, unit)
        keys["names"] = (number, " ".join(columns))
    return keys


def _state_unit(text: RecordText, keys: Keys, number: int, unit: str) -> None:
    """Store the unit of a line; raise an error if an earlier line has another unit."""
    unit = unit_named(unit, f"{text.path}, line {number}")
    line, earlier = keys.setdefault("unit", (number, unit))
    if UNITS[earlier] != UNITS[unit]:
        text.fail(number, f"the unit is {unit}, but in line {line} it is {earlier}; use one unit.")


def _agree(text: RecordText, keys: Keys, key: str, in_file: Any, user: Any) -> Any:
    """Return the value from the file or from the user; raise an error if they differ."""
    if None not in (in_file, user) and in_file != user:
        text.fail(keys[key][0], f"{key} is {in_file} in the file, but {user} was given.")
    return user if in_file is None else in_file


def _unit(text: RecordText, keys: Keys, user: str | None) -> str:
    in_file = keys["unit"][1] if "unit" in keys else None
    unit_given = None if user is None else unit_named(user, "unit")
    if in_file and unit_given and UNITS[in_file] == UNITS[unit_given]:
        return unit_given
    unit: str | None = _agree(text, keys, "unit", in_file, unit_given)
    if unit is None:
        raise RecordError(
            f"{text.path} does not state the unit of its columns; pass unit=, or write "
            "'# unit: cm/s^2' above the numbers."
        )
    return unit


def _names(text: RecordText, keys: Keys, user: Sequence[str | float] | str | None) -> list[str]:
    """Return the content of each column; by default a component, or time and a component."""
    in_file = keys["columns"][1].lower().split() if "columns" in keys else None
    user = user.split() if isinstance(user, str) else user
    names_given = None if user is None else [str(name).lower() for name in user]
    names: list[str] | None = _agree(text, keys, "columns", in_file, names_given)
    if names is not None and "names" in keys:
        number, headings = keys["names"]
        for name, content in zip(headings.split(), names, strict=False):
            agrees = name == "?" or direction_named(content) == direction_named(name)
            if content not in (name.lower(), "skip") and not agrees:
                text.fail(
                    number,
                    f"column {shown(name)} is {shown(content)} in columns=; fix one of them.",
                )
    if names is None:
        width = len(text.words(_first_row(text)))
        names = ["time", "?"][-width:] if width < 3 else ["?"] * width
        names = keys["names"][1].lower().split() if "names" in keys else names
        if len(names) - names.count("time") == 1:
            return names
        if "?" in names:
            raise RecordError(
                f"{text.path} has {width} columns without names; pass columns=, or write "
                "'# columns: time N E UP' above the numbers. Use 'skip' for columns to ignore, and "
                "columns='wrapped' for one component that continues from line to line."
            )
    valid = [n for n in names if n in ("time", "skip") or direction_named(n) is not None]
    contents = [name for name in names if name != "skip"]
    if names != ["wrapped"] and (
        valid != names or len(set(contents)) < len(contents) or set(contents) <= {"time"}
    ):
        raise RecordError(
            f"{text.path}: columns must be different directions (N, E, S, W, UP, DOWN, azimuths, "
            f"or x, y, z of the dam), 'time' at most once, and 'skip' for any other column, got "
            f"{shown(' '.join(names), str)}."
        )
    return names


def _step(
    text: RecordText, keys: Keys, user: float | None, printed: list[str], first: int
) -> float:
    """Return the time between rows [s]; printed times may be rounded to their last digit."""
    in_file = text.positive(*keys["dt"], "dt") if "dt" in keys else None
    dt: float | None = _agree(text, keys, "dt", in_file, user)
    if not printed:
        if dt is None:
            raise RecordError(
                f"{text.path} has no time column; pass dt=, or write '# dt: 0.01' above the "
                "numbers."
            )
        return dt
    times, counted = np.array(printed, dtype=np.float64), np.arange(len(printed))
    step = float((times[-1] - times[0]) / (len(times) - 1)) if dt is None else dt
    usual, lag = step, times - times[0] - step * counted
    missed = np.abs(lag) >= _STEP_TOLERANCE * step
    if dt is not None:  # times may be rounded; after a missing row their error is a step
        digit, spread = _digit(printed), np.maximum.accumulate(lag) - np.minimum.accumulate(lag)
        far = np.abs(lag) >= (0.5 - _STEP_TOLERANCE) * (digit + dt)
        missed &= far | (spread > digit * (1.0 + _STEP_TOLERANCE))
    elif missed.any():
        steps = np.diff(times)
        usual = float(np.sort(steps)[(len(steps) - 1) // 2])
        missed = np.append(False, np.abs(steps - usual) >= 0.99 * np.abs(steps - usual).max())
    if missed.any():
        row = int(np.argmax(missed))
        got = f"of {usual:.6g} s, got {printed[row]} after {printed[row - 1]}; pass dt= if rounded."
        text.fail(first + row, f"the times must increase by equal steps, {got}")
    return step
