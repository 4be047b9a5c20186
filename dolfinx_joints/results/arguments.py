# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arguments that say what to read of a results file, checked: components, results, records."""

from __future__ import annotations

from typing import Any, Literal, get_args

from dolfinx_joints.common.parameters import check_kind_of
from dolfinx_joints.results.reader import Results

Component = Literal["x", "y", "z"]
COMPONENTS: tuple[Component, ...] = get_args(Component)


def check_results(results: Any, name: str = "results") -> None:
    """Raise a ValueError for anything but an open results file."""
    check_kind_of(name, results, isinstance(results, Results), "a Results, as Results(path) gives")


def record_number(results: Results, time: float | None, index: int) -> int:
    """Number of a record of the stream ``states``, from 0.

    Args:
        results: the run.
        time: the record nearest to it [s].
        index: number of the record where no time is given, negative from the end.
    """
    check_results(results)
    if time is not None:
        return results.nearest("states", time)
    rows = results.rows("states")
    if not -rows <= index < rows:
        raise ValueError(f"index must be that of one of {rows} recorded states, got {index}.")
    return index % rows
