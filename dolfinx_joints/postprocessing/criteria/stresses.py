# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Recorded stresses divided by strengths, overstressed area and time of overstress."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.postprocessing.body import Body, face_areas
from dolfinx_joints.postprocessing.envelopes import DYNAMIC_TENSILE, FACETS, LEVELS, STAGE_STRESSES
from dolfinx_joints.results.reader import Results

Found = tuple[str, str, float, float | None]  # name, place, value, limit if the place sets it
_WITHIN_ROUNDING = 1e-9, 0.0  # tolerances of values that count as the largest one; first is named


class StressRatios:
    """Stresses divided by strengths at the vertices of cell groups that have a strength."""

    def __init__(self, results: Results, groups: Collection[str] | None) -> None:
        self._results, self._body = results, Body(results, groups)
        nodes, strength = (results.static(n) for n in ("envelopes/nodes", DYNAMIC_TENSILE))
        self._rows = np.flatnonzero(np.isfinite(strength) & np.isin(nodes, self._body.seen))
        self._nodes = nodes[self._rows]
        if not len(self._rows):
            raise ValueError(f"{results.path} has no stresses at vertices with a strength.")

    def demands(self, time_limit: float | None) -> Iterator[Found]:
        """Yield the recorded values; ``time_limit`` is that of the time of overstress [s]."""
        streams, rows = self._results.streams, self._results.rows
        if STAGE_STRESSES["principal_max"] in streams.get("statics", ()):
            yield self._worst("static_tension", "statics", "principal_max", "tensile")
            yield self._worst("static_compression", "statics", "principal_min", "compressive")
        if "envelopes" in streams and rows("envelopes"):
            yield self._worst("tension", "envelopes", "principal_max", "dynamic_tensile")
            yield self._worst("compression", "envelopes", "principal_min", "compressive")
            yield self._area()
            yield self._time(time_limit)

    def _ratios(self, stream: str, series: str, strength: str) -> Floats:
        """Return stress / strength of all records of an envelope, shape (records, n)."""
        series = STAGE_STRESSES[series] if stream == "statics" else series
        stress = self._results.series(stream, series)[:, self._rows] / self._capacity(strength)
        return -stress if strength == "compressive" else stress

    def _capacity(self, strength: str) -> Floats:
        """Return a strength of the vertices, shape (n,), [Pa]."""
        return np.asarray(self._results.static(f"envelopes/strength/{strength}")[self._rows])

    def _worst(self, name: str, stream: str, series: str, strength: str) -> Found:
        """Return the largest ratio of a series."""
        ratios = self._ratios(stream, series, strength)
        if np.isnan(ratios).any():
            return name, "a stress is not a number", np.nan, None
        record, row = np.argwhere(np.isclose(ratios, ratios.max(), *_WITHIN_ROUNDING))[0].tolist()
        stage = f"after {self._results.stage_names[record]}, " if stream == "statics" else ""
        capacity = 1e-6 * self._capacity(strength)[row]
        values = f"{ratios[record, row] * capacity:.4g} MPa of {capacity:.4g} MPa"
        return name, f"{values}, {stage}{self._place(row)}", ratios.max(), None

    def _area(self) -> Found:
        """Return the overstressed share of the recorded facets, in 2-D of the cells.

        If no facets are named in ``envelopes``, these are the boundary facets without joints. The
        area of each facet or cell is divided equally among its vertices.
        """
        faces, nodes = self._body.free, self._body.nodes
        if FACETS in self._results.statics:
            faces = self._results.static(FACETS)
        if faces.shape[1] == 2:
            return "overstressed_area", "stresses are recorded along lines only", np.nan, None
        faces = faces[np.isin(faces, self._nodes).all(axis=1)]
        share = face_areas(nodes, faces) / faces.shape[1]
        area = np.bincount(faces.ravel(), np.repeat(share, faces.shape[1]), len(nodes))
        ratios = self._ratios("envelopes", "principal_max", "dynamic_tensile")[-1]
        if not area.any() or np.isnan(ratios).any():
            return "overstressed_area", "no faces with stresses at all vertices", np.nan, None
        over = area[self._nodes[ratios > 1.0]].sum() / area.sum()
        return "overstressed_area", f"of {area.sum():.4g} m²", over, None

    def _time(self, limit: float | None) -> Found:
        """Return the time of overstress where it is largest relative to its limit.

        The limit falls linearly from ``limit`` at level 1 to zero at level 2. Without a limit the
        longest time at level 1 is returned.
        """
        levels = LEVELS[:1] if limit is None else LEVELS
        time = self._results.series("envelopes", "overstress_time", -1)[self._rows, : len(levels)]
        if np.isnan(time).any():
            return "overstress_time", "a time is not a number", np.nan, None
        limits = (1.0 if limit is None else limit) * (2.0 - levels)
        with np.errstate(divide="ignore"):
            ratio = np.divide(time, limits, out=np.zeros_like(time), where=time > 0.0)
        row, level = np.argwhere(np.isclose(ratio, ratio.max(), *_WITHIN_ROUNDING))[0].tolist()
        where = f"above {levels[level]:.1f} x dynamic tensile strength, {self._place(row)}"
        allowed = None if limit is None else float(limits[level])
        return "overstress_time", where, time[row, level], allowed

    def _place(self, row: int) -> str:
        """Return the cell groups and the coordinates of a vertex."""
        node, results = self._nodes[row], self._results
        cells = results.static("mesh/cells")
        groups = [name for name in results.statics if name.startswith("mesh/groups/")]
        own = [name.split("/", 2)[2] for name in groups if node in cells[results.static(name)]]
        axes = 2 if self._body.plane else 3
        place = ", ".join(f"{round(x, 6) + 0.0:.4g}" for x in self._body.nodes[node][:axes])
        return f"{' and '.join(own)} ({place}) m".strip()
