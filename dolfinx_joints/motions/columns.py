# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ground motions in plain columns of numbers, described above them or by the user.

Lines with ``#`` above the numbers may give, as ``key: value``,

- ``unit``: of the accelerations, for example ``cm/s^2``, also as ``# acceleration (cm/s^2)``;
- ``dt``: time between rows [s], if no column holds the time [s];
- ``columns``: ``time``, the direction of a component, or ``skip``, for example ``time N E UP`` or
  ``35 305 UP``; or ``wrapped``: one component, equally many values on all lines but the last.

A line of names may follow, as ``time (s),acc (g)``. Velocities, displacements and two units are an
error. The user must give what the file does not; if both do, they must agree. One column without a
name is a component, two are time and a component.
Decimal commas need blanks, tabs or semicolons between columns, or a single column.
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
_STEP_TOLERANCE = 0.02  # part of a step by which a rounded time may miss its place


def is_columns(text: RecordText) -> bool:
    """Return True if numbers follow the comments, or a line of as many names."""
    first = _first_row(text)  # a wrong cell there is an error of its line
    return any(map(_NUMBER_FIRST.match, text.lines[first - 1 : first + 1]))


def states_unit(text: RecordText) -> bool:
    """Whether a file of columns gives its unit."""
    return "unit" in _keys(text)


def read_columns(
    text: RecordText,
    unit: str | None,
    dt: float | None,
    columns: Sequence[str | float] | str | None,
) -> list[Component]:
    """Components in a file of plain columns; None leaves it to the file to describe them."""
    keys, first = _keys(text), _first_row(text)
    _use_decimal_points(text, first)
    unit, names = _unit(text, keys, unit), _names(text, keys, columns)
    record = text.path.stem
    if names == ["wrapped"]:
        _refuse_counted_lines(text, first)
        dt = _step(text, keys, dt, [], first)
        return [component(text, text.values(first), dt=dt, unit=unit, record=record)]
    rows = text.rows(first, len(names))
    if len(rows) < 2:
        text.fail(first, f"the file has {len(rows)} row of numbers; a record has 2 at least.")
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


def _refuse_counted_lines(text: RecordText, first: int) -> None:
    """Raise an error if a column of the full lines of a wrapped series holds times or numbers."""
    words = [text.words(number) for number in range(first, len(text.lines) + 1)]
    full = [each for each in words if len(each) == len(words[0]) > 1]
    for column in zip(*full, strict=True) if len(full) > 3 else ():
        values = np.array([text.number(first + i, word) for i, word in enumerate(column)])
        course = np.linspace(values[0], values[-1], len(values))
        if (np.diff(values) > 0.0).all() and np.abs(values - course).max() <= _digit(column):
            rising = f"each line has a number, {column[0]} in this one, that rises by equal steps"
            text.fail(first, f"{rising}; remove it, columns='wrapped' reads samples alone.")


def _digit(printed: Sequence[str]) -> float:
    """Return the last digit to which numbers are printed."""
    return 10.0 ** min(int(Decimal(word).as_tuple().exponent) for word in printed)


def _first_row(text: RecordText) -> int:
    """Number of the first line that is no comment and no line of names above numbers."""
    number = 1
    while number <= len(text.lines) and text.lines[number - 1].lstrip()[:1] in ("#", "%", ""):
        number += 1
    names, below, next_row = (*text.lines[number - 1 : number + 2], "", "", "")[:3]
    if _NUMBER_FIRST.match(names) or not any(map(_NUMBER_FIRST.match, (below, next_row))):
        return number
    columns = len(text.words(number + 1)), len(_parts(below))  # with decimal commas the second
    return number + (len(_parts(names)) in columns)


def _parts(line: str) -> list[str]:
    """Names in a line, between semicolons, tabs, commas or blanks."""
    line = re.sub(r"\s+(?=[\[(])", "", line)  # a unit belongs to the name before it
    mark = next((mark for mark in ";\t," if mark in line), None)
    return [part.strip() for part in line.split(mark)]


