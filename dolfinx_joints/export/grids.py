# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Body and joints of a results file as unstructured grids: points, cells and values on them."""

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

Array = Any  # NumPy's, or `Dealt`

POLYGON, VERTEX = 7, 1  # VTK's numbers


@dataclass(frozen=True, kw_only=True)
class Grid:
    """An unstructured grid, or the part of a rank; all arrays of the whole may be dealt.

    Attributes:
        points: Shape (num_points, 3), [m].
        connectivity: Points of the cells, one cell after the other.
        offsets: Where each cell begins in ``connectivity``, and its length, (num_cells + 1,).
        kinds: VTK's number of each cell's shape, (num_cells,).
        cell_data: Values of cells that do not change, by name with unit.
        motion: Gives the displacements of the points from those of the nodes of the body, shape
            (num_points, num_nodes); None for a body, whose points are the nodes.
    """

    points: Array
    connectivity: Array
    offsets: Array
    kinds: Array
    cell_data: Mapping[str, Array] = field(default_factory=dict)
    motion: csr_matrix | None = None


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
    start = "mesh/groups/"
    known = [name for name in results.statics if name.startswith(start)]
    rows = {name.removeprefix(start): results.static(name) for name in known}
    inside = {name: np.flatnonzero(np.isin(chosen, own)) for name, own in rows.items()}
    kind = int(results.static("mesh/cell_kind")[0])
    return uniform_grid(results.static("mesh/nodes"), cells[chosen], kind, inside)


def uniform_grid(points: Floats, cells: Ints, kind: int, groups: Mapping[str, Ints]) -> Grid:
    """Grid of cells of one kind, shape (num_cells, nodes per cell), with the rows of each group.

    ``in NAME [-]`` is 1 in the cells of a group, 0 in others.
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
    """Arrays of mesh and joints by the names that a results file has for them."""

    @property
    def statics(self) -> Collection[str]:
        """Names of the arrays."""
        return self.keys()

    def static(self, name: str) -> NDArray[Any]:
        """Return an array."""
        return self[name]


def joint_grid(results: Statics, joint: str) -> Grid:
    """Grid of a joint: a polygon for each joint point, the part of its facet nearest to it.

    In a plane model each point is a vertex. The joint moves as the mean of its faces.
    """
    static = {
        name: results.static(f"joints/{joint}/{name}") for name in ("points", "areas", "frames")
    }
    polygons: list[Any] = []
    if not len(static["points"]):  # a rank may have none
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
    """`Grid.motion` of points on the joint of a plane body."""
    nodes, surface = results.static("mesh/nodes"), results.static("mesh/surface")
    facet_of_point, both = facets_of_joint(results, joint)
    ends = surface[both[facet_of_point]]  # (points, sides, ends)
    along = nodes[ends[:, :, 1]] - nodes[ends[:, :, 0]]
    share = np.einsum("psi,psi->ps", points[:, None] - nodes[ends[:, :, 0]], along)
    share /= np.einsum("psi,psi->ps", along, along)
    return _mean_of_faces(results, np.stack([1.0 - share, share], axis=1), ends.swapaxes(1, 2))


def _mean_of_faces(results: Statics, weights: NDArray[Any], numbers: NDArray[Any]) -> csr_matrix:
    """`Grid.motion` from shares of corners, (points, corners[, sides]), and nodes with sides."""
    weights = np.broadcast_to(weights.reshape(*weights.shape[:2], -1) / 2.0, numbers.shape)
    rows = np.repeat(np.arange(len(weights)), weights[0].size)
    shape = (len(weights), len(results.static("mesh/nodes")))
    return csr_matrix((weights.ravel(), (rows, numbers.ravel())), shape)


def joined(grids: Mapping[str, Grid]) -> Grid:
    """Several grids as one, with ``in NAME [-]``, 1 in the cells of a grid, and ``joint [-]``.

    The latter is the number of the grid, from 0.
    """
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
        cell_data={
            **{f"in {name} [-]": (number == i).astype(np.int8) for i, name in enumerate(grids)},
            "joint [-]": number,
            **data,
        },
        motion=vstack([grid.motion for grid in every], format="csr"),
    )


def joint_values(
    values: Mapping[str, NDArray[Any]],
    cell_data: Mapping[str, NDArray[Any]],
    count: int = 1,
    added: Callable[[Floats], Floats] = np.asarray,
) -> dict[str, Any]:
    """Values of joint points under the names that files and grids show, with units.

    The gap is also shown as what people look for, opening and tangential gap. Means over a joint
    are the same at all its points.

    Args:
        values: By the names of the stream ``states``, such as ``gap``, shape (n, ...).
        cell_data: Data of the grid of these points.
        count: Number of joints in the grid.
        added: Adds up sums over the parts of the grid.
    """
    units = {row.key: row.unit for row in rows_below("states", "joints/*/")}
    found: dict[str, Any] = {f"{name} [{units[name]}]": each for name, each in values.items()}
    gap, rows = values["gap"], rows_by("mean")
    joint = cell_data.get("joint [-]", np.zeros(len(gap), dtype=np.int64))
    areas = np.where(cell_data["tied [-]"] == 0, cell_data["area [m^2]"], 0.0)
    points = JointPoints(gap, gap[:, 1:], values["traction"], np.zeros(len(gap)))
    columns = [areas, *(areas * each for each in at_points(rows, points).T)]
    total, *sums = added(np.stack([np.bincount(joint, each, count) for each in columns]))
    means = zip(rows, sums, strict=True)
    found |= {f"{row.label} [{row.unit}]": (each / total)[joint] for row, each in means}
    return found | {
        "opening [m]": np.maximum(gap[:, 0], 0.0),
        "tangential gap [m]": np.hypot(gap[:, 1], gap[:, 2]),
    }
