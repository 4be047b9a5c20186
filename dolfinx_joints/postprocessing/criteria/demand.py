# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ratios of recorded stresses to strengths, overstressed area and time of overstress."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.postprocessing.body import Body
from dolfinx_joints.postprocessing.envelopes import STAGE_STRESSES, has_strengths
from dolfinx_joints.results.reader import Results


class Demand(NamedTuple):
    """Value of a criterion in SI units, its place in words, and its limit if the place sets it."""

    value: float
    where: str
    limit: float | None = None


def stress_demands(
    results: Results, groups: Collection[str] | None, time_limit: float | None
) -> dict[str, Demand]:
    """Return the recorded values of the criteria of stresses, by attribute of `Limits`.

    ``time_limit`` is the allowed time of overstress at a ratio of 1 [s].
    """
    if not has_strengths(results):
        return {}
    demand = _StressDemand(results, groups)
    found = {}
    if STAGE_STRESSES["principal_max"] in results.streams.get("statics", ()):
        found["static_tension"] = demand.of_stages("principal_max", "tensile")
        found["static_compression"] = demand.of_stages("principal_min", "compressive")
    if "envelopes" in results.streams and results.rows("envelopes"):
        found["tension"] = demand.of_run("principal_max", "dynamic_tensile")
        found["compression"] = demand.of_run("principal_min", "compressive")
        found["overstressed_area"] = demand.area()
        found["overstress_time"] = demand.time(time_limit)
    return found


class _StressDemand:
    """Stresses at the vertices of cell groups with a strength."""

    def __init__(self, results: Results, groups: Collection[str] | None) -> None:
        self._results, self._body = results, Body(results, groups)
        nodes, strength = results.static("envelopes/nodes"), self._strength("tensile", slice(None))
        chosen = np.isin(nodes, self._body.seen) & np.isfinite(strength)
        if not chosen.any():
            raise ValueError("No recorded stress is at a vertex of the groups with a strength.")
        self._rows: Ints = np.flatnonzero(chosen)
        self._nodes: Ints = nodes[self._rows]

    def of_run(self, name: str, strength: str) -> Demand:
        """Return the largest ratio of an envelope of principal stress to a strength."""
        ratio = self._ratio(self._results.series("envelopes", name, -1), name, strength)
        return Demand(float(ratio.max()), self._place(ratio.argmax()))

    def of_stages(self, name: str, strength: str) -> Demand:
        """Return the largest ratio of a principal stress to a strength in the static stages."""
        largest = []
        for i, stage in enumerate(self._results.stage_names):
            stress = self._results.series("statics", STAGE_STRESSES[name], i)
            ratio = self._ratio(stress, name, strength)
            where = f"after {stage}, {self._place(ratio.argmax())}"
            largest.append(Demand(float(ratio.max()), where))
        return max(largest)

    def area(self) -> Demand:
        """Return the share of the area whose tension exceeds the dynamic tensile strength.

        The area is the recorded surface without joints, in 2-D the cells. Each facet or cell is
        divided equally among its vertices.
        """
        faces, nodes = self._body.shown, self._body.nodes
        faces = faces[np.isin(faces, self._nodes).all(axis=1)]
        corners = nodes[faces]
        cross = np.cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1])
        share = 0.5 * np.linalg.norm(cross, axis=1) / faces.shape[1]
        area = np.bincount(faces.ravel(), np.repeat(share, faces.shape[1]), len(nodes))
        largest = self._results.series("envelopes", "principal_max", -1)
        over = self._nodes[self._ratio(largest, "principal_max", "dynamic_tensile") > 1.0]
        return Demand(float(area[over].sum() / area.sum()), f"of {area.sum():.4g} m²")

    def time(self, limit: float | None) -> Demand:
        """Return the time of overstress where its ratio to the limit is largest.

        The limit falls linearly from ``limit`` [s] at level 1 to zero at level 2. Without a limit,
        the longest time at level 1 is returned.
        """
        levels = self._results.static("envelopes/levels")[: None if limit else 1]
        time = self._results.series("envelopes", "overstress_time", -1)[self._rows, : len(levels)]
        limits = (limit or 1.0) * (2.0 - levels)
        with np.errstate(divide="ignore"):
            ratio = np.divide(time, limits, out=np.zeros_like(time), where=time > 0.0)
        row, level = np.unravel_index(ratio.argmax(), ratio.shape)
        where = f"above {levels[level]:.1f} x strength, {self._place(row)}"
        return Demand(float(time[row, level]), where, float(limits[level]) if limit else None)

    def _ratio(self, stress: Floats, name: str, strength: str) -> Floats:
        sign = 1.0 if name == "principal_max" else -1.0
        return sign * stress[self._rows] / self._strength(strength, self._rows)

    def _strength(self, name: str, rows: Ints | slice) -> Floats:
        return np.asarray(self._results.static(f"envelopes/strength/{name}")[rows])

    def _place(self, row: np.intp) -> str:
        """Return the cell groups and the coordinates of a vertex."""
        node, start, results = self._nodes[row], "mesh/groups/", self._results
        cells = results.static("mesh/cells")
        groups = [
            name.removeprefix(start)
            for name in results.statics
            if name.startswith(start) and node in cells[results.static(name)]
        ]
        place = ", ".join(f"{x + 0.0:.4g}" for x in self._body.nodes[node])
        return f"{' and '.join(groups)} at ({place}) m".strip()