def _use_decimal_points(text: RecordText, first: int) -> None:
    """Replace decimal commas by points from the first line on.

    Commas are decimal if there is no point, and between digits in lines with other separators or of
    one number with equally many decimals each. Numbers before the comma that rise are times.
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
    """Line number and value of each key above the numbers."""
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
        for found in filter(None, map(_NAME.fullmatch, _parts(line))):
            name, unit = _OF_ACCELERATION.sub("", found[1]), found[2]
            time = bool(_TIME.fullmatch(name)) or (unit or "") in ("s", "sec")
            if _OTHER_NAME.match(name) or (time and (unit or "s")[0] not in "sS"):
                text.fail(number, f"must name times [s] and accelerations, got {shown(found[0])}.")
            columns.append("time" if time else "?" if direction_named(name) is None else name)
            if unit and not time:
                _state_unit(text, keys, number, unit)
        keys["names"] = (number, " ".join(columns))
    return keys


def _state_unit(text: RecordText, keys: Keys, number: int, unit: str) -> None:
    """Keep the unit of a line; raise an error if a line before gives another one."""
    unit = unit_named(unit, f"{text.path}, line {number}")
    line, known = keys.setdefault("unit", (number, unit))
    if UNITS[known] != UNITS[unit]:
        text.fail(number, f"gives the unit {unit}, but line {line} {known}; use one unit.")


def _agreed(text: RecordText, keys: Keys, key: str, here: Any, given: Any) -> Any:
    """The value from the file or from the user, an error where they differ."""
    if None not in (here, given) and here != given:
        text.fail(keys[key][0], f"{key} is {here} here, but {given} was given.")
    return given if here is None else here


def _unit(text: RecordText, keys: Keys, user: str | None) -> str:
    here = keys["unit"][1] if "unit" in keys else None
    given = None if user is None else unit_named(user, "unit")
    if here and given and UNITS[here] == UNITS[given]:
        return given
    unit: str | None = _agreed(text, keys, "unit", here, given)
    if unit is None:
        raise RecordError(
            f"{text.path} does not give the unit of its columns; pass unit=, or write "
            "'# unit: cm/s^2' above the numbers."
        )
    return unit


def _names(text: RecordText, keys: Keys, user: Sequence[str | float] | str | None) -> list[str]:
    """Content of each column; by default one is a component, two are time and a component."""
    here = keys["columns"][1].lower().split() if "columns" in keys else None
    user = user.split() if isinstance(user, str) else user
    given = None if user is None else [str(name).lower() for name in user]
    names: list[str] | None = _agreed(text, keys, "columns", here, given)
    if names is not None and "names" in keys:
        number, above = keys["names"]
        for name, mine in zip(above.split(), names, strict=False):
            agrees = name == "?" or direction_named(mine) == direction_named(name)
            if mine not in (name.lower(), "skip") and not agrees:
                text.fail(number, f"names a column {shown(name)}, but columns= has {shown(mine)}.")
    if names is None:
        width = len(text.words(_first_row(text)))
        names = ["time", "?"][-width:] if width < 3 else ["?"] * width
        names = keys["names"][1].lower().split() if "names" in keys else names
        if len(names) - names.count("time") == 1:
            return names
        if "?" in names:
            raise RecordError(
                f"{text.path} has {width} columns and does not name them; pass columns=, or write "
                "'# columns: time N E UP' above the numbers. Name a column to leave out 'skip'; "
                "columns='wrapped' reads one component that goes on from line to line."
            )
    known = [n for n in names if n in ("time", "skip") or direction_named(n) is not None]
    several = [name for name in names if name != "skip"]
    if names != ["wrapped"] and (
        known != names or len(set(several)) < len(several) or set(several) <= {"time"}
    ):
        raise RecordError(
            f"{text.path}: columns must be 'time' once at most and different directions (N, E, S, "
            f"W, UP, DOWN, azimuths, or x, y, z of the dam), 'skip' for any other column, got "
            f"{shown(' '.join(names), str)}."
        )
    return names


def _step(
    text: RecordText, keys: Keys, user: float | None, printed: list[str], first: int
) -> float:
    """Time between rows [s]; printed times may be rounded to their last digit."""
    here = text.positive(*keys["dt"], "dt") if "dt" in keys else None
    dt: float | None = _agreed(text, keys, "dt", here, user)
    if not printed:
        if dt is None:
            raise RecordError(
                f"{text.path} has no column of time; pass dt=, or write '# dt: 0.01' above the "
                "numbers."
            )
        return dt
    times, counted = np.array(printed, dtype=np.float64), np.arange(len(printed))
    step = float((times[-1] - times[0]) / (len(times) - 1)) if dt is None else dt
    usual, off = step, times - times[0] - step * counted
    missed = np.abs(off) >= _STEP_TOLERANCE * step
    if dt is not None:  # times may be rounded; where a row is missing they are off by a step
        digit, spread = _digit(printed), np.maximum.accumulate(off) - np.minimum.accumulate(off)
        far = np.abs(off) >= (0.5 - _STEP_TOLERANCE) * (digit + dt)
        missed &= far | (spread > digit * (1.0 + _STEP_TOLERANCE))
    elif missed.any():
        steps = np.diff(times)
        usual = float(np.sort(steps)[(len(steps) - 1) // 2])
        missed = np.append(False, np.abs(steps - usual) >= 0.99 * np.abs(steps - usual).max())
    if missed.any():
        row = int(np.argmax(missed))
        got = f"of {usual:.6g} s, got {printed[row]} after {printed[row - 1]}; pass dt= if rounded."
        text.fail(first + row, f"the times must rise by equal steps, {got}")
    return step
