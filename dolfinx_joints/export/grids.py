# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Body and joints of a results file as unstructured grids with values."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, vstack

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.postprocessing.joints.surface import JointFacets, facets_of_joint, is_plane
from dolfinx_joints.results.arguments import rows_of_groups
from dolfinx_joints.results.joint_points import Statics, tied_points
from dolfinx_joints.results.quantities import JointPoints, at_points, rows_below, rows_by
from dolfinx_joints.results.reader import Results

Array = Any  # NumPy array or `Dealt`

POLYGON, VERTEX = 7, 1  # VTK cell types


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Unstructured grid, complete (possibly with distributed arrays) or the part of a rank.

    Attributes:
        points: Shape (num_points, 3), [m].
        connectivity: Point numbers of all cells in turn.
        offsets: First entry of each cell in ``connectivity``, and the total, (num_cells + 1,).
        kinds: VTK type of each cell, (num_cells,).
        cell_data: Constant values of the cells, by name with unit.
        motion: Matrix from displacements of the nodes of the body to displacements of the points,
            shape (num_points, num_nodes); None for a body, whose points are the nodes.
    """

    points: Array
    connectivity: Array
    offsets: Array
    kinds: Array
    cell_data: Mapping[str, Array] = field(default_factory=dict)
    motion: csr_matrix | None = None


def body_grid(results: Results, groups: Collection[str] | None = None) -> Grid:
    """Return the grid of the body: all nodes of the file, and its cells.

    Args:
        results: The run.
        groups: Names of cell groups; all cells by default.

    Raises:
        ResultsError: The file has no cells (earlier versions), or not these groups.
    """
    if "mesh/cells" not in results.statics:
        raise ResultsError(
            f"{results.path} was written by an earlier version and has the boundary of the body "
            "but not its cells; repeat the run."
        )
    cells = results.static("mesh/cells")
    chosen = np.arange(len(cells)) if groups is None else rows_of_groups(results, groups)
    start = "mesh/groups/"
    paths = [name for name in results.statics if name.startswith(start)]
    rows = {name.removeprefix(start): results.static(name) for name in paths}
    members = {name: np.flatnonzero(np.isin(chosen, group)) for name, group in rows.items()}
    kind = int(results.static("mesh/cell_kind")[0])
    return uniform_grid(results.static("mesh/nodes"), cells[chosen], kind, members)


def uniform_grid(points: Floats, cells: Ints, kind: int, groups: Mapping[str, Ints]) -> Grid:
    """Return a grid of cells of one type, given their nodes, shape (num_cells, nodes per cell).

    ``groups`` are rows of ``cells`` by name; ``in NAME [-]`` is 1 in the cells of a group, else 0.
    """
    count, nodes = cells.shape
    marks = {f"in {name} [-]": np.zeros(count, dtype=np.int8) for name in groups}
    for mark, rows in zip(marks.values(), groups.values(), strict=True):
        mark[rows] = 1
    return Grid(
        points=points,
        connectivity=cells.ravel().astype(np.int64),
        offsets=nodes * np.arange(count + 1, dtype=np.int64),
        kinds=np.full(count, kind, dtype=np.uint8),
        cell_data=marks,
    )


class StaticArrays(dict[str, NDArray[Any]]):
    """Arrays of mesh and joints in memory, by their names in a results file."""

    @property
    def statics(self) -> Collection[str]:
        """Names of the arrays."""
        return self.keys()

    def static(self, name: str) -> NDArray[Any]:
        """Return the array with this name."""
        return self[name]


def joint_grid(results: Statics, joint: str) -> Grid:
    """Return the grid of a joint; each joint point is a polygon, the nearest part of its facet.

    In a plane model each point is a vertex. The displacement is the mean of both faces.
    """
    static = {
        name: results.static(f"joints/{joint}/{name}") for name in ("points", "areas", "frames")
    }
    polygons: list[Any] = []
    if not len(static["points"]):  # a rank may have no joint points
        motion = csr_matrix((0, len(results.static("mesh/nodes"))))
    elif is_plane(results):
        polygons = [point[None] for point in static["points"]]
        motion = _motion_of_points(results, joint, static["points"])
    else:
        surface = JointFacets(results, joint)
        polygons = surface.patches_in_space()
        weights, lengths = np.concatenate(surface.patch_weights()), list(map(len, polygons))
        numbers = surface.nodes()[np.repeat(surface.facet_of_point, lengths)]
        motion = _mean_of_faces(results, weights, numbers)
    offsets = np.cumsum([0, *map(len, polygons)])
    points = np.concatenate(polygons) if polygons else np.zeros((0, 3))
    axes = {name: static["frames"][:, i] for i, name in enumerate(("n", "s1", "s2"))}
    return Grid(
        points=points,
        connectivity=np.arange(offsets[-1]),
        offsets=offsets,
        kinds=np.array([POLYGON if len(p) > 2 else VERTEX for p in polygons], dtype=np.uint8),
        cell_data={
            "area [m^2]": static["areas"],
            **{f"axis {k} [-]": v for k, v in axes.items()},
            "tied [-]": tied_points(results, joint).astype(np.int8),
        },
        motion=motion,
    )


def _motion_of_points(results: Statics, joint: str, points: Floats) -> csr_matrix:
    """Return `Grid.motion` for the points of a joint in a plane body."""
    nodes, surface = results.static("mesh/nodes"), results.static("mesh/surface")
    facet_of_point, sides = facets_of_joint(results, joint)
    ends = surface[sides[facet_of_point]]  # (points, sides, ends)
    along = nodes[ends[:, :, 1]] - nodes[ends[:, :, 0]]
    share = np.einsum("psi,psi->ps", points[:, None] - nodes[ends[:, :, 0]], along)
    share /= np.einsum("psi,psi->ps", along, along)
    return _mean_of_faces(results, np.stack([1.0 - share, share], axis=1), ends.swapaxes(1, 2))


def _mean_of_faces(results: Statics, weights: NDArray[Any], numbers: NDArray[Any]) -> csr_matrix:
    """Return `Grid.motion` from weights of corners, (points, corners[, sides]), and their nodes."""
    weights = np.broadcast_to(weights.reshape(*weights.shape[:2], -1) / 2.0, numbers.shape)
    rows = np.repeat(np.arange(len(weights)), weights[0].size)
    shape = (len(weights), len(results.static("mesh/nodes")))
    return csr_matrix((weights.ravel(), (rows, numbers.ravel())), shape)


def joined(grids: Mapping[str, Grid]) -> Grid:
    """Combine several grids into one.

    Cell data ``in NAME [-]`` is 1 in the cells of a grid, and ``joint [-]`` is its number, from 0.
    """
    parts = list(grids.values())
    points = np.cumsum([0, *(len(grid.points) for grid in parts)])
    ends = np.cumsum([0, *(grid.offsets[-1] for grid in parts)])
    number = np.repeat(np.arange(len(parts)), [len(grid.kinds) for grid in parts])
    names = parts[0].cell_data if parts else ()
    data = {name: np.concatenate([np.asarray(g.cell_data[name]) for g in parts]) for name in names}
    return Grid(
        points=np.concatenate([grid.points for grid in parts]),
        connectivity=np.concatenate(
            [g.connectivity + first for g, first in zip(parts, points, strict=False)]
        ),
        offsets=np.concatenate(
            [[0], *(g.offsets[1:] + first for g, first in zip(parts, ends, strict=False))]
        ).astype(np.int64),
        kinds=np.concatenate([grid.kinds for grid in parts]),
        cell_data={
            **{f"in {name} [-]": (number == i).astype(np.int8) for i, name in enumerate(grids)},
            "joint [-]": number,
            **data,
        },
        motion=vstack([grid.motion for grid in parts], format="csr"),
    )


def joint_values(
    values: Mapping[str, NDArray[Any]],
    cell_data: Mapping[str, NDArray[Any]],
    count: int = 1,
    added: Callable[[Floats], Floats] = np.asarray,
) -> dict[str, Any]:
    """Return values of joint points by their names in exported files, which include units.

    The opening and the tangential gap are added. Means over a joint are repeated at all its points.

    Args:
        values: Values by name in the stream ``states``, such as ``gap``, shape (n, ...).
        cell_data: Cell data of the grid of these points.
        count: Number of joints in the grid.
        added: Function that sums values over the parts of the grid.
    """
    units = {row.key: row.unit for row in rows_below("states", "joints/*/")}
    named: dict[str, Any] = {f"{name} [{units[name]}]": data for name, data in values.items()}
    gap, rows = values["gap"], rows_by("mean")
    joint = cell_data.get("joint [-]", np.zeros(len(gap), dtype=np.int64))
    areas = np.where(cell_data["tied [-]"] == 0, cell_data["area [m^2]"], 0.0)
    points = JointPoints(gap, gap[:, 1:], values["traction"], np.zeros(len(gap)))
    columns = [areas, *(areas * column for column in at_points(rows, points))]
    total, *sums = added(np.stack([np.bincount(joint, column, count) for column in columns]))
    means = zip(rows, sums, strict=True)
    named |= {f"{row.label} [{row.unit}]": (integral / total)[joint] for row, integral in means}
    return named | {
        "opening [m]": np.maximum(gap[:, 0], 0.0),
        "tangential gap [m]": np.hypot(gap[:, 1], gap[:, 2]),
    }
