# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is asked of results files, checked where it enters."""

from __future__ import annotations

import math
from typing import Any, Literal, get_args

from dolfinx_joints.common.parameters import (
    check_choice,
    check_kind_of,
    check_number,
    numbers_of,
    real,
    shown,
)
from dolfinx_joints.results.reader import Results

Component = Literal["x", "y", "z"]
COMPONENTS: tuple[Component, ...] = get_args(Component)


def check_results(results: Any, name: str = "results") -> None:
    """Refuse what is no open results file.

    Raises:
        ValueError: It is none.
    """
    check_kind_of(name, results, isinstance(results, Results), "a Results, as Results(path) gives")


def column_of(component: Any) -> int:
    """Number of a component of a vector.

    Raises:
        ValueError: There is no such component.
    """
    check_choice("component", component, COMPONENTS)
    return COMPONENTS.index(component)


def check_joint(results: Results, joint: Any) -> None:
    """Refuse a joint that a file does not hold.

    Raises:
        ResultsError: It does not.
    """
    check_results(results)
    results.check_joint(joint)


def check_seconds(name: str, value: Any, allowed: str = "positive", least: float = 0.0) -> None:
    """Refuse what is no length of time above ``least``.

    Raises:
        ValueError: It is none.
    """
    check_number(name, value, lambda v: v > least, allowed, unit="s")


def check_band(band: Any) -> None:
    """Refuse what is neither None nor a lowest and a highest frequency.

    Raises:
        ValueError: It is something else.
    """
    pair = None if band is None else numbers_of(band)
    good = band is None or (pair is not None and pair.shape == (2,) and 0 <= pair[0] < pair[1])
    check_kind_of("band", band, bool(good), "a lowest and a highest frequency [Hz]")


def record_number(results: Results, time: float | None, index: int) -> int:
    """Number of a record of the stream ``states``, from 0.

    Args:
        results: the run.
        time: the record nearest to it [s].
        index: number of the record where no time is given, negative from the end.

    Raises:
        ValueError: There is no such record.
    """
    check_results(results)
    if time is not None:
        return results.nearest("states", time)
    rows, number = results.rows("states"), real(index)
    if number != math.floor(number) if math.isfinite(number) else True:
        raise ValueError(f"index is {shown(index)}; it must be a whole number.")
    if not -rows <= number < rows:
        got = shown(index)
        raise ValueError(f"index must be that of one of {rows} recorded states, got {got}.")
    return int(number) % rows
