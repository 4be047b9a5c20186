# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs of a report, their labels, and the content of its sections."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_joints.common.errors import ResultsError, warn
from dolfinx_joints.postprocessing import measures
from dolfinx_joints.postprocessing.body import jointed_groups
from dolfinx_joints.postprocessing.frames import common_frame, usual_reference, zero_name
from dolfinx_joints.postprocessing.joints.surface import is_plane
from dolfinx_joints.postprocessing.peaks import main_values
from dolfinx_joints.report.page import Drawings, Section, plain
from dolfinx_joints.results.arguments import COMPONENTS, Component
from dolfinx_joints.results.reader import Results, listing

_ENDINGS = (".h5", ".hdf5")


@dataclass(frozen=True)
class Run:
    """Results file with its label in the report.

    Attributes:
        results: The file.
        label: Shortest unique end of its path.
        bars: Value and estimated error by name of the values that the run has, see `write`.
    """

    results: Results
    label: str
    bars: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def bar(self, name: str, value: float, factor: float = 1.0) -> str:
        """Return the error bar of a value, times a factor, as text; empty without a bar.

        Names are those of `main_values`.
        """
        given, error = self.bars.get(name, (np.nan, np.nan))
        if not _equal(abs(value), given):
            return ""
        return f"± {plain(factor * error)}, " if np.isfinite(error) else "grows with finer cells, "

    def has(self, stream: str, *names: str) -> bool:
        """Return True if the file has records of these quantities."""
        present = self.results.streams.get(stream)
        return present is not None and set(names) <= set(present) and self.results.rows(stream) > 0

    @property
    def static_alone(self) -> bool:
        """True if the file contains only static stages."""
        return list(self.results.streams) == ["statics"] and self.has("statics")

    @property
    def end(self) -> float:
        """Time of the last recorded step [s], 0 without a record."""
        streams = (s for s in ("histories", "energy", "states") if self.has(s))
        return max((float(self.results.time(s)[-1]) for s in streams), default=0.0)

    @property
    def seconds(self) -> float | None:
        """Duration of the run [s], None if the file does not contain it."""
        stages = self.results.summary.get("seconds")
        return None if stages is None else float(sum(stages.values()))

    @property
    def components(self) -> list[Component]:
        """Components of the displacement, without z in 2-D models."""
        return ["x", "y"] if self.plane else ["x", "y", "z"]

    @property
    def relative_to(self) -> str | None:
        """Reference of the shown displacements, None for the file's own reference."""
        return usual_reference(self.results)

    @property
    def moves(self) -> bool:
        """True if a history has at least two records."""
        return self.has("histories", "displacement") and self.results.rows("histories") > 1

    @cached_property
    def groups(self) -> list[str] | None:
        """Cell groups with joints, which the pictures show; None for the whole body."""
        return jointed_groups(self.results) if "mesh/cells" in self.results.statics else None

    @property
    def plane(self) -> bool:
        """True for a 2-D model."""
        return "mesh/surface" in self.results.statics and is_plane(self.results)

    @property
    def drawable(self) -> bool:
        """True if the file has the nodes and faces that pictures of the body need."""
        needed = {"mesh/nodes", "mesh/surface"} | ({"mesh/cells"} if self.plane else set())
        return needed <= set(self.results.statics)


@dataclass(frozen=True, kw_only=True)
class Addition:
    """Sections that a study adds to a report, and the runs that it compares.

    Attributes:
        first: Sections before the standard sections.
        last: Sections after the standard sections.
        note: Sentence at the end of the summary.
        reference: Run that pictures show in the background; it is the first in tables.
        main: Run that pictures show. Without it, `linear_and_jointed` chooses both runs.
    """

    first: Sequence[Section] = ()
    last: Sequence[Section] = ()
    note: str = ""
    reference: Run | None = None
    main: Run | None = None


@dataclass(frozen=True)
class Content:
    """Runs and drawings of the sections.

    Attributes:
        runs: Compared runs, then the other runs in the given order.
        drawings: Data for the page's scripts; sections add to it.
        main: Run that pictures show.
        reference: Run that pictures show in the background.
    """

    runs: Sequence[Run]
    drawings: Drawings
    main: Run
    reference: Run | None

    @property
    def compared(self) -> list[Run]:
        """Reference and main run, or all runs without a reference."""
        return [self.reference, self.main] if self.reference else list(self.runs)

    @property
    def band(self) -> float:
        """Cut-off frequency of the accelerations of all runs [Hz]."""
        return measures.common_band(*(run.results for run in self.runs if run.has("histories")))

    def save(self, name: str, drawn: Any, *, dpi: int = 130) -> Path:
        """Write a picture to the folder of the report; return its path."""
        return self.drawings.save(name, drawn.figure, dpi)


