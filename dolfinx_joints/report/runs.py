# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The runs of a report: their names, what their files hold, and which of them belong together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.results.reader import Results
from dolfinx_joints.results.requests import Component

# What a run computes on, not what it computes: runs that differ only in these estimate the error.
_DISCRETISATION = ("size", "order", "cell", "layers", "time_step", "scheme")
_ENDINGS = (".h5", ".hdf5")
# Facts of the machine and the files, and consequences of the discretisation.
_NEITHER = {
    *("run", "steps", "stage", "point_names", "dofs", "cells", "joint_points", "ranks", "units"),
    *("solver", "out", "every", "workers", "envelopes", "manifest"),
}


@dataclass(frozen=True)
class Run:
    """A results file and what the report calls it."""

    results: Results
    label: str

    def has(self, stream: str, *names: str) -> bool:
        """Whether the file has records of these quantities."""
        present = self.results.streams.get(stream)
        return (
            present is not None
            and all(name in present for name in names)
            and self.results.rows(stream) > 0
        )

    @property
    def end(self) -> float:
        """Time of the last step [s], 0 if none was recorded."""
        streams = (s for s in ("histories", "energy", "states") if self.has(s))
        return max((float(self.results.time(s)[-1]) for s in streams), default=0.0)

    @property
    def seconds(self) -> float | None:
        """Seconds that the run took, None where the file does not say."""
        value = self.results.summary.get("seconds")
        if isinstance(value, dict):
            return float(sum(value.values()))
        return None if value is None else float(value)

    @property
    def components(self) -> list[Component]:
        """Components of the displacement: z is left out of plane models."""
        return ["x", "y"] if self.plane else ["x", "y", "z"]

    @property
    def moves(self) -> bool:
        """Whether a history has a second record to tell a motion by."""
        return self.has("histories", "displacement") and self.results.rows("histories") > 1

    @property
    def plane(self) -> bool:
        """Whether the model is plane: its boundary consists of lines."""
        statics = self.results.statics
        return "mesh/surface" in statics and self.results.static("mesh/surface").shape[1] == 2


@dataclass(frozen=True)
class Pair:
    """The same case without and with joints, on one mesh and in the same steps."""

    linear: Run
    joints: Run

    def __iter__(self) -> Iterator[Run]:
        """First the linear run."""
        return iter((self.linear, self.joints))

    @property
    def discretisation(self) -> str:
        """Mesh and step in words."""
        facts = self.joints.results.metadata
        words = [f"{key.replace('_', ' ')} {facts[key]}" for key in _DISCRETISATION if key in facts]
        return ", ".join(words)


def components(runs: Iterable[Run]) -> list[Component]:
    """Components of the displacement that any of the runs has."""
    return max((run.components for run in runs), key=len)


@contextmanager
def opened(paths: Sequence[str | Path]) -> Iterator[list[Run]]:
    """Runs of results files, closed at the end.

    Args:
        paths: the files; each is called by the shortest end of its path that no other has.

    Raises:
        ResultsError: no file, one file twice, or one that cannot be read.
    """
    if not paths:
        raise ResultsError("A report needs at least one results file, got none.")
    resolved = [Path(path).resolve() for path in paths]
    twice = next((path for path in resolved if resolved.count(path) > 1), None)
    if twice is not None:
        raise ResultsError(f"{twice} was given twice.")
    with ExitStack() as stack:
        files = [stack.enter_context(Results(path)) for path in paths]
        names = _names(_without_endings(resolved))
        yield [Run(file, name) for file, name in zip(files, names, strict=True)]


def pairs(runs: Sequence[Run], case: str) -> list[Pair]:
    """Pairs of a linear and a jointed run, those of the first pair's physics and duration.

    Args:
        runs: in the order given; the first linear and jointed runs that fit make the first pair.
        case: the case that their metadata name.
    """
    chosen = [run for run in runs if run.results.metadata.get("case") == case]
    linear = [run for run in chosen if run.results.metadata.get("run") == "linear"]
    joints = [run for run in chosen if run.results.metadata.get("run") == "joints"]
    found: list[Pair] = []
    for one in joints:
        partner = next((other for other in linear if _alike(one, other, same_mesh=True)), None)
        if partner is not None and all(
            _alike(one, other.joints, same_mesh=False) for other in found[:1]
        ):
            found.append(Pair(partner, one))
    return found


def _alike(one: Run, other: Run, *, same_mesh: bool) -> bool:
    """Whether two runs differ in nothing but joints, or mesh and step, and last equally long."""
    first, second = one.results.metadata, other.results.metadata
    left_out = _NEITHER if same_mesh else {*_NEITHER, *_DISCRETISATION}
    keys = (set(first) | set(second)) - left_out
    step = max((_step(run) for run in (one, other)), default=0.0)
    return all(first.get(key) == second.get(key) for key in keys) and bool(
        abs(one.end - other.end) <= 1.5 * step
    )


def _step(run: Run) -> float:
    if not run.has("histories") or run.results.rows("histories") < 2:
        return 0.0
    return float(np.diff(run.results.time("histories")[:2])[0])


def _without_endings(paths: Sequence[Path]) -> list[Path]:
    """Paths without .h5 or .hdf5, where that leaves them different."""
    short = [path.with_suffix("") if path.suffix in _ENDINGS else path for path in paths]
    return short if len(set(short)) == len(short) else list(paths)


def _names(paths: Sequence[Path]) -> list[str]:
    """The shortest end of each path that tells it from the others."""

    def end(path: Path, parts: int) -> str:
        return "/".join(path.parts[-parts:])

    names = []
    for path in paths:
        others: list[Any] = [other for other in paths if other != path]
        parts = next(
            (
                n
                for n in range(1, len(path.parts))
                if end(path, n) not in {end(o, n) for o in others}
            ),
            len(path.parts),
        )
        names.append(end(path, parts))
    return names
