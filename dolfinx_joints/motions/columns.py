# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ground motions in plain columns of numbers, described above them or by the user.

Lines that begin with ``#`` may stand above the numbers and give, as ``key: value``,

- ``unit``: of the accelerations, for example ``cm/s^2``;
- ``dt``: time between rows [s], where no column holds the time [s];
- ``columns``: what each column holds, ``time`` or the direction of a component, for example
  ``time N E UP`` or ``35 305 UP``.

Comments that say that the numbers are velocities or displacements are an error.

The user must give what the file does not; where both do they must agree. Where neither names the
columns, one is a component and two are time and a component.
"""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.errors import RecordError
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.motions.record_text import (
    Component,
    RecordText,
    component,
    direction_named,
    refuse_other_quantity,
    unit_named,
)

_KEY = re.compile(r"[#%]\s*(units?|dt|columns)\s*[:=]\s*(.*)", re.I)
Keys = dict[str, tuple[int, str]]  # number of the line and value
_STEP_TOLERANCE = 0.02  # part of a step by which a rounded time may miss its place


def is_columns(text: RecordText) -> bool:
    """Whether the first line that is no comment begins with a number."""
    first = _first_row(text)
    return first <= len(text.lines) and bool(re.match(r"\s*[+-]?\.?\d", text.lines[first - 1]))


def check_described(text: RecordText) -> None:
    """Refuse a line without numbers right below comments that describe columns."""
    first = _first_row(text)
    if _keys(text) and first <= len(text.lines):
        line = shown(text.lines[first - 1].strip())
        text.fail(first, f"numbers must follow the comments, got {line}; names need a '#' too.")


def states_unit(text: RecordText) -> bool:
    """Whether a file of columns gives its unit."""
    return "unit" in _keys(text)


def read_columns(
    text: RecordText,
    unit: str | None,
    dt: float | None,
    columns: Sequence[str | float] | None,
) -> list[Component]:
    """Components in a file of plain columns; None leaves it to the file to describe them."""
    keys, first = _keys(text), _first_row(text)
    for number in range(1, first):
        refuse_other_quantity(text, number, text.lines[number - 1])
    unit, names = _unit(text, keys, unit), _names(text, keys, columns)
    rows = text.rows(first, len(names))
    if len(rows) < 2:
        text.fail(first, f"the file has {len(rows)} row of numbers; a record has 2 at least.")
    is_time = [name == "time" for name in names]
    times = rows[:, is_time]
    dt = _step(text, keys, dt, times, first)
    return [
        component(
            text,
            rows[:, place],
            dt=dt,
            unit=unit,
            direction=direction_named(name),
            record=text.path.stem,
            start=float(times[0, 0]) if times.size else None,
        )
        for place, name in enumerate(names)
        if name != "time"
    ]


def _first_row(text: RecordText) -> int:
    """Number of the first line that is no comment."""
    number = 1
    while number <= len(text.lines) and text.lines[number - 1].lstrip()[:1] in ("#", "%", ""):
        number += 1
    return number


def _keys(text: RecordText) -> Keys:
    """Line number and value of each key above the numbers."""
    keys: Keys = {}
    for number in range(1, _first_row(text)):
        match = _KEY.match(text.lines[number - 1].strip())
        if match is not None:
            keys[match[1].lower().replace("units", "unit")] = (number, match[2].strip())
    return keys


def _agreed(text: RecordText, keys: Keys, key: str, here: Any, given: Any) -> Any:
    """The value from the file or from the user, an error where they differ."""
    if None not in (here, given) and here != given:
        text.fail(keys[key][0], f"{key} is {here} here, but {given} was given.")
    return given if here is None else here


def _unit(text: RecordText, keys: Keys, user: str | None) -> str:
    here = None
    if "unit" in keys:
        number, written = keys["unit"]
        here = unit_named(written, f"{text.path}, line {number}")
    given = None if user is None else unit_named(user, "unit")
    unit: str | None = _agreed(text, keys, "unit", here, given)
    if unit is None:
        raise RecordError(
            f"{text.path} does not give the unit of its columns; pass unit=, or write "
            "'# unit: cm/s^2' above the numbers."
        )
    return unit


def _names(text: RecordText, keys: Keys, user: Sequence[str | float] | None) -> list[str]:
    """Content of each column; by default one is a component, two are time and a component."""
    here = keys["columns"][1].lower().split() if "columns" in keys else None
    given = None if user is None else [str(name).lower() for name in user]
    names: list[str] | None = _agreed(text, keys, "columns", here, given)
    if names is None:
        width = len(text.words(_first_row(text)))
        if width not in (1, 2):
            raise RecordError(
                f"{text.path} has {width} columns and does not name them; pass columns=, "
                "or write '# columns: time N E UP' above the numbers."
            )
        return ["time", "?"][-width:]
    known = [name for name in names if name == "time" or direction_named(name) is not None]
    if known != names or names.count("time") > 1 or len(set(names)) < len(names):
        raise RecordError(
            f"{text.path}: columns must be 'time' once at most and different directions (N, E, S, "
            f"W, UP, DOWN or azimuths), got {shown(' '.join(names), str)}."
        )
    return names


def _step(
    text: RecordText,
    keys: Keys,
    user: float | None,
    time: NDArray[np.float64],
    first: int,
) -> float:
    """Time between rows [s]."""
    here = text.positive(*keys["dt"], "dt") if "dt" in keys else None
    dt: float | None = _agreed(text, keys, "dt", here, user)
    if time.shape[1] == 0:
        if dt is None:
            raise RecordError(
                f"{text.path} has no column of time; pass dt=, or write '# dt: 0.01' above the "
                "numbers."
            )
        return dt
    times = time[:, 0]
    step = float((times[-1] - times[0]) / (len(times) - 1)) if dt is None else dt
    missed = np.abs(times - times[0] - step * np.arange(len(times))) >= _STEP_TOLERANCE * step
    if missed.any():
        row = int(np.argmax(missed))
        text.fail(
            first + row, f"the times must rise by equal steps of {step:.6g} s, got {times[row]}."
        )
    return step
