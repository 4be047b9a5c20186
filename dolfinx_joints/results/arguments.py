# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arguments that say what to read of a results file, checked: components, results, records."""

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
    """Raise a ValueError for anything but an open results file."""
    is_one = isinstance(results, Results)
    check_kind_of("results", results, is_one, "a Results, as Results(path) gives")


def record_number(results: Results, time: float | None, index: int) -> int:
    """Number of a record of ``states``, from 0: nearest to a time [s], else by an index."""
    check_results(results)
    if time is not None:
        return results.nearest("states", time)
    rows = results.rows("states")
    if not -rows <= index < rows:
        raise ValueError(f"index must be that of one of {rows} recorded states, got {index}.")
    return index % rows


class StageStates(Results):
    """An open results file whose stream ``states`` is that of the static stages.

    Args:
        results: The file, which closes this one too.
    """

    def __init__(self, results: Results) -> None:
        self.path, self._opened = results.path, results._opened
        self._names, self._rows = results._names, results._rows

    @property
    def relative(self) -> bool:
        """Whether displacements are relative to the ground, which rests in static stages."""
        return True

    @property
    def streams(self) -> dict[str, list[str]]:
        """Names of the series of each stream."""
        found = super().streams
        return found | {"states": found.get("statics", [])}

    def _stream(self, stream: str) -> Group:
        return super()._stream("statics" if stream == "states" else stream)


def chosen_state(
    results: Results, time: float | None, index: int, stage: int | str | None
) -> tuple[Results, int, str]:
    """State to be drawn: where it is the record of ``states``, its number, and when it was.

    Args:
        results: the run.
        time: the record nearest to it [s].
        index: number of the record where no time is given, negative from the end; in a file of
            static stages alone that of the stage.
        stage: a static stage instead, by its name or number.
    """
    check_results(results)
    if stage is None and time is None and "states" not in results.streams and results.stage_names:
        stage = index
    if stage is not None:
        number = results.stage_index(stage)
        return StageStates(results), number, f"after {results.stage_names[number]}"
    number = record_number(results, time, index)
    return results, number, f"at t = {results.time('states')[number]:.3f} s"


def rows_of_groups(results: Results, groups: Collection[str]) -> Ints:
    """Rows of ``mesh/cells`` that make up cell groups.

    Raises:
        ValueError: A name alone is given.
        ResultsError: There is no such group.
    """
    check_kind_of("groups", groups, not isinstance(groups, str), "a list of names of cell groups")
    start = "mesh/groups/"
    known = [name.removeprefix(start) for name in results.statics if name.startswith(start)]
    for name in groups:
        if name not in known:
            raise ResultsError(
                f"No cell group {shown(name)} in {results.path}; it has {listing(known)}."
            )
    rows = [results.static(f"{start}{name}") for name in groups]
    return np.unique(np.concatenate(rows)) if rows else np.empty(0, dtype=np.int64)
