# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Body and joints of a results file as unstructured grids: points, cells and values on them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.postprocessing.joints.surface import JointSurface, Statics
from dolfinx_joints.results.arguments import rows_of_groups
from dolfinx_joints.results.reader import Results

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

POLYGON, VERTEX = 7, 1  # VTK's numbers
UNITS = {"gap": "m", "traction": "Pa", "status": "-", "pressure": "Pa", "broken": "-"}


@dataclass(frozen=True, kw_only=True)
class Grid:
    """An unstructured grid.

    Attributes:
        points: Shape (num_points, 3), [m].
        connectivity: Points of the cells, one cell after the other.
        offsets: Where each cell begins in ``connectivity``, and its length, (num_cells + 1,).
        kinds: VTK's number of each cell's shape, (num_cells,).
        cell_data: Values of cells that do not change, by name with unit.
    """

    points: Floats
    connectivity: Ints
    offsets: Ints
    kinds: NDArray[np.uint8]
    cell_data: Mapping[str, ArrayLike] = field(default_factory=dict)


def body_grid(results: Results, groups: Collection[str] | None = None) -> Grid:
    """Grid of the body, all nodes of the file, and its cells.

    Args:
        results: The run.
        groups: Names of the cell groups that are wanted; all cells unless given.

    Raises:
        ResultsError: The file has no cells (of a version before them), or not these groups.
    """
    if "mesh/cells" not in results.statics:
        raise ResultsError(
            f"{results.path} holds the boundary of the body but not its cells, as it was written "
            "by an earlier version; run again."
        )
    cells = results.static("mesh/cells")
    chosen = np.arange(len(cells)) if groups is None else rows_of_groups(results, groups)
    return uniform_grid(
        results.static("mesh/nodes"), cells[chosen], int(results.static("mesh/cell_kind")[0])
    )


def uniform_grid(points: Floats, cells: NDArray[np.integer[Any]], kind: int) -> Grid:
    """Grid of cells of one kind, shape (num_cells, nodes per cell)."""
    count, nodes = cells.shape
    return Grid(
        points=points,
        connectivity=cells.ravel().astype(np.int64),
        offsets=nodes * np.arange(count + 1, dtype=np.int64),
        kinds=np.full(count, kind, dtype=np.uint8),
    )


class StaticArrays(dict[str, NDArray[Any]]):
    """Arrays of mesh and joints by the names that a results file has for them."""

    def static(self, name: str) -> NDArray[Any]:
        """Return an array."""
        return self[name]

    def check_joint(self, joint: str) -> None:
        """Accept every joint: an array that is missing raises a KeyError."""


def joint_grid(results: Statics, joint: str) -> Grid:
    """Grid of a joint: a polygon for each joint point, the part of its facet nearest to it.

    In a plane model each point is a vertex.
    """
    static = {
        name: results.static(f"joints/{joint}/{name}") for name in ("points", "areas", "frames")
    }
    if results.static("mesh/surface").shape[1] == 2:
        polygons = [point[None] for point in static["points"]]
    else:
        polygons = JointSurface(results, joint).patches_in_space()
    offsets = np.cumsum([0, *map(len, polygons)])
    axes = {name: static["frames"][:, i] for i, name in enumerate(("n", "s1", "s2"))}
    return Grid(
        points=np.concatenate(polygons),
        connectivity=np.arange(offsets[-1]),
        offsets=offsets,
        kinds=np.array([POLYGON if len(p) > 2 else VERTEX for p in polygons], dtype=np.uint8),
        cell_data={"area [m^2]": static["areas"], **{f"axis {k} [-]": v for k, v in axes.items()}},
    )


def joined(grids: Mapping[str, Grid]) -> Grid:
    """Several grids as one, with the number of each cell's grid as ``joint [-]``, from 0."""
    every = list(grids.values())
    points = np.cumsum([0, *(len(grid.points) for grid in every)])
    ends = np.cumsum([0, *(grid.offsets[-1] for grid in every)])
    number = np.repeat(np.arange(len(every)), [len(grid.kinds) for grid in every])
    names = every[0].cell_data if every else ()
    data = {name: np.concatenate([np.asarray(g.cell_data[name]) for g in every]) for name in names}
    return Grid(
        points=np.concatenate([grid.points for grid in every]),
        connectivity=np.concatenate(
            [g.connectivity + first for g, first in zip(every, points, strict=False)]
        ),
        offsets=np.concatenate(
            [[0], *(g.offsets[1:] + first for g, first in zip(every, ends, strict=False))]
        ).astype(np.int64),
        kinds=np.concatenate([grid.kinds for grid in every]),
        cell_data={"joint [-]": number, **data},
    )


def joint_values(values: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Values of joint points under the names that files and grids show, with units.

    The gap is also shown as what people look for, opening and tangential gap.

    Args:
        values: By the names of the stream ``states``, such as ``gap``, shape (n, ...).
    """
    found = {f"{name} [{UNITS[name]}]": each for name, each in values.items()}
    gap = values["gap"]
    return found | {
        "opening [m]": np.maximum(gap[:, 0], 0.0),
        "tangential gap [m]": np.hypot(gap[:, 1], gap[:, 2]),
    }
