# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of the arguments that select the part of a results file to read."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, Literal, get_args

import numpy as np
from h5py import Group

from dolfinx_joints.common.arrays import Ints
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.common.parameters import check_kind_of, shown
from dolfinx_joints.results.reader import Results, listing

Component = Literal["x", "y", "z"]
COMPONENTS: tuple[Component, ...] = get_args(Component)


def check_results(results: Any) -> None:
    """Raise a ValueError if the argument is not a `Results`."""
    is_results = isinstance(results, Results)
    check_kind_of("results", results, is_results, "a Results object, such as Results(path)")


def record_number(results: Results, time: float | None, index: int) -> int:
    """Return the record number in ``states`` nearest to a time [s]; without a time, at an index."""
    check_results(results)
    if time is not None:
        return results.nearest("states", time)
    rows = results.rows("states")
    if not -rows <= index < rows:
        raise ValueError(f"index must be from {-rows} to {rows - 1} ({rows} states), got {index}.")
    return index % rows


class StageStates(Results):
    """View of an open results file whose stream ``states`` contains the static stages.

    Args:
        results: The file. Closing it closes this view as well.
    """

    def __init__(self, results: Results) -> None:
        self.path, self._opened = results.path, results._opened
        self._names, self._rows = results._names, results._rows

    @property
    def relative(self) -> bool:
        """Always True, because the ground is at rest in static stages."""
        return True

    @property
    def streams(self) -> dict[str, list[str]]:
        """Names of the series of each stream."""
        streams = super().streams
        return streams | {"states": streams.get("statics", [])}

    def _stream(self, stream: str) -> Group:
        return super()._stream("statics" if stream == "states" else stream)


def chosen_state(
    results: Results, time: float | None, index: int, stage: int | str | None
) -> tuple[Results, int, str]:
    """Return the results to read, the record number in ``states``, and its time in words.

    Args:
        results: The run.
        time: Time [s]; the nearest record is chosen.
        index: Record number if no time is given, negative from the end. In a file with static
            stages only, it is the number of the stage.
        stage: Name or number of a static stage, which replaces the index.
    """
    check_results(results)
    if stage is not None and time is not None:
        raise ValueError(f"Give a time or a stage, not both; got time={time}, stage={stage!r}.")
    if stage is None and time is None and "states" not in results.streams and results.stage_names:
        stage = index
    if stage is not None:
        number = results.stage_index(stage)
        return StageStates(results), number, f"after {results.stage_names[number]}"
    number = record_number(results, time, index)
    return results, number, f"at t = {results.time('states')[number]:.3f} s"


def rows_of_groups(results: Results, groups: Collection[str]) -> Ints:
    """Return the rows of ``mesh/cells`` that belong to cell groups, shape (n,).

    Raises:
        ValueError: ``groups`` is a string, not a list of names.
        ResultsError: The file has no group of that name.
    """
    check_kind_of("groups", groups, not isinstance(groups, str), "a list of names of cell groups")
    start = "mesh/groups/"
    available = [name.removeprefix(start) for name in results.statics if name.startswith(start)]
    for name in groups:
        if name not in available:
            raise ResultsError(
                f"No cell group {shown(name)} in {results.path}; it has {listing(available)}."
            )
    rows = [results.static(f"{start}{name}") for name in groups]
    return np.unique(np.concatenate(rows)) if rows else np.empty(0, dtype=np.int64)
