# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Demand-capacity ratios of the recorded stresses, overstressed area and time of overstress."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.postprocessing.body import Body
from dolfinx_joints.postprocessing.envelopes import STAGE_STRESSES
from dolfinx_joints.results.reader import Results


class Demand(NamedTuple):
    """Value of a criterion and its place in words.

    Attributes:
        value: Value in SI units.
        where: Place, with the static stage or the level of overstress if there is one.
        limit: Limit at this place, if it depends on the place.
    """

    value: float
    where: str
    limit: float | None = None


def has_strengths(results: Results) -> bool:
    """Return True if the file contains strengths."""
    return "envelopes/strength/tensile" in results.statics


class StressDemand:
    """Stresses of a run divided by the strengths in its file.

    Args:
        results: A run with strengths (`has_strengths`).
        groups: Cell groups to evaluate; the whole body by default.
    """

    def __init__(self, results: Results, groups: Collection[str] | None = None) -> None:
        self._results, self._body = results, Body(results, groups)
        numbers = results.static("envelopes/nodes")
        tensile = results.static("envelopes/strength/tensile")
        chosen = np.isin(numbers, self._body.seen) & np.isfinite(tensile)
        self._rows: Ints = np.flatnonzero(chosen)
        self._nodes: Ints = numbers[self._rows]

    def tension(self) -> Floats:
        """Return the largest principal stress / dynamic tensile strength at the vertices, (n,)."""
        return self._largest("principal_max") / self._strength("dynamic_tensile")

    def of_run(self, name: str, strength: str) -> Demand | None:
        """Return the largest ratio of an envelope of principal stress to a strength."""
        if not self.recorded:
            return None
        ratio = _sign(name) * self._largest(name) / self._strength(strength)
        return Demand(float(ratio.max()), self._place(int(ratio.argmax())))

    def of_stages(self, name: str, strength: str) -> Demand | None:
        """Return the largest ratio of a principal stress to a strength in the static stages."""
        results, series = self._results, STAGE_STRESSES[name]
        if series not in results.streams.get("statics", ()) or not len(self._rows):
            return None
        stages = results.stage_names
        ratios = [
            _sign(name) * results.series("statics", series, i)[self._rows]
            for i in range(len(stages))
        ] / self._strength(strength)
        stage, row = np.unravel_index(ratios.argmax(), ratios.shape)
        where = f"after {stages[stage]}, {self._place(int(row))}"
        return Demand(float(ratios.max()), where)

    def overstressed_area(self) -> Demand | None:
        """Return the share of the area whose tension exceeds the dynamic tensile strength.

        In 3-D it is the share of the recorded surface of the groups without joints, in 2-D of the
        area of their cells. The area of a facet or cell is divided equally among its vertices.
        """
        if not self.recorded:
            return None
        faces, nodes = self._body.shown, self._body.nodes
        faces = faces[np.isin(faces, self._nodes).all(axis=1)]
        corners = nodes[faces]
        cross = np.cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1])
        share = 0.5 * np.linalg.norm(cross, axis=1) / faces.shape[1]
        area = np.bincount(faces.ravel(), np.repeat(share, faces.shape[1]), len(nodes))
        if not area.any():
            return None
        kind = "area of the cells" if self._body.plane else "recorded surface"
        over = area[self._nodes[self.tension() > 1.0]].sum() / area.sum()
        return Demand(float(over), f"of {area.sum():.4g} m², {kind}")

    def overstress_time(self, at_one: float | None) -> Demand | None:
        """Return the time of overstress at the point and level where it is largest beside its limit.

        The limit falls linearly from ``at_one`` [s] at level 1 to zero at level 2. Without it, the
        longest time at level 1 is returned.
        """
        if not self.recorded:
            return None
        levels = self._results.static("envelopes/levels")
        time = self._results.series("envelopes", "overstress_time", -1)[self._rows]
        limits = (at_one or 0.0) * np.clip(2.0 - levels, 0.0, None)
        ratio = time[:, :1]
        if at_one is not None:
            with np.errstate(divide="ignore", invalid="ignore"):
                ratio = np.where(time > 0.0, time / limits, 0.0)
        row, level = np.unravel_index(ratio.argmax(), ratio.shape)
        where = f"above {levels[level]:.1f} x strength, {self._place(int(row))}"
        limit = None if at_one is None else float(limits[level])
        return Demand(float(time[row, level]), where, limit)

    @property
    def recorded(self) -> bool:
        """True if the file has the envelopes of an ended dynamic run at vertices with strengths."""
        results = self._results
        ended = "envelopes" in results.streams and results.rows("envelopes") > 0
        return ended and len(self._rows) > 0

    def _largest(self, name: str) -> Floats:
        return self._results.series("envelopes", name, -1)[self._rows]

    def _strength(self, name: str) -> Floats:
        return np.asarray(self._results.static(f"envelopes/strength/{name}")[self._rows])

    def _place(self, row: int) -> str:
        """Return the cell groups and the coordinates of a vertex."""
        node, start = self._nodes[row], "mesh/groups/"
        cells = self._results.static("mesh/cells")
        names = [name for name in self._results.statics if name.startswith(start)]
        groups = [n.removeprefix(start) for n in names if node in cells[self._results.static(n)]]
        x = self._body.nodes[node][: 2 if self._body.plane else 3]
        place = f"at ({', '.join(f'{value + 0.0:.4g}' for value in x)}) m"
        return f"{' and '.join(groups)} {place}".strip()


def _sign(name: str) -> float:
    return 1.0 if name == "principal_max" else -1.0