def components(runs: Iterable[Run]) -> list[Component]:
    """Return the displacement components that any of the runs has."""
    return max((run.components for run in runs), key=len)


def linear_and_jointed(runs: Sequence[Run]) -> tuple[Run | None, Run]:
    """Return the reference run, or None, and the main run.

    If there are only two runs, one with joints, the other one is the reference. Otherwise the
    result is None and the first run with joints. Runs with dynamic stages have precedence.
    """
    moving = [run for run in runs if not run.static_alone] or list(runs)
    with_joints = [run for run in moving if run.results.joints]
    if len(moving) == len(runs) == 2 and len(with_joints) == 1:
        (main,) = with_joints
        return next(run for run in runs if run is not main), main
    return None, (with_joints or moving)[0]


def zeros(runs: Iterable[Run]) -> str:
    """Return the state from which shown displacements count, by run if they differ."""
    return common_frame({run.label: zero_name(run.results, run.relative_to) for run in runs})


def _with_bars(runs: Sequence[Run], bars: Mapping[str, tuple[float, float]]) -> list[Run]:
    """Return each run with the error bars of its values; warn of bars that no run has."""
    band = measures.common_band(*(run.results for run in runs if run.has("histories")))
    barred = []
    for run in runs:
        values = main_values(run.results, band=band)
        own = {n: bar for n, bar in bars.items() if _equal(values.get(n, np.nan), bar[0])}
        barred.append(replace(run, bars=own))
    unshown = [name for name in bars if not any(name in run.bars for run in barred)]
    if unshown:
        warn(f"Error bars are not shown, as no run has these values: {listing(unshown)}.")
    return barred


def _equal(value: float, given: float) -> bool:
    return bool(np.isclose(value, given, rtol=1e-6, atol=0.0))


def largest_moment(run: Run) -> tuple[float, str]:
    """Return the time [s] of the recorded state with the first point's largest displacement.

    The second value describes the time in words.
    """
    results = run.results
    moments = results.time("states")
    if not run.has("histories", "displacement"):
        return float(moments[-1]), "the last record"
    history = partial(measures.displacement_history, results, 0, relative_to=run.relative_to)
    u = np.stack([history(component)[1] for component in COMPONENTS], axis=1)
    rows = [results.nearest("histories", float(moment)) for moment in moments]
    largest = int(np.argmax(np.linalg.norm(u[rows], axis=1)))
    words = f"the largest displacement of {results.point_names[0]} {zeros([run])}"
    return float(moments[largest]), f"{words} among the recorded states"


@contextmanager
def opened(
    paths: Sequence[str | Path], bars: Mapping[str, tuple[float, float]] | None = None
) -> Iterator[list[Run]]:
    """Open results files; label each run by the shortest unique end of its path."""
    resolved = [Path(path).resolve() for path in paths]
    twice = next((path for path in resolved if resolved.count(path) > 1), None)
    if twice is not None:
        raise ResultsError(f"{twice} was given twice.")
    with ExitStack() as stack:
        files = [stack.enter_context(Results(path)) for path in paths]
        names = _names(resolved)
        runs = [Run(file, name) for file, name in zip(files, names, strict=True)]
        yield _with_bars(runs, bars) if bars else runs


def nothing(name: str, title: str, missing: str) -> Section:
    """Return a section that is left out, with what is missing in the files."""
    return Section(name, title, [], missing)


def grouped(texts: Iterable[tuple[str, str]], everyone: Sequence[str] = ()) -> list[str]:
    """Return sentences of runs, each a pair of label and text, with equal sentences as one.

    The labels are left out of a sentence that all runs of ``everyone`` have.
    """
    labels: dict[str, list[str]] = {}
    for label, text in dict.fromkeys(texts):
        labels.setdefault(text, []).append(label)
    return [
        text if of_text == list(everyone) else f"{', '.join(of_text)}: {text}"
        for text, of_text in labels.items()
    ]


def _names(paths: Sequence[Path]) -> list[str]:
    """Return the shortest unique end of each path, without .h5 or .hdf5 if that is unique."""
    short = [path.with_suffix("") if path.suffix in _ENDINGS else path for path in paths]
    parts = [path.parts for path in (short if len(set(short)) == len(short) else paths)]
    names = []
    for path_parts in parts:
        count = 1
        while sum(other[-count:] == path_parts[-count:] for other in parts) > 1:
            count += 1
        names.append("/".join(path_parts[-count:]))
    return names
